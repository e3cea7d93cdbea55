"""The intermediate form of generated code: statements as records, expressions as text with what passes ask of them.

A pass builds statements and inspects these records; nothing inspects generated text. `text_of` prints statements, one a
line and one space a level: nothing else knows how Python lays them out. An expression is text because every pass treats
it as a whole. What a pass does ask of an expression stands beside the text: whether it is a variable (`Reference`),
which constant it is compared with (`Test`), and its type, bounds and failures (`rmr.vm.generate.source.Source`).
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from rmr.base.record import record

HELD = 0
"""Index of a fact's flag: False once the fact has been removed."""

SERIAL = 1
"""Index of a fact's serial number."""

ARGS = 2
"""Index of a fact's first argument."""


# Expressions


@record
class Local:
    """A local variable."""

    text: str


@record
class Column:
    """An argument of a fact that a local variable holds."""

    fact: str
    position: int

    @property
    def text(self) -> str:
        """The expression."""
        return column(self.fact, self.position)


Reference = Local | Column
"""The expression that holds the value of a rule's slot."""


@record
class Equality:
    """The comparison of an expression with a constant: it is true for this constant and for no other one."""

    subject: str
    constant: str


@record
class Test:
    """A Boolean expression that guards a statement."""

    text: str
    equality: Equality | None = None
    """The same as a comparison with a constant that may be evaluated before all other tests of its rule."""
    binds: bool = False
    """It assigns a variable that later tests use."""


def every(tests: Sequence[Test]) -> str:
    """Return the conjunction of tests."""
    return " and ".join([test.text for test in tests])


def column(fact: str, position: int) -> str:
    """Return an argument of `fact`."""
    return f"{fact}[{ARGS + position}]"


def serial(fact: str) -> str:
    """Return the serial number of `fact`."""
    return f"{fact}[{SERIAL}]"


def held(fact: str) -> str:
    """Return whether `fact` holds."""
    return f"{fact}[{HELD}]"


def tuple_of(texts: Sequence[str]) -> str:
    """Return a tuple, as an expression or as the target of an assignment."""
    return f"({', '.join(texts)}{',' if len(texts) == 1 else ''})"


# Statements


@record
class Assign:
    """``target = value``."""

    target: str
    value: str


@record
class AssignAll:
    """``one = other = value``."""

    targets: tuple[str, ...]
    value: str


@record
class Update:
    """``target += value``, or with another operator."""

    target: str
    operator: str
    value: str


@record
class Delete:
    """``del target``."""

    target: str


@record
class Evaluate:
    """An expression that is evaluated for its effect."""

    text: str


@record
class Yield:
    """``yield value``."""

    value: str


@record
class Return:
    """``return value``."""

    value: str = ""


@record
class Raise:
    """``raise value``."""

    value: str


@record
class Break:
    """``break``."""


@record
class Continue:
    """``continue``."""


@record
class If:
    """``if test: then``, and otherwise the rest; an If alone in `otherwise` is written as ``elif``."""

    test: str
    then: "Block"
    otherwise: "Block" = ()


@record
class Loop:
    """``for target in items: body``; `otherwise` runs unless the loop was left by a Break."""

    target: str
    items: str
    body: "Block"
    otherwise: "Block" = ()


@record
class While:
    """``while test: body``; `otherwise` runs unless the loop was left by a Break."""

    test: str
    body: "Block"
    otherwise: "Block" = ()


@record
class Try:
    """``try: body``; `handler` runs if the body raises `exception`, which is then called `name` (empty: nothing)."""

    exception: str
    name: str
    handler: "Block"
    body: "Block"


@record
class Define:
    """``def name(parameters): body``."""

    name: str
    parameters: tuple[str, ...]
    body: "Block"


Statement = (
    Assign
    | AssignAll
    | Update
    | Delete
    | Evaluate
    | Yield
    | Return
    | Raise
    | Break
    | Continue
    | If
    | Loop
    | While
    | Try
    | Define
)
Block = tuple[Statement, ...]


