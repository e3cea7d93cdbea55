"""What compiling costs: a table, and JSON in build/bench-compile.json.

    python tests/bench/compile.py [--quick] [--output FILE]

Processor time of `rmr check`, the interpreter's start included, for a program of thirty lines and one of a thousand;
time and memory of the compiler for hundreds, thousands and ten thousands of items, each with predicates of its own or
all over the same; for texts that nobody means as a program; in `rmr lsp` the time from a key to the diagnostics. The
exit code is 0 only if every target is met.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path

from run import ROOT, Figure, show, used

sys.path.insert(0, str(ROOT / "tests"))
from lsp_client import LspClient

SIZES = (100, 1_000, 10_000)
"""Items of the programs that are compiled."""

SLOWER_MAX = 2.0
"""Time for an item of the largest program over that for one of a hundredth of it, at most: it grows in proportion."""


def sparse(items: int) -> str:
    """Return blocks of ten items, each block over predicates of its own."""
    block = """type place{k}(robot, area).
type !edge{k}(robot, robot, float).
type action go{k}(R: robot, A: area) -o place{k}(R, A) else lost{k}(R).
type lost{k}(robot).
place{k}(R, s).
!edge{k}(@1, @2, 2.5).
?place{k}(R, middle).
place{k}(R, L), L = s, edge{k}(R, B, D), D < {k}.5 -o go{k}(R, middle), {{C | edge{k}(R, C, 1.5) | lost{k}(C)}}.
lost{k}(R), $place{k}(R, _), not edge{k}(R, _, 1.5) -o [count => N | edge{k}(R, B, D) | many{k}(R, N * 2 + 1)].
crossing{k}: assert(lost{k}(R), place{k}(R, t), 10s, stop(R)).
"""
    return "".join(block.format(k=k) for k in range(items // 10))


def dense(items: int) -> str:
    """Return rules that are all over the same twenty predicates, two goals and a few assertions."""
    lines = [f"type p{k}(robot, int)." for k in range(20)] + ["?p7(R, 99).", "?p3(R, 5)."]
    lines += [f"w{k}: assert(p{k}(R, X), p{k + 5}(R, X), 10, stop(R))." for k in range(4)]
    rules = items - len(lines)
    lines += [
        f"p{k % 20}(R, {k}), p{k * 7 % 20}(R, X), X > {k} -o p{(k + 1) % 20}(R, {k % 100})." for k in range(rules)
    ]
    return "\n".join(lines)


def plain(lines: int) -> str:
    """Return as many declarations as rules."""
    half = lines // 2
    declared = [f"type p{k}(robot, int).\n" for k in range(half)]
    return "".join(declared + [f"p{k}(R, X), X > {k} -o p{(k + 1) % half}(R, X + 1).\n" for k in range(half)])


WRONG: dict[str, Callable[[], str]] = {
    "a comma missing in each of 10,000 rules": lambda: dense(10_000).replace(", p", " p"),
    "an error of meaning in each of 10,000 rules": lambda: dense(10_000).replace("(R, X)", "(R, X, Y)"),
    "4 MiB of Python": lambda: (Path(argparse.__file__).read_text(encoding="utf-8") * 50)[: 1 << 22],
    "4 MiB of brackets": lambda: "p(R, " + "(" * ((1 << 22) - 8),
    "a sum of a million terms": lambda: "p(R, X), Y = X" + " + 1" * 1_000_000 + " -o p(R, Y).",
    "a list of a million items": lambda: "p(R, [" + ", ".join(["1"] * 1_000_000) + "]).",
    "a string of 4 MiB": lambda: 'p(R, "' + "x" * ((1 << 22) - 16) + '").',
    "a comment of 4 MiB": lambda: "/*" + " *" * ((1 << 21) - 8) + "*/ p(R).",
    "a comment of 4 MiB without an end": lambda: "p(R). /*" + " *" * ((1 << 21) - 8),
}
"""Texts that cost much if anything does: the largest that are read."""

WRONG_S_MAX = 15
"""Processor time for one of them, at most."""


def check_cpu(lines: int, target_ms: int, repetitions: int) -> Iterable[Figure]:
    """Processor time of ``rmr check`` for a program of some lines, the tables at hand."""
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "program.rmr"
        program.write_text(plain(lines))
        words = [sys.executable, "-c", "from rmr.cli import main; main()", "check", str(program)]
        usages = [used(words) for _ in range(repetitions + 1)][1:]
    taken = [(usage.ru_utime + usage.ru_stime) * 1e3 for usage in usages]
    yield Figure(f"rmr check, {lines} lines: least processor time of {repetitions}", min(taken), "ms", target_ms)


def compiled(text: str) -> tuple[float, float]:
    """Return the processor time in seconds and the memory in MB that a process of its own takes to compile `text`."""
    code = (
        "import sys, time, resource\n"
        "from rmr.lang.compiler import compile_source\n"
        "text = sys.stdin.read()\n"
        "start = time.process_time()\n"
        "compile_source(text)\n"
        "print(time.process_time() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)\n"
    )
    answer = subprocess.run([sys.executable, "-c", code], input=text, capture_output=True, text=True, check=True)
    seconds, megabytes = map(float, answer.stdout.split())
    return seconds, megabytes


def growth(name: str, program: Callable[[int], str]) -> Iterable[Figure]:
    """Time for an item of programs of growing size."""
    each = []
    for items in SIZES:
        seconds, megabytes = compiled(program(items))
        each.append(seconds / items)
        yield Figure(f"{name}, {items} items: time an item", each[-1] * 1e6, "us")
    yield Figure(f"{name}: an item of {SIZES[-1]} over one of {SIZES[0]}", each[-1] / each[0], "", SLOWER_MAX)
    yield Figure(f"{name}, {SIZES[-1]} items: memory", megabytes, "MB", 500)


def wrong(name: str, text: str) -> Iterable[Figure]:
    """Time and memory for a text that is no good program."""
    seconds, megabytes = compiled(text)
    yield Figure(f"{name}: processor time", seconds, "s", WRONG_S_MAX)
    yield Figure(f"{name}: memory", megabytes, "MB", 400)


def lively(lines: int) -> str:
    """Return rules with a declaration, a comment and a fact each, as a person lays them out."""
    block = """type goods{k}(robot, int).
