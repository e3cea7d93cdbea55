"""What a program's own comments say of it.

A comment line of the form ``// word: rest`` at the head of a line is an expectation:

    // error: E012 7            `rmr check` reports this code at this line
    // warning: W102 9          likewise; a program without such lines has neither errors nor warnings
    // run: --robots 3          arguments of `rmr eval`; what follows, up to the next `run`, holds of its report
    // quiescent                or `not quiescent`
    // firings: 7
    // facts @1: a(@1), b(@1)   exactly these
    // has: a(@1), b(@2, _)     among the facts of the robot that the first argument names; `_` is anything
    // lacks: a(_)              no fact is like this
    // actions @1: say(@1, "x") exactly these, in this order
    // achieved @1: p(@1)       the goals that were achieved, in this order
    // open @1: p(@1)           the goals still open
    // met @1: crossing         all jobs of these names were done in time, and there are some
    // missed @1: crossing      at least one job of each name missed its deadline
    // failures @1: 2           expressions without value
    // says: text               this stands in what the command tells besides its report
"""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

_CHECKED = re.compile(r"^// (error|warning): ([EW]\d{3}) (\d+)\s*$")
_LINE = re.compile(
    r"^// (?P<word>run|quiescent|not quiescent|firings|facts|has|lacks|actions|achieved|open|met|missed|failures|says)"
    r"(?: @(?P<robot>\d+))?(?::(?P<rest>.*))?$"
)


@dataclass
class Run:
    """One run and what must hold of it."""

    arguments: str
    claims: list[tuple[str, str | None, str]] = field(default_factory=list)


def diagnostics_of(path: Path) -> list[tuple[str, int]]:
    """Return the codes and lines that the program says `rmr check` reports."""
    found = [_CHECKED.match(line) for line in path.read_text("utf-8").splitlines()]
    return sorted((match[2], int(match[3])) for match in found if match)


def runs_of(path: Path) -> list[Run]:
    """Return the runs that the program describes."""
    runs: list[Run] = []
    for line in path.read_text("utf-8").splitlines():
        match = _LINE.match(line)
        if match is None:
            continue
        if match["word"] == "run":
            runs.append(Run(match["rest"].strip()))
        else:
            assert runs, f"{path}: an expectation before the first `run`: {line}"
            runs[-1].claims.append((match["word"], match["robot"], (match["rest"] or "").strip()))
    return runs


def split(text: str) -> list[str]:
    """Return the parts of `text` between its outermost commas."""
    parts, depth, quoted, start = [], 0, False, 0
    for index, character in enumerate(text):
        if character == '"' and text[index - 1 : index] != "\\":
            quoted = not quoted
        elif not quoted:
            depth += (character in "([{") - (character in ")]}")
            if character == "," and depth == 0:
                parts.append(text[start:index].strip())
                start = index + 1
    last = text[start:].strip()
    return [*parts, last] if last else parts


def _parsed(fact: str) -> tuple[str, list[str]]:
    name, _, rest = fact.partition("(")
    return name, split(rest.removesuffix(")"))


def is_like(fact: str, pattern: str) -> bool:
    """Whether `fact` is `pattern` but for what `_` stands for."""
    name, arguments = _parsed(fact)
    wanted, patterns = _parsed(pattern)
    same = name == wanted and len(arguments) == len(patterns)
    return same and all(pattern in ("_", argument) for argument, pattern in zip(arguments, patterns, strict=True))


def holds(claim: tuple[str, str | None, str], report: dict[str, Any], told: str) -> str | None:
    """Return why `claim` does not hold of `report`, or None."""
    word, robot, rest = claim
    robots = report["robots"]
    if word.endswith("quiescent"):
        return _equal(report["quiescent"], word == "quiescent")
    if word == "firings":
        return _equal(report["firings"], int(rest))
    if word == "says":
        return None if rest in told else f"it said {told!r}"
    if word in ("has", "lacks"):
        every = [fact for each in robots.values() for fact in each["facts"]]
        missing = [each for each in split(rest) if any(is_like(fact, each) for fact in every) is (word == "lacks")]
        return f"{word}: {missing} among {every}" if missing else None
    assert robot is not None, claim
    return _of_robot(word, rest, robots[robot])


def _of_robot(word: str, rest: str, robot: dict[str, Any]) -> str | None:
    match word:
        case "facts":
            return _equal(robot["facts"], sorted(split(rest)))
        case "actions":
            return _equal([text for _, text in robot["actions"]], split(rest))
        case "achieved":
            return _equal([text for text, _ in robot["goals"]["achieved"]], split(rest))
        case "open":
            return _equal(robot["goals"]["open"], split(rest))
        case "failures":
            return _equal(robot["expression_failures"], int(rest))
    outcomes = {name: [job["met"] for job in robot["assertions"] if job["name"] == name] for name in split(rest)}
    good = [all(each) if word == "met" else False in each for each in outcomes.values() if each]
    return None if len(good) == len(outcomes) and all(good) else f"jobs: {outcomes}"


def _equal(found: object, wanted: object) -> str | None:
    return None if found == wanted else f"it is {found!r}, not {wanted!r}"
