"""Sources that nobody wrote: the compiler answers each with a program or with diagnostics, never with a traceback.

A source is drawn in one of two ways. By mutation: words of a program of the tree, or of one in its documentation, are
deleted, replaced, inserted, exchanged or repeated. By the grammar: derivations of its rules, most of whose calls are
those of predicates that are declared with as many arguments. What compiles must be valid byte-code, which survives
coding. `properties/test_lang_drawn.py` has a few of them. Run as a program for a long campaign:
``python compiler_campaign.py FIRST LAST``; each failing seed is printed with its source, and so is one that takes more
than `SLOW_S`.
"""

import re
import sys
import time
import traceback
from functools import cache
from pathlib import Path
from random import Random

from rmr.bytecode.codec import decode, encode
from rmr.bytecode.verify import verify
from rmr.lang.compiler import compile_source
from rmr.lang.diagnostics.render import render_text
from rmr.lang.read.grammar import grammar_text
from rmr.lang.read.table_maker import parser_of
from rmr.lang.read.tables import tables

ROOT = Path(__file__).parent.parent
SOURCE_MAX = 6000
"""Characters of the longest program that is mutated."""
SLOW_S = 3.0
"""Processor time of a source of some kilobytes, far more than any takes."""
DEPTH_MAX = 12
"""Depth of derivations beyond which each rule takes its shortest way to an end."""
SHORT = 25
"""How much more often a production of one symbol is taken than one of several."""

DECLARED = """
type p(robot, int). type q(robot). type !e(robot, robot). type l(robot, list int). type !v(R: robot, X: min float).
type sensor s(robot, area). type action go(R: robot, A: area) -o s(R, A) else q(R). type action halt(robot).
type w(robot, symbol). const c = 3. fun f(X: int): int = X + c. p(@1, 1). e(@1, @2).
"""
"""What drawn items may rely on."""
BOUND = ("", "p(R, X), ", "p(R, X), l(R, L), !e(R, A), !e(R, B), ", "$p(R, X), q(R), peer(R, A), B = A, L = [X], ")
"""How the bodies of drawn rules begin, so that most of the variables of their other parts are bound."""
PREDICATES = {"p": 2, "q": 1, "e": 2, "l": 2, "v": 2, "s": 2, "go": 2, "halt": 1, "w": 2, "peer": 2, "at": 2}
FUNCTIONS = {"f": 1, "id": 1, "len": 1, "nth": 2, "min": 2, "now": 0, "if": 3, "sort": 1, "dist": 2}
"""What drawn items call, with the numbers of arguments."""
WORDS = {
    "NAME": ["a", "p", "q", "int", "robot", "float", "count", "sum", "min", "collect", "random", "textual", "c"],
    "VARIABLE": ["R", "R", "R", "A", "B", "X", "Y", "L", "_"],
    "INT": ["0", *"111222333", "9223372036854775808"],
    "FLOAT": ["0.5", "1.5", "1e3", "1e999"],
    "TIME": ["2s", "500ms"],
    "ROBOT": ["@1", "@2", "@3", "@70000"],
    "STRING": ['"x"', '"a\\n"', '"x.rmr"'],
    "ARROW": ["-o"],
    "MINUS": ["-"],
    "NE": ["!=", "<>"],
}
"""Spellings of the terminals that have no fixed one."""

_WORD = re.compile(r"\s+|\w+|.", re.S)


