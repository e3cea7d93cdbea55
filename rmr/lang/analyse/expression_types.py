"""Typing rules of expressions: the result types of operators and functions, and their demands on operands."""

from rmr.base.printable import counted
from rmr.base.record import record
from rmr.bytecode.functions import Function, Takes
from rmr.bytecode.program import Base
from rmr.lang.analyse.let_lifting import plain_name
from rmr.lang.analyse.list_types import Lists
from rmr.lang.analyse.names import Names, declared_type, meant
from rmr.lang.analyse.solver import Solver
from rmr.lang.analyse.type_demands import Demands, literal_hint
from rmr.lang.analyse.types import (
    BOOL,
    CALLABLE,
    FLOAT,
    OPEN,
    RESULTS,
    TypeCell,
    cell_of,
    compatible,
    described,
    fits,
    literal_cell,
)
from rmr.lang.diagnostics.diagnostic import DiagnosticNote, Diagnostics
from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import (
    Binary,
    Call,
    Expression,
    FunctionItem,
    LetTerm,
    ListTerm,
    Literal,
    TypeName,
    Unary,
    Variable,
)


@record
class TypeScope:
    """The type environment of a rule, with the roles of its variables in the body."""

    cells: dict[str, TypeCell]
    constants: dict[str, Literal]
    """Variables that the body equates with a constant."""
    given: frozenset[str] = frozenset()
    """Variables bound by an equation of the body."""
    taken: frozenset[str] = frozenset()
    """Variables bound only by destructuring a list."""

    def inner(self) -> "TypeScope":
        """Return a copy for an inner body, whose variables do not leave it."""
        return TypeScope(dict(self.cells), dict(self.constants))

    def using(self) -> "TypeScope":
        """Return the scope of an expression that binds no variable."""
        return TypeScope(self.cells, self.constants) if self.given or self.taken else self

    def variable(self, variable: Variable) -> TypeCell:
        """Return a variable's cell, made at its first occurrence."""
        if variable.anonymous:
            return TypeCell(OPEN, None)
        return self.cells.setdefault(variable.name, TypeCell(OPEN, None))


class FunctionCells:
    """The type variables of a function of the program: one for each parameter, and one for its value."""

    def __init__(self, item: FunctionItem) -> None:
        self.item = item
        self.parameters = [_declared(each.type, each.span) for each in item.parameters]
        self.result = _declared(item.result, item.name.span)


def _declared(name: TypeName | None, span: Span) -> TypeCell:
    """Return the cell of a declared type, or an open one."""
    if name is None:
        return TypeCell(OPEN, None)
    return cell_of(declared_type(name), span, fixed=True)


