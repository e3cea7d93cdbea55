"""Lambda lifting: `let X = value in body` becomes a call of a function, whose arguments are all that it uses.

So the byte-code has no local variables of expressions: a value that is used several times is an argument, and is
evaluated once.
"""

from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import Call, Expression, Formal, FunctionItem, Name, Variable, walk

LET = "let"
"""The name in byte-code and in messages of the functions that lets become."""

MARK = "'"
"""Keeps the names of lifted functions apart from all names of the source."""


class Lifter:
    """Collects the functions that the lets of one program become."""

    def __init__(self) -> None:
        self.functions: list[FunctionItem] = []

    def lifted(self, bindings: list[tuple[Variable, Expression]], body: Expression, span: Span) -> Expression:
        """Return the call that a let becomes; each value may use the variables bound before it."""
        for variable, value in reversed(bindings):
            free = [each for each in _named(body) if each.name != variable.name]
            name = Name(f"{LET}{MARK}{len(self.functions)}", span)
            formals = tuple(Formal(each, None, each.span) for each in (variable, *free))
            self.functions.append(FunctionItem(name, formals, None, body, span))
            body = Call(name, (value, *free), span)
        return body


def _named(body: Expression) -> list[Variable]:
    """Return the named variables of an expression, each at its first occurrence."""
    found: dict[str, Variable] = {}
    for each in walk(body):
        if isinstance(each, Variable) and not each.anonymous:
            found.setdefault(each.name, each)
    return list(found.values())


def plain_name(name: str) -> str:
    """Return the name of a function as byte-code has it."""
    return name.partition(MARK)[0]
