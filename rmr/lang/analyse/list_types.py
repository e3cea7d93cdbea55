"""Typing rules of lists: terms that construct or destructure them, and functions on them.

Lists are homogeneous: the items of a list have one type. A term that destructures a list lets types flow from the list
to the variables of the term; a term that constructs one, from the items to the list.
"""

from rmr.bytecode.conform import NESTING_MAX
from rmr.bytecode.functions import Function, Gives, Takes
from rmr.bytecode.program import Base, Type
from rmr.lang.analyse.solver import Solver
from rmr.lang.analyse.type_demands import Demands
from rmr.lang.analyse.types import (
    CALLABLE,
    INT,
    LIST,
    OPEN,
    RESULTS,
    SORTED,
    TypeCell,
    compatible,
    described,
    fits,
    several,
)
from rmr.lang.diagnostics.diagnostic import Diagnostics
from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import Binary, Call, Expression, ListTerm, Variable


class Lists:
    """The typing rules applied to the lists of one program."""

    def __init__(self, solver: Solver, demands: Demands, found: Diagnostics) -> None:
        self._solver = solver
        self._demands = demands
        self._found = found
        self._made: list[tuple[TypeCell, Span]] = []

    def makes(self, cell: TypeCell, span: Span) -> None:
        """Register a constructed list, for the check of nesting."""
        self._made.append((cell, span))

    def check(self) -> None:
        """Report lists of a recursive type; without any, the lists that are nested too deep, outermost ones only."""
        deep = [made for made in self._made if made[0].innermost.depth >= NESTING_MAX] if self._solver.endless else []
        for cell, span in deep:
            if not self._found.many and self._solver.holds_itself(cell):
                message = "this list would hold lists like itself: its type has no end"
                self._found.report("E020", message, span)
        outer: Span | None = None
        for _, span in reversed(deep) if not self._found.failed else ():
            if outer is None or span.file != outer.file or not outer.start <= span.start < outer.end:
                self._found.report("E004", f"lists are nested more than {NESTING_MAX} deep", span)
                outer = span

    # ---- terms

    def term(self, term: ListTerm, items: list[TypeCell], rest: TypeCell | None, taken: frozenset[str]) -> TypeCell:
        """Return the cell of a list term, given the cells of its items and rest; it binds the variables `taken`."""
        within = TypeCell(OPEN, None, depth=1)
        cell = TypeCell(LIST, term.span, items=within)
        for item, each in zip(term.items, items, strict=True):
            self._part(item, each, within, taken)
            self._needs_item(item, each, within)
        if term.rest is not None and rest is not None:
            self._part(term.rest, rest, cell, taken)
            self._needs_rest(term.rest, rest, cell)
        self.makes(cell, term.span)
        return cell

    def _part(self, expression: Expression, part: TypeCell, whole: TypeCell, taken: frozenset[str]) -> None:
        """Add the flows between an item and the list's item cell, or between the rest and the list."""
        if isinstance(expression, Variable) and (expression.anonymous or expression.name in taken):
            self._solver.flow(whole, part)
            self._solver.fall_back(part, whole)
            return
        self._solver.flow(part, whole)
        if isinstance(expression, Variable):
            self._solver.fall_back(whole, part)
        elif isinstance(expression, ListTerm):
            self._solver.flow(whole, part)

    def _needs_item(self, item: Expression, part: TypeCell, within: TypeCell) -> None:
        def check() -> None:
            if not compatible(part.type, within.type):
                message = f"the items of this list are {several(within.type)}, this one is {described(part.type)}"
                self._demands.contradiction(message, item.span, within, part)

        self._demands.later(check)

    def _needs_rest(self, expression: Expression, rest: TypeCell, cell: TypeCell) -> None:
        def check() -> None:
            if rest.kind.base not in {Base.LIST, Base.OPEN}:
                hint = "`[A, B]` is the list of two items"
                self._demands.wrong("behind `|` stands a list", expression, rest, hint=hint)
            elif not compatible(rest.type, cell.type):
                message = f"behind items of {described(cell.type)} stands {described(rest.type)}"
                self._demands.contradiction(message, expression.span, cell, rest)

        self._demands.later(check)

    # ---- operators and functions

    def joined(self, expression: Binary, left: TypeCell, right: TypeCell) -> None:
        """Check the operands of a concatenation by `+`, when all types are known: two strings, or lists of one type."""
        if not compatible(left.type, right.type):
            message = f"`+` does not join {described(left.type)} and {described(right.type)}"
            appends = Base.LIST in {left.kind.base, right.kind.base} and left.kind.base is not right.kind.base
            hint = "`L + [X]` appends an item to a list" if appends else None
            if Base.STRING in {left.kind.base, right.kind.base} and not appends:
                hint = 'no value is turned into a string; hand both on as arguments: `shown(R, "load", N)`'
            self._demands.contradiction(message, expression.span, left, right, hint=hint)

    def call(self, call: Call, cells: list[TypeCell]) -> TypeCell:
        """Return the cell of a call of a list function."""
        function = CALLABLE[call.name.text]
        assert function.list_at is not None
        whole = cells[function.list_at]
        self._demands.later(lambda: self._needs_list(function, call, cells))
        # A flow into a list cell of its own makes the item type available without changing the argument.
        items = TypeCell(OPEN, None, depth=1)
        self._solver.flow(whole, TypeCell(LIST, None, items=items))
        for argument, cell, takes in zip(call.arguments, cells, function.takes, strict=True):
            if takes is Takes.ITEM and isinstance(argument, Variable):
                self._solver.fall_back(items, cell)
        if function.gives in RESULTS:
            return TypeCell(RESULTS[function.gives], call.span, fixed=True)
        if function.gives is Gives.WIDER_LIST:
            # Its items are a join of their own: an int put among floats is still an int and needs a conversion.
            joined = TypeCell(OPEN, None, depth=1)
            self._solver.flow(items, joined)
            self._solver.flow(cells[function.takes.index(Takes.ITEM)], joined)
            return TypeCell(LIST, call.span, items=joined)
        result = TypeCell(OPEN, None)
        self._solver.flow(items if function.gives is Gives.ITEM else whole, result)
        return result

    def _needs_list(self, function: Function, call: Call, cells: list[TypeCell]) -> None:
        at = function.list_at
        assert at is not None
        cell = cells[at]
        takes_string = function.takes[at] is Takes.LIST_OR_STRING
        if cell.kind.base in {Base.LIST, Base.OPEN} or (takes_string and cell.kind.base is Base.STRING):
            for argument, each, takes in zip(call.arguments, cells, function.takes, strict=True):
                if not self._fits(function, call, (argument, each, takes), cell):
                    return
            return
        swapped = function.example and any(each.kind.base is Base.LIST for each in cells)
        hint = f"the other way round: `{function.example}`" if swapped else None
        what = "a list or a string" if takes_string else "a list"
        self._demands.wrong(f"`{function.name}` needs {what}", call.arguments[at], cell, hint=hint)

    def _fits(self, function: Function, call: Call, given: tuple[Expression, TypeCell, Takes], whole: TypeCell) -> bool:
        """Whether an argument beside the list `whole` has an admissible type; a wrong one is reported."""

        argument, cell, takes = given
        match takes:
            case Takes.POSITION if not fits(cell.type, INT):
                hint = "`floor(X)` is an int" if cell.kind.base is Base.FLOAT else None
                self._demands.wrong(f"`{function.name}` counts with an int, from 0", argument, cell, hint=hint)
            case Takes.ITEM if not compatible(Type(Base.LIST, element=cell.type), whole.type):
                verb = "puts" if function.gives is Gives.WIDER_LIST else "looks for"
                place = "into" if function.gives is Gives.WIDER_LIST else "in"
                message = f"`{function.name}` {verb} {described(cell.type)} {place} {described(whole.type)}"
                self._demands.contradiction(message, call.span, cell, whole)
            case Takes.SORTABLE_LIST if cell.items is not None and cell.items.kind.base not in SORTED:
                self._demands.wrong(f"`{function.name}` needs items that have an order", argument, cell)
            case _:
                return True
        return False
