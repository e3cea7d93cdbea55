"""Syntax of the facts in a lab file: ``due(@1, 25)`` and, for `finish`, ``at(R, exit)``.

A fact of a lab is a name and a list of values, without expressions: robots (``@4``), integers, floats, times
(``500ms``, ``2s``, ``1.5min``: seconds as a float), strings, symbols, ``true`` and ``false``, and lists of these. A
number may also be a range such as ``20..60``, from which each run draws. The first argument is the owner. A lab can be
read without its program; the predicate and the types of its arguments are checked later (`validate.program_fit`).
"""

import re
from typing import Any

from rmr.base.record import record
from rmr.base.values import INT_MAX, INT_MIN, ROBOT_ID_MAX, Robot, Symbol, Value
from rmr.bytecode.program import ANY, Anything, Constant
from rmr_world.random_facts import LabFact, Range, StatedFact

TERM_DEPTH_MAX = 8
"""Bound of nested lists; deeper ones have no use and would exhaust the stack of the recursive parser."""


class TermError(ValueError):
    """Syntax error in a fact; the message says where, and what was expected."""


@record
class FinishPattern:
    """The pattern of the fact that every robot must hold for the run to be finished."""

    name: str
    patterns: tuple[Anything | Constant, ...]
    """Without the owner."""

    @property
    def constants(self) -> tuple[Any, ...]:
        """The arguments as plain values; None stands for anything."""
        return tuple(each.value if isinstance(each, Constant) else None for each in self.patterns)


@record
class _Variable:
    name: str


_Term = _Variable | Value | Range

_NUMBER = r"[-+]?(?:[0-9]+\.[0-9]+|[0-9]+)(?:[eE][-+]?[0-9]+)?"
_UNIT = r"ms|s|min"
_TOKEN = re.compile(
    rf"""\s*(?:
      (?P<robot>@[0-9]+)
    | (?P<low>{_NUMBER})(?P<low_unit>{_UNIT})?\.\.(?P<high>{_NUMBER})(?P<high_unit>{_UNIT})?(?![A-Za-z0-9_.])
    | (?P<number>{_NUMBER})(?P<unit>{_UNIT})?(?![A-Za-z0-9_.])
    | (?P<string>"(?:[^"\\\n]|\\.)*")
    | (?P<variable>[A-Z_][A-Za-z0-9_]*)
    | (?P<name>[a-z][A-Za-z0-9_]*(?:\.[a-z][A-Za-z0-9_]*)*)
    | (?P<mark>[][(),.!])
    )""",
    re.VERBOSE,
)
_SECONDS = {"ms": 1e-3, "s": 1.0, "min": 60.0}


class _Terms:
    """A recursive-descent parser of one fact."""

    def __init__(self, text: str, *, paths: bool = False) -> None:
        """`paths`: whether names may have points in them."""
        self._text = text
        self._paths = paths
        self._at = 0
        self._token: re.Match[str] | None = None
        self._step()

    def _step(self) -> None:
        self._at = self._token.end() if self._token else 0
        self._token = _TOKEN.match(self._text, self._at)
        if self._token and "." in (self._token["name"] or "") and not self._paths:
            raise TermError(f"expected a value, found '{self._token['name'][:20]}'")

    def _wrong(self, expected: str) -> TermError:
        rest = self._text[self._at :].strip()
        found = f"'{rest[:20]}'" if rest else "the end"
        return TermError(f"expected {expected}, found {found}")

    def _take(self, mark: str) -> bool:
        if self._token and self._token["mark"] == mark:
            self._step()
            return True
        return False

    def _need(self, mark: str) -> None:
        if not self._take(mark):
            raise self._wrong(f"'{mark}'")

    def fact(self) -> tuple[str, list[_Term]]:
        """Read ``name(term, ...)`` to the end of the text."""
        self._take("!")
        if not (self._token and self._token["name"]):
            raise self._wrong("a fact such as due(@1, 25)")
        name = self._token["name"]
        self._step()
        self._need("(")
        args = self._terms(")", 0)
        self._take(".")
        if self._text[self._at :].strip():
            raise self._wrong("the end")
        return name, args

    def _terms(self, closing: str, depth: int) -> list[_Term]:
        terms: list[_Term] = []
        if self._take(closing):
            return terms
        while True:
            terms.append(self._term(depth))
            if self._take(closing):
                return terms
            if not self._take(","):
                raise self._wrong(f"',' or '{closing}'")

    def _term(self, depth: int) -> _Term:
        if self._take("["):
            if depth == TERM_DEPTH_MAX:
                raise TermError("lists are nested too deeply")
            items = self._terms("]", depth + 1)
            if any(isinstance(item, _Variable) for item in items):
                raise TermError("a list cannot hold a variable here")
            if any(isinstance(item, Range) for item in items):
                raise TermError("a list cannot hold a range")
            return tuple(item for item in items if not isinstance(item, _Variable | Range))
        token = self._token
        if token is None or token["mark"]:
            raise self._wrong("a value")
        self._step()
        return _leaf(token)


