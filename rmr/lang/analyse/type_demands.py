"""Type demands: checks that are deferred until the solver has finished.

Each contradiction is thus reported once, against the final types, with the places that they come from.
"""

import re
from collections.abc import Callable

from rmr.base.values import Symbol
from rmr.bytecode.program import Base, Type
from rmr.lang.analyse.types import (
    BOOL,
    INT,
    NUMBERS,
    ORDERED,
    ROBOT,
    SYNONYMS,
    TypeCell,
    compatible,
    described,
    fits,
    type_text,
)
from rmr.lang.diagnostics.diagnostic import DiagnosticNote, Diagnostics, WordHint
from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import Expression, Literal


def notes(span: Span, *cells: TypeCell) -> tuple[DiagnosticNote, ...]:
    """Return notes with the origins of the types of `cells`, `span` excluded, each once."""
    found: list[DiagnosticNote] = []
    for cell in cells:
        inner = cell.innermost
        origin = cell.origin if inner.origin is None or inner.kind.base is Base.OPEN else inner.origin
        if origin is not None and origin != span and all(note.span != origin for note in found):
            found.append(DiagnosticNote(origin, f"{type_text(cell.type)} because of this"))
    return tuple(found)


def literal_hint(expression: Expression, wanted: Type) -> str | None:
    """Return the hint for a literal that looks like a misspelt one of type `wanted`, or None."""
    if not isinstance(expression, Literal):
        return None
    value = expression.value
    if wanted.base is Base.SYMBOL and wanted.name in SYNONYMS:
        return f"did you mean the type `{SYNONYMS[wanted.name]}`?"
    if type(value) is str and wanted.base is Base.SYMBOL:
        words = "_".join(re.findall(r"[a-z0-9]+", value.lower()))
        return f"a symbol has no quotes: `{words}`" if words[:1].isalpha() else None
    if wanted.base in NUMBERS and (hint := _unquoted(expression)):
        return hint
    if type(value) is str and wanted.base is Base.ROBOT:
        return "robots are written `@1`; a variable, `R`, is any robot"
    if isinstance(value, Symbol):
        if value in {"null", "none", "nil"}:
            return "there is no empty value: where nothing is known there is no fact"
        text = f'"{value}"'
        return (
            WordHint(f"a text stands in quotes: `{text}`", text, expression.span)
            if wanted.base is Base.STRING
            else None
        )
    if type(value) is float and wanted.base is Base.INT and value.is_integer():
        return WordHint(f"`{int(value)}` is an int", str(int(value)), expression.span)
    return None


def _unquoted(expression: Expression) -> str | None:
    """Return the hint for a number or a time in quotes."""
    value = expression.value if isinstance(expression, Literal) else None
    is_number = type(value) is str and re.fullmatch(r"[0-9]+(\.[0-9]+)?(ms|s|min)?", value)
    if expression is None or not is_number:
        return None
    return WordHint(f"a number has no quotes: `{value}`", str(value), expression.span)


class Demands:
    """The deferred checks of one program."""

    def __init__(self, found: Diagnostics) -> None:
        self._found = found
        self._checks: list[Callable[[], None]] = []

    def later(self, check: Callable[[], None]) -> None:
        """Defer `check` until all types are known."""
        self._checks.append(check)

    def check(self) -> None:
        """Run the deferred checks in the order of their registration."""
        for check in self._checks:
            check()

    def contradiction(
        self, message: str, span: Span, *cells: TypeCell, code: str = "E020", hint: str | None = None
    ) -> None:
        """Report a contradiction of types, with the origins of `cells` as notes.

        Nothing is reported at a place that has an error already: it would be a consequence of that one.
        """
        if not self._found.wrong_at(span):
            self._found.report(code, message, span, hint=hint, notes=notes(span, *cells))

    def wrong(
        self, message: str, expression: Expression, cell: TypeCell, *, code: str = "E020", hint: str | None = None
    ) -> None:
        """Report that `expression` is not what `message` says it must be."""
        self.contradiction(f"{message}, this is {described(cell.type)}", expression.span, cell, code=code, hint=hint)

    # ---- demands on an expression

    def robot(self, expression: Expression, cell: TypeCell, message: str) -> None:
        """Demand a robot."""

        def check() -> None:
            if not compatible(cell.type, ROBOT):
                self.wrong(message, expression, cell, code="E021")

        self.later(check)

    def truth(self, expression: Expression, cell: TypeCell, message: str) -> None:
        """Demand a Boolean."""

        def check() -> None:
            if compatible(cell.type, BOOL):
                return
            hint = None
            if isinstance(expression, Literal) and isinstance(expression.value, Symbol):
                hint = f"a fact names its owner: `{expression.value}(R)`"
            self.wrong(message, expression, cell, code="E022", hint=hint)

        self.later(check)

    def whole(self, expression: Expression, cell: TypeCell, message: str) -> None:
        """Demand an int."""

        def check() -> None:
            if not fits(cell.type, INT):
                hint = "`floor(X)` is an int" if cell.kind.base is Base.FLOAT else None
                self.wrong(message, expression, cell, hint=hint)

        self.later(check)

    def number(self, expression: Expression, cell: TypeCell, message: str, hint: str | None = None) -> None:
        """Demand a number."""

        self.later(lambda: self.number_now(expression, cell, message, hint))

    def number_now(self, expression: Expression, cell: TypeCell, message: str, hint: str | None = None) -> None:
        """Demand a number, when all types are known."""
        if cell.kind.base not in NUMBERS | {Base.OPEN}:
            self.wrong(message, expression, cell, hint=_unquoted(expression) or hint)

    def order_now(self, what: str, example: str, *sides: tuple[Expression, TypeCell]) -> None:
        """Demand values that have an order, when all types are known; the first of `sides` without one is reported.

        `example` says how to order robots.
        """
        for side, cell in sides:
            if cell.kind.base not in ORDERED:
                hint = f"robots have no order, their numbers do: `{example}`" if cell.kind == ROBOT else None
                self.wrong(f"{what} needs numbers or strings", side, cell, hint=hint)
                return