def with_otherwise(statement: Statement, otherwise: Block) -> Statement:
    """Return `statement` with an else branch; of a chain of ``elif`` the last one gets it."""
    if isinstance(statement, If):
        if len(statement.otherwise) == 1:
            otherwise = (with_otherwise(statement.otherwise[0], otherwise),)
        return If(statement.test, statement.then, otherwise)
    if isinstance(statement, While):
        return While(statement.test, statement.body, otherwise)
    assert isinstance(statement, Loop)
    return Loop(statement.target, statement.items, statement.body, otherwise)


def text_of(block: Iterable[Statement]) -> str:
    """Return statements as Python source."""
    lines: list[str] = []
    _write(block, "", lines)
    return "".join(lines)


def _write(block: Iterable[Statement], margin: str, lines: list[str]) -> None:
    for statement in block:
        kind = type(statement)
        simple = _SIMPLE.get(kind)
        if simple is not None:
            lines.append(f"{margin}{simple(statement)}\n")
        else:
            _COMPOUND[kind](statement, margin, lines)


def _inside(block: Block, margin: str, lines: list[str]) -> None:
    if block:
        _write(block, margin + " ", lines)
    else:
        lines.append(f"{margin} pass\n")


def _otherwise(block: Block, margin: str, lines: list[str]) -> None:
    if block:
        lines.append(f"{margin}else:\n")
        _inside(block, margin, lines)


def _if(statement: If, margin: str, lines: list[str]) -> None:
    """Write an ``if`` and the chain of ``elif`` that follows it."""
    word = "if"
    while True:
        lines.append(f"{margin}{word} {statement.test}:\n")
        _inside(statement.then, margin, lines)
        rest = statement.otherwise
        if len(rest) != 1 or not isinstance(rest[0], If):
            _otherwise(rest, margin, lines)
            return
        word = "elif"
        statement = rest[0]


def _loop(statement: Loop, margin: str, lines: list[str]) -> None:
    lines.append(f"{margin}for {statement.target} in {statement.items}:\n")
    _inside(statement.body, margin, lines)
    _otherwise(statement.otherwise, margin, lines)


def _while(statement: While, margin: str, lines: list[str]) -> None:
    lines.append(f"{margin}while {statement.test}:\n")
    _inside(statement.body, margin, lines)
    _otherwise(statement.otherwise, margin, lines)


def _try(statement: Try, margin: str, lines: list[str]) -> None:
    lines.append(f"{margin}try:\n")
    _inside(statement.body, margin, lines)
    name = f" as {statement.name}" if statement.name else ""
    lines.append(f"{margin}except {statement.exception}{name}:\n")
    _inside(statement.handler, margin, lines)


def _function(statement: Define, margin: str, lines: list[str]) -> None:
    lines.append(f"{margin}def {statement.name}({', '.join(statement.parameters)}):\n")
    _inside(statement.body, margin, lines)


_SIMPLE: dict[type, Callable[[Any], str]] = {
    Assign: lambda it: f"{it.target} = {it.value}",
    AssignAll: lambda it: " = ".join([*it.targets, it.value]),
    Update: lambda it: f"{it.target} {it.operator}= {it.value}",
    Delete: lambda it: f"del {it.target}",
    Evaluate: lambda it: it.text,
    Yield: lambda it: f"yield {it.value}",
    Return: lambda it: f"return {it.value}" if it.value else "return",
    Raise: lambda it: f"raise {it.value}",
    Break: lambda _: "break",
    Continue: lambda _: "continue",
}
"""Statements that take one line."""

_COMPOUND: dict[type, Callable[[Any, str, list[str]], None]] = {
    If: _if,
    Loop: _loop,
    While: _while,
    Try: _try,
    Define: _function,
}
"""Statements with blocks."""