// What there is of the goods {k}, and what becomes of them.
load(R, N), goods{k}(R, M), N > {k} -o load(R, N - 1), goods{k}(R, M + 1),
    work(R, N).
goods{k}(R, {k}).

"""
    start = "type load(robot, int).\nload(R, 9).\ntype action work(R: robot, N: int) -o done(R).\ndone(R) -o 1.\n"
    text = start + "".join(block.format(k=k) for k in range(lines // 6 + 1))
    return "".join(text.splitlines(keepends=True)[:lines])


KEY_MS_MAX = 100
"""Time from a key to the diagnostics: what comes within it seems to come at once."""


def keys(lines: int, repetitions: int) -> Iterable[Figure]:
    """Time from a change until `rmr lsp` has said what is wrong: at the beginning, in the middle, at the end."""
    uri = "untitled:program.rmr"
    text = lively(lines)
    end = text.count("\n")
    taken = []
    with LspClient() as editor:
        editor.initialize().open(uri, text)
        editor.diagnostics(uri, 1)
        for version in range(2, 2 + 3 * repetitions):
            line = (4, end // 2, end)[version % 3]
            time.sleep(0.2)  # nobody types faster all the time
            begun = time.perf_counter()
            editor.change(uri, version, ((line, 0), (line, 0), " "))
            assert not any(each["severity"] == 1 for each in editor.diagnostics(uri, version))
            taken.append((time.perf_counter() - begun) * 1e3)
    each = f"rmr lsp, {lines} lines, from a key to the diagnostics"
    yield Figure(f"{each}: median of {len(taken)}", statistics.median(taken), "ms", KEY_MS_MAX)
    yield Figure(f"{each}: 19 of 20 within", statistics.quantiles(taken, n=20)[-1], "ms", KEY_MS_MAX)


def figures(quick: bool) -> Iterable[Figure]:
    """Take all figures, one after the other."""
    repetitions = 5 if quick else 15
    yield from check_cpu(30, 150, repetitions)
    yield from check_cpu(1000, 1000, repetitions)
    yield from keys(1000, repetitions)
    yield from growth("predicates of their own", sparse)
    yield from growth("the same predicates", dense)
    for name, text in WRONG.items():
        yield from wrong(name, text())


def main() -> int:
    """Take the figures, show them, and say whether every target is met."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    parser.add_argument("--output", type=Path, default=ROOT / "build" / "bench-compile.json", metavar="FILE")
    arguments = parser.parse_args()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["PYTHONPYCACHEPREFIX"] = (
            folder  # warm: what Python compiles itself is at hand from the first call on
        )
        taken = list(figures(arguments.quick))
    show(taken, [])
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_text(json.dumps([asdict(figure) | {"met": figure.met} for figure in taken], indent=2) + "\n")
    return 0 if all(figure.met for figure in taken) else 1


if __name__ == "__main__":
    sys.exit(main())