def _leaf(token: re.Match[str]) -> _Term:
    """Return the value or variable of one token."""
    if token["robot"]:
        return _robot(token["robot"])
    if token["low"]:
        return _range(token)
    if token["number"]:
        return _number(token["number"], token["unit"])
    if token["string"]:
        return re.sub(r"\\(.)", lambda m: {"n": "\n", "t": "\t"}.get(m[1], m[1]), token["string"][1:-1])
    if token["variable"]:
        return _Variable(token["variable"])
    name = token["name"]
    return name == "true" if name in {"true", "false"} else Symbol(name)


def _robot(text: str) -> Robot:
    if len(text) > 6 or int(text[1:]) > ROBOT_ID_MAX:
        raise TermError(f"{text[:12]} is no robot: ids are 0 to {ROBOT_ID_MAX}")
    return Robot(int(text[1:]))


def _range(token: re.Match[str]) -> Range:
    low = _number(token["low"], token["low_unit"])
    high = _number(token["high"], token["high_unit"])
    try:
        return Range(low, high)
    except ValueError as error:
        raise TermError(str(error)) from None


def _number(text: str, unit: str | None) -> int | float:
    if unit:
        return _finite(float(text) * _SECONDS[unit], text)
    if any(mark in text for mark in ".eE"):
        return _finite(float(text), text)
    if len(text) > 20 or not INT_MIN <= int(text) <= INT_MAX:
        raise TermError(f"{text[:24]} does not fit 64 bits")
    return int(text)


def _finite(value: float, text: str) -> float:
    if value in {float("inf"), float("-inf")}:
        raise TermError(f"{text[:24]} is too large")
    return value


def parse_fact(text: str) -> StatedFact:
    """Return the fact written in `text`. Raises TermError.

    The first argument is the owner: a robot, or a variable for every robot; no other variable may stand in it.
    """
    name, terms = _Terms(text).fact()
    owner = _owner(terms, name)
    args = tuple(term for term in terms[1:] if not isinstance(term, _Variable))
    if len(args) != len(terms) - 1:
        raise TermError("only the owner may be a variable here")
    return StatedFact(name, None if isinstance(owner, _Variable) else int(owner), args)


def parse_topic_fact(text: str) -> LabFact:
    """Return the fact written in `text`, in which symbols are paths of fields of a message. Raises TermError."""
    name, terms = _Terms(text, paths=True).fact()
    owner = _owner(terms, name, "R")
    for term in terms[1:]:
        if isinstance(term, _Variable | Range | tuple):
            raise TermError("an argument is a field of the message, such as voltage or pose.position.x, or a constant")
    if not any(isinstance(term, Symbol) for term in terms[1:]):
        raise TermError(
            f"holds nothing of the message: name a field of it, {name}({text[len(name) + 1 : -1]}, voltage)"
        )
    args = tuple(term for term in terms[1:] if not isinstance(term, _Variable | Range))
    return LabFact(name, None if isinstance(owner, _Variable) else int(owner), args)


def parse_ros_action(text: str) -> tuple[str, int | None, tuple[str | None, ...]]:
    """Return name, owner (None: each robot) and paths of fields of an action; its name alone is one without arguments.

    An argument that goes nowhere is `_`, in the result None. Raises TermError.
    """
    name, terms = _Terms(text if "(" in text else f"{text}(R)", paths=True).fact()
    owner = _owner(terms, name, "R")
    paths = tuple(str(term) if isinstance(term, Symbol) else None for term in terms[1:])
    if any(path is None and term != _Variable("_") for path, term in zip(paths, terms[1:], strict=True)):
        raise TermError("an argument is the field that gets it, such as data or pose.position.x, or _ if none does")
    return name, None if isinstance(owner, _Variable) else int(owner), paths


def parse_finish(text: str) -> FinishPattern:
    """Return the pattern written in `text`, a fact whose variables match anything. Raises TermError."""
    name, terms = _Terms(text).fact()
    if not isinstance(_owner(terms, name, "R"), _Variable):
        raise TermError(f"every robot must hold it, so its owner is a variable: {name}(R, ...)")
    names = [term.name for term in terms if isinstance(term, _Variable) and term.name != "_"]
    repeated = next((n for i, n in enumerate(names) if n in names[:i]), None)
    if repeated:
        raise TermError(f"variable {repeated} stands twice; here each matches anything")
    if any(isinstance(term, Range) for term in terms):
        raise TermError("every run finishes with the same fact: a range cannot stand here")
    patterns = tuple(ANY if isinstance(term, _Variable | Range) else Constant(term) for term in terms[1:])
    return FinishPattern(name, patterns)


def _owner(terms: list[_Term], name: str, example: str = "@1") -> _Variable | Robot:
    if not terms or not isinstance(terms[0], _Variable | Robot):
        raise TermError(f"the first argument is the owner, a robot: {name}({example}, ...)")
    return terms[0]