class Expressions:
    """The typing rules applied to the expressions of one program."""

    def __init__(self, names: Names, solver: Solver, demands: Demands, found: Diagnostics) -> None:
        self._names = names
        self._solver = solver
        self._demands = demands
        self._found = found
        self.lists = Lists(solver, demands, found)
        self.own = {name: FunctionCells(item) for name, item in names.functions.items()}
        """Cells of the program's functions."""
        self.cells: dict[Span, TypeCell] = {}
        """Cells of all expressions by place."""
        self.divisions: set[Span] = set()
        """Places of `/`, for the hint that it always gives a float."""

    def cell(self, expression: Expression, scope: TypeScope) -> TypeCell:
        """Return the cell of `expression`, after those of its operands; the recursion is bounded by the parser."""
        match expression:
            case Literal():
                cell = literal_cell(expression)
            case Variable():
                cell = scope.variable(expression)
            case Unary():
                cell = self._unary(expression, scope)
            case Binary():
                cell = self._binary(expression, scope)
            case Call():
                cell = self._call(expression, scope)
            case LetTerm():
                raise AssertionError("a let that was not lifted")
            case ListTerm():
                items = [self.cell(item, scope) for item in expression.items]
                rest = None if expression.rest is None else self.cell(expression.rest, scope)
                cell = self.lists.term(expression, items, rest, scope.taken)
        self.cells[expression.span] = cell
        return cell

    # ---- operators

    def _unary(self, expression: Unary, scope: TypeScope) -> TypeCell:
        operand = self.cell(expression.operand, scope.using())
        if expression.operator == "not":
            self._demands.truth(expression.operand, operand, "`not` needs a Boolean")
            return TypeCell(BOOL, expression.span)
        self._demands.number(expression.operand, operand, "`-` needs a number")
        cell = TypeCell(OPEN, None)
        self._solver.flow(operand, cell)
        return cell

    def _binary(self, expression: Binary, scope: TypeScope) -> TypeCell:
        operator = expression.operator
        # Only a list term directly beside `=` destructures; within any other operand a variable is only used.
        left, right = (
            self.cell(side, scope if operator == "=" and isinstance(side, ListTerm) else scope.using())
            for side in (expression.left, expression.right)
        )
        if operator in {"&&", "||"}:
            for side, cell in ((expression.left, left), (expression.right, right)):
                self._demands.truth(side, cell, f"`{operator}` needs Booleans")
            return TypeCell(BOOL, expression.span)
        if operator in {"=", "!=", "<", "<=", ">", ">="}:
            if operator == "=":
                self._equation(expression.left, left, right, scope)
                self._equation(expression.right, right, left, scope)
            self._demands.later(lambda: self._compare(expression, left, right))
            return TypeCell(BOOL, expression.span)
        return self._arithmetic(expression, left, right)

    def _equation(self, side: Expression, cell: TypeCell, other: TypeCell, scope: TypeScope) -> None:
        """Add the flow from the other side of an equation, if this side may be bound by it."""
        if isinstance(side, ListTerm) or (isinstance(side, Variable) and side.name in scope.given):
            self._solver.flow(other, cell)
        elif isinstance(side, Variable):
            self._solver.fall_back(other, cell)

    def _compare(self, expression: Binary, left: TypeCell, right: TypeCell) -> None:
        operator = expression.operator
        if not compatible(left.type, right.type):
            message = f"`{operator}` compares {described(left.type)} with {described(right.type)}"
            hint = literal_hint(expression.left, right.type) or literal_hint(expression.right, left.type)
            self._demands.contradiction(message, expression.span, left, right, hint=hint)
        elif operator not in {"=", "!="}:
            sides = ((expression.left, left), (expression.right, right))
            self._demands.order_now(f"`{operator}`", f"id(A) {operator} id(B)", *sides)

    def _arithmetic(self, expression: Binary, left: TypeCell, right: TypeCell) -> TypeCell:
        operator = expression.operator
        cell = TypeCell(FLOAT if operator == "/" else OPEN, expression.span, fixed=operator == "/")
        if operator == "/":
            self.divisions.add(expression.span)
        self._solver.flow(left, cell)
        self._solver.flow(right, cell)
        if operator == "+":
            self._demands.later(lambda: self._add(expression, left, right))
            return cell
        for side, operand in ((expression.left, left), (expression.right, right)):
            self._demands.number(side, operand, f"`{operator}` needs numbers")
        return cell

    def _add(self, expression: Binary, left: TypeCell, right: TypeCell) -> None:
        if {Base.LIST, Base.STRING} & {left.kind.base, right.kind.base}:
            self.lists.joined(expression, left, right)
        else:
            for side, operand in ((expression.left, left), (expression.right, right)):
                self._demands.number_now(side, operand, "`+` needs numbers")

    # ---- functions

    def _call(self, call: Call, scope: TypeScope) -> TypeCell:
        name = call.name.text
        if name in self.own:
            return self._own(call, self.own[name], scope)
        wanted = _arity(name)
        if wanted is None:
            self._unknown(call)
            return TypeCell(OPEN, None)
        cells = [self.cell(argument, scope.using()) for argument in call.arguments]
        if len(cells) != wanted:
            message = f"the function `{name}` has {wanted} arguments, here it is given {len(cells)}"
            self._found.report("E011", message, call.span)
            of_list = name == "if" or CALLABLE[name].list_at is not None
            return TypeCell(OPEN if of_list else RESULTS[CALLABLE[name].gives], call.span)
        if name == "if":
            return self._conditional(call, cells)
        function = CALLABLE[name]
        return self._plain(function, call, cells) if function.list_at is None else self.lists.call(call, cells)

    def function(self, item: FunctionItem) -> None:
        """Add the constraints of the definition of a function."""
        cells = self.own.get(item.name.text)
        if cells is None or cells.item is not item:
            return  # wrongly named, or defined twice
        named = zip(item.parameters, cells.parameters, strict=True)
        scope = TypeScope({each.variable.name: cell for each, cell in named}, {})
        value = self.cell(item.body, scope)
        self._solver.flow(value, cells.result)
        if isinstance(item.body, Variable | ListTerm):
            self._solver.fall_back(cells.result, value)
        self._passed(item.body, value, cells.result, f"`{item.name.text}` gives")

    def _own(self, call: Call, cells: FunctionCells, scope: TypeScope) -> TypeCell:
        """Return the cell of a call of a function of the program."""
        name = call.name.text
        given = [self.cell(argument, scope.using()) for argument in call.arguments]
        result = TypeCell(OPEN, None)
        self._solver.flow(cells.result, result)
        if len(given) != len(cells.parameters):
            wanted = counted(len(cells.parameters), "argument")
            message = f"the function `{name}` has {wanted}, here it is given {len(given)}"
            notes = (DiagnosticNote(cells.item.name.span, "defined here"),)
            self._found.report("E011", message, call.span, notes=notes)
            return result
        for argument, cell, parameter in zip(call.arguments, given, cells.parameters, strict=True):
            self._solver.flow(cell, parameter)
            if isinstance(argument, Variable | ListTerm):
                self._solver.fall_back(parameter, cell)
            self._passed(argument, cell, parameter, f"this argument of `{plain_name(name)}` is")
        return result

    def _passed(self, expression: Expression, cell: TypeCell, target: TypeCell, what: str) -> None:
        """Demand that the value of an expression can be assigned to a parameter or result."""

        def check() -> None:
            if not fits(cell.type, target.type):
                message = f"{what} {described(target.type)}, here it is {described(cell.type)}"
                self._demands.contradiction(message, expression.span, target, cell)

        self._demands.later(check)

    def _plain(self, function: Function, call: Call, cells: list[TypeCell]) -> TypeCell:
        """Return the cell of a call of a function that takes no list."""
        kind = RESULTS[function.gives]
        result = TypeCell(kind, call.span, fixed=kind.base is not Base.OPEN)
        for argument, cell, takes in zip(call.arguments, cells, function.takes, strict=True):
            self._solver.flow(cell, result)
            if takes is Takes.ROBOT:
                self._demands.robot(argument, cell, f"`{function.name}` needs a robot")
            elif takes is Takes.INT:
                self._demands.whole(argument, cell, f"`{function.name}` needs an int")
            else:
                self._demands.number(argument, cell, f"`{function.name}` needs numbers")
        return result

    def _conditional(self, call: Call, cells: list[TypeCell]) -> TypeCell:
        result = TypeCell(OPEN, None)
        condition, then, otherwise = cells
        self._demands.truth(call.arguments[0], condition, "the condition of `if` is a Boolean")
        self._solver.flow(then, result)
        self._solver.flow(otherwise, result)

        def check() -> None:
            if not compatible(then.type, otherwise.type):
                message = f"`if` gives {described(then.type)} or {described(otherwise.type)}"
                self._demands.contradiction(message, call.span, then, otherwise)

        self._demands.later(check)
        return result

    def _unknown(self, call: Call) -> None:
        name = call.name.text
        hint = None if self._found.many else meant(name, [*CALLABLE, *self._names.functions, "if"])
        if name in self._names.signatures:
            hint = f"`{name}(...)` is a fact where it stands alone, between commas and without parentheses"
        self._found.report("E015", f"there is no function `{name}`", call.name.span, hint=hint)


def _arity(function: str) -> int | None:
    if function == "if":
        return 3
    return CALLABLE[function].arity if function in CALLABLE else None