@cache
def programs() -> list[str]:
    """Return the programs of the tree and of its documentation, in a fixed order."""
    files = [*ROOT.glob("deploy/**/*.rmr"), *ROOT.glob("rmr/**/*.rmr"), *ROOT.glob("tests/**/*.rmr")]
    files += ROOT.glob("docs/**/*.rmr")
    found = [path.read_text(encoding="utf-8", errors="replace") for path in sorted(files)]
    for page in sorted(ROOT.glob("docs/**/*.md")):
        found += re.findall(r"```rmr[^\n]*\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    return [text for text in found if len(text) < SOURCE_MAX]


@cache
def vocabulary() -> list[str]:
    """Return all words of the programs."""
    return sorted({word for text in programs() for word in _WORD.findall(text) if not word.isspace()})


def mutated(rng: Random) -> str:
    """Return a program with one to three changes."""
    words = _WORD.findall(rng.choice(programs()))
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        at = rng.randrange(len(words))
        match rng.choices(("delete", "replace", "insert", "exchange", "repeat"), (30, 25, 20, 12, 13))[0]:
            case "delete" if len(words) > 1:
                del words[at]
            case "replace":
                words[at] = rng.choice(vocabulary())
            case "insert":
                words.insert(at, rng.choice(vocabulary()))
            case "exchange":
                other = rng.randrange(len(words))
                words[at], words[other] = words[other], words[at]
            case "repeat":
                words[at:at] = words[at : at + rng.randrange(1, 12)]
    return "".join(words)


@cache
def _rules() -> dict[str, list[tuple[int, list[str]]]]:
    """Return the productions by nonterminal: how deep the shallowest derivation is below it, and the symbols."""
    rules = parser_of(grammar_text()).rules
    found = [(str(rule.origin.name), [str(each.name) for each in rule.expansion]) for rule in rules]
    depths = dict.fromkeys((origin for origin, _ in found), 99)

    def below(symbols: list[str]) -> int:
        return max((depths.get(each, 0) for each in symbols), default=0)

    for _ in depths:
        for origin, symbols in found:
            depths[origin] = min(depths[origin], 1 + below(symbols))
    return {origin: [(below(symbols), symbols) for of, symbols in found if of == origin] for origin in depths}


def derived(rng: Random) -> str:
    """Return some items that the grammar derives, behind declarations of what most of them name."""
    symbols = (rng.choice(("item", "rule", "rule")) for _ in range(rng.choice((1, 1, 2, 4))))
    items = (rng.choice(BOUND) * (each == "rule") + " ".join(_derived(rng, each, 0)) for each in symbols)
    return DECLARED + "\n".join(items) + "\n"


def _derived(rng: Random, symbol: str, depth: int) -> list[str]:
    if symbol == "term" and rng.random() < 0.8:
        return [rng.choice(WORDS["VARIABLE"])] if rng.random() < 0.8 else _called(rng, FUNCTIONS, depth)
    if (symbol == "call" and rng.random() < 0.9) or (symbol == "conjunct" and rng.random() < 0.5):
        return _called(rng, PREDICATES, depth)
    if symbol not in _rules():
        [spelling] = [each.spelling for each in tables().terminals if each.name == symbol]
        return [spelling or rng.choice(WORDS[symbol])]
    ways = _rules()[symbol]
    if depth > DEPTH_MAX:
        shallowest = min(deep for deep, _ in ways)
        ways = [way for way in ways if way[0] == shallowest]
    # Expressions are mostly short: a way of one symbol is taken more often.
    [(_, symbols)] = rng.choices(ways, [1 + SHORT * (len(symbols) == 1) for _, symbols in ways])
    return [word for each in symbols for word in _derived(rng, each, depth + 1)]


def _called(rng: Random, calls: dict[str, int], depth: int) -> list[str]:
    """Return a call of one of `calls`."""
    name, count = rng.choice(list(calls.items()))
    words = [name, "("]
    for place in range(count):
        if place > 0:
            words.append(",")
        if place == 0 and rng.random() < 0.8:
            words.append(rng.choice("RRAB"))
        else:
            words += _derived(rng, "term" if rng.random() < 0.8 else "expression", depth + 1)
    return [*words, ")"]


def source(seed: int) -> str:
    """Return the source of a seed."""
    rng = Random(f"source/{seed}")
    return mutated(rng) if rng.random() < 0.6 else derived(rng)


def problem(text: str) -> str | None:
    """Compile `text`; return what is wrong with the answer, or None."""
    began = time.process_time()
    try:
        compilation = compile_source(text, "x")
        render_text(compilation.diagnostics, {"x": compilation.source}, color=True)
        if (compilation.program is None) != bool(compilation.errors):
            return "neither a program nor an error, or both"
        if compilation.program is not None:
            if wrong := verify(compilation.program):
                return f"byte-code that is not valid: {wrong[0]}"
            if decode(encode(compilation.program, debug=True)) != compilation.program:
                return "byte-code that is another program when it is read"
    except Exception as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__} in {Path(frame.filename).name}:{frame.lineno}: {error}"
    taken = time.process_time() - began
    return f"{taken:.1f} s of processor time" if taken > SLOW_S else None


def main(first: int, last: int) -> int:
    """Compile the sources of these seeds; return how many fail."""
    failed = 0
    for seed in range(first, last + 1):
        text = source(seed)
        wrong = problem(text)
        if wrong is not None:
            failed += 1
            print(f"seed {seed}: {wrong}\n{text}", flush=True)
    print(f"{last - first + 1} sources, {failed} fail")
    return failed


if __name__ == "__main__":
    sys.exit(bool(main(int(sys.argv[1]), int(sys.argv[2]))))
