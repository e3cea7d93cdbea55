"""Types: what declarations fix, what uses fix, and where the two contradict each other.

Every argument of a predicate and every variable of a rule is a cell. Types flow forward along the program (a
constant into an argument, an argument into a variable, an expression into a head) and only ever widen: open,
then int, then float; a symbol of no particular set, then of a set. What is open after that takes its type
from where its value goes. Declared cells never change. Contradictions are looked for at the end, against the
final types, so that each is reported once and with both places.
"""

from collections.abc import Callable

from rmr.base.values import Symbol
from rmr.bytecode.program import Base, Type
from rmr.lang.diagnostic import Diagnostics, Note
from rmr.lang.names import Names, Signature, meant
from rmr.lang.provided import type_text
from rmr.lang.solve import Solver
from rmr.lang.source import Span
from rmr.lang.syntax import (
    Aggregate,
    Assertion,
    Binary,
    Call,
    Comprehension,
    Condition,
    Conjunct,
    Expression,
    Fact,
    FactItem,
    GoalItem,
    HeadItem,
    ListTerm,
    Literal,
    Module,
    Rule,
    Steps,
    TypeDeclaration,
    Unary,
    Variable,
)
from rmr.lang.types import (
    BOOL,
    FLOAT,
    FUNCTIONS,
    LATER,
    NUMBERS,
    OPEN,
    ORDERED,
    ROBOT,
    SYMBOL,
    Cell,
    Scope,
    Types,
    compatible,
    constants,
    described,
    fits,
    literal_type,
    matched_variables,
)


class Inference:
    """One program's constraints, their solution and what contradicts it."""

    def __init__(self, names: Names, broken: frozenset[str], found: Diagnostics) -> None:
        self._names = names
        self._broken = broken
        self._found = found
        self._solver = Solver()
        self._matching: frozenset[str] = frozenset()
        self._constants: dict[str, Literal] = {}
        self._checks: list[Callable[[], None]] = []
        self.types = Types()
        for signature in names.signatures.values():
            self.types.positions[signature.name] = self._positions(signature)

    def run(self, module: Module) -> Types:
        """Infer, check, report; return the types."""
        for item in module.items:
            self._item(item)
        self._solver.solve()
        self._name_provided_sets()
        for check in self._checks:
            check()
        return self.types

    # ---- cells

    @staticmethod
    def _positions(signature: Signature) -> list[Cell]:
        owner = Cell(ROBOT, signature.place, fixed=True)
        declared = signature.declaration
        cells = [owner]
        for index, kind in enumerate(signature.types, start=1):
            if declared is not None:
                cells.append(Cell(kind, declared.parameters[index].span, fixed=True))
            elif kind.base is Base.SYMBOL:
                cells.append(Cell(SYMBOL, signature.place))
            else:
                cells.append(Cell(kind, signature.place, fixed=kind.base is not Base.OPEN))
        return cells

    def _name_provided_sets(self) -> None:
        """What is provided is not declared: its symbols are of the program's own sets where it has any."""
        for signature in self._names.signatures.values():
            cells = self.types.positions[signature.name][1:]
            for cell, kind in zip(cells, signature.types, strict=True):
                if cell.type == SYMBOL and kind.base is Base.SYMBOL:
                    cell.type = kind

    # ---- items

    def _item(self, item: object) -> None:
        match item:
            case FactItem(fact=fact) | GoalItem(fact=fact):
                self._derived(fact, {})
            case TypeDeclaration():
                self._effects(item)
            case Rule():
                scope: Scope = {}
                self.types.scopes[item.span] = scope
                self._matching, self._constants = frozenset(), {}
                self._body(item.body, scope)
                for part in item.head:
                    self._head(part, scope)
            case Assertion():
                self._assertion(item)
            case _:
                pass

    def _effects(self, item: TypeDeclaration) -> None:
        scope: Scope = {}
        self.types.scopes[item.span] = scope
        cells = self.types.positions[item.name.text]
        for parameter, cell in zip(item.parameters, cells, strict=False):
            if parameter.variable is not None and not parameter.variable.anonymous:
                self._solver.flow(cell, self._variable(parameter.variable, scope))
        for effect in (*item.effects, *item.else_effects):
            self._derived(effect, scope)

    def _assertion(self, item: Assertion) -> None:
        self._matching, self._constants = frozenset(), {}
        scope: Scope = {}
        self.types.scopes[item.span] = scope
        self._matched(item.start, scope)
        self._matched(item.finish, scope)
        deadline = self._expression(item.deadline, scope)
        self._needs_number(item.deadline, deadline, "a deadline is a number of seconds")
        self._derived(item.violation, scope)

    def _head(self, part: HeadItem, scope: Scope) -> None:
        match part:
            case Fact():
                self._derived(part, scope)
            case Steps(derived=derived):
                for fact in derived:
                    self._derived(fact, scope)
            case Comprehension():
                inner = dict(scope)
                self.types.scopes[part.span] = inner
                for variable in part.variables:
                    inner[variable.name] = Cell(OPEN, None)
                self._body(part.body, inner)
                for fact in part.head:
                    self._derived(fact, inner)
            case Aggregate():
                pass

    def _body(self, body: tuple[Conjunct, ...], scope: Scope) -> None:
        self._matching = matched_variables(body) | self._matching
        self._constants = constants(body) | self._constants
        for conjunct in body:
            if isinstance(conjunct, Condition):
                cell = self._expression(conjunct.expression, scope)
                self._needs(conjunct.expression, cell, BOOL, "E022", "a condition is a Boolean")
            else:
                self._matched(conjunct, scope)

    # ---- facts

    def _matched(self, fact: Fact, scope: Scope) -> None:
        for argument, position in zip(fact.arguments, self.types.positions[fact.name.text], strict=False):
            cell = self._expression(argument, scope)
            if isinstance(argument, Variable):
                self._solver.flow(position, cell)
                self._solver.fall_back(cell, position)
                constant = self._constants.get(argument.name)
                if constant is not None:
                    self._solver.flow(Cell(literal_type(constant), constant.span), position)
            elif isinstance(argument, Literal):
                self._solver.flow(cell, position)
            self._compare(fact, argument, cell, position, fits if isinstance(argument, Literal) else compatible)

    def _derived(self, fact: Fact, scope: Scope) -> None:
        for argument, position in zip(fact.arguments, self.types.positions[fact.name.text], strict=False):
            cell = self._expression(argument, scope)
            self._solver.flow(cell, position)
            if isinstance(argument, Variable):
                self._solver.fall_back(position, cell)
            self._compare(fact, argument, cell, position, fits)

    def _compare(
        self, fact: Fact, argument: Expression, cell: Cell, position: Cell, good: Callable[[Type, Type], bool]
    ) -> None:
        name = fact.name.text
        owner = position is self.types.positions[name][0]

        def check() -> None:
            if good(cell.type, position.type):
                return
            if name in self._broken and not position.fixed:
                return
            code = "E021" if owner else "E020"
            what = f"the first argument of `{name}`" if owner else f"this argument of `{name}`"
            message = f"{what} is {described(position.type)}, here it is {described(cell.type)}"
            cells = (cell,) if owner else (position, cell)
            self._found.report(code, message, argument.span, notes=self._notes(argument.span, *cells))

        self._checks.append(check)

    @staticmethod
    def _notes(span: Span, *cells: Cell) -> tuple[Note, ...]:
        notes: list[Note] = []
        for cell in cells:
            if cell.origin is not None and cell.origin != span and all(note.span != cell.origin for note in notes):
                notes.append(Note(cell.origin, f"{type_text(cell.type)} because of this"))
        return tuple(notes)

    # ---- expressions

    def _variable(self, variable: Variable, scope: Scope) -> Cell:
        if variable.anonymous:
            return Cell(OPEN, None)
        return scope.setdefault(variable.name, Cell(OPEN, None))

    def _expression(self, expression: Expression, scope: Scope) -> Cell:
        match expression:
            case Literal():
                cell = Cell(literal_type(expression), expression.span)
            case Variable():
                cell = self._variable(expression, scope)
            case Unary():
                cell = self._unary(expression, scope)
            case Binary():
                cell = self._binary(expression, scope)
            case Call():
                cell = self._call(expression, scope)
            case ListTerm():
                cell = Cell(OPEN, None)
        self.types.expressions[expression.span] = cell
        return cell

    def _unary(self, expression: Unary, scope: Scope) -> Cell:
        operand = self._expression(expression.operand, scope)
        if expression.operator == "not":
            self._needs(expression.operand, operand, BOOL, "E022", "`not` needs a Boolean")
            return Cell(BOOL, expression.span)
        self._needs_number(expression.operand, operand, "`-` needs a number")
        cell = Cell(OPEN, None)
        self._solver.flow(operand, cell)
        return cell

    def _binary(self, expression: Binary, scope: Scope) -> Cell:
        left = self._expression(expression.left, scope)
        right = self._expression(expression.right, scope)
        operator = expression.operator
        if operator in {"&&", "||"}:
            for side, cell in ((expression.left, left), (expression.right, right)):
                self._needs(side, cell, BOOL, "E022", f"`{operator}` needs Booleans")
            return Cell(BOOL, expression.span)
        if operator in {"=", "!=", "<", "<=", ">", ">="}:
            return self._comparison(expression, left, right)
        return self._arithmetic(expression, left, right)

    def _comparison(self, expression: Binary, left: Cell, right: Cell) -> Cell:
        if expression.operator == "=":
            for side, cell, other in ((expression.left, left, right), (expression.right, right, left)):
                if isinstance(side, Variable):
                    (self._solver.fall_back if side.name in self._matching else self._solver.flow)(other, cell)

        def check() -> None:
            span, operator = expression.span, expression.operator
            if not compatible(left.type, right.type):
                message = f"`{operator}` compares {described(left.type)} with {described(right.type)}"
                self._found.report("E020", message, span, notes=self._notes(span, left, right))
            elif operator not in {"=", "!="}:
                self._needs_order(expression, left, right)

        self._checks.append(check)
        return Cell(BOOL, expression.span)

    def _needs_order(self, expression: Binary, left: Cell, right: Cell) -> None:
        for side, cell in ((expression.left, left), (expression.right, right)):
            if cell.type.base in ORDERED:
                continue
            robots = cell.type == ROBOT
            hint = "robots have no order, their numbers do: `id(A) < id(B)`" if robots else None
            message = f"`{expression.operator}` needs numbers or strings, this is {described(cell.type)}"
            self._found.report("E020", message, side.span, hint=hint, notes=self._notes(side.span, cell))
            return

    def _arithmetic(self, expression: Binary, left: Cell, right: Cell) -> Cell:
        operator = expression.operator
        cell = Cell(FLOAT if operator == "/" else OPEN, expression.span, fixed=operator == "/")
        self._solver.flow(left, cell)
        self._solver.flow(right, cell)

        def check() -> None:
            kinds = [left.type.base, right.type.base]
            if operator == "+" and set(kinds) <= {Base.STRING, Base.OPEN}:
                return
            for side, operand in ((expression.left, left), (expression.right, right)):
                if operand.type.base not in NUMBERS | {Base.OPEN}:
                    message = f"`{operator}` needs numbers, this is {described(operand.type)}"
                    self._found.report("E020", message, side.span, notes=self._notes(side.span, operand))

        self._checks.append(check)
        return cell

    def _call(self, call: Call, scope: Scope) -> Cell:
        name = call.name.text
        cells = [self._expression(argument, scope) for argument in call.arguments]
        if name == "if":
            return self._conditional(call, cells)
        if name in LATER:
            return Cell(OPEN, None)
        known = FUNCTIONS.get(name)
        if known is None:
            self._unknown_function(call)
            return Cell(OPEN, None)
        if len(cells) != len(known.arguments):
            self._wrong_count(call, len(known.arguments))
            return Cell(known.result, call.span)
        result = Cell(known.result, call.span, fixed=known.result.base is not Base.OPEN)
        for argument, cell, wanted in zip(call.arguments, cells, known.arguments, strict=True):
            self._solver.flow(cell, result)
            if wanted is ROBOT:
                self._needs(argument, cell, ROBOT, "E021", f"`{name}` needs a robot")
            else:
                self._needs_number(argument, cell, f"`{name}` needs numbers")
        return result

    def _conditional(self, call: Call, cells: list[Cell]) -> Cell:
        result = Cell(OPEN, None)
        if len(cells) != 3:
            self._wrong_count(call, 3)
            return result
        self._needs(call.arguments[0], cells[0], BOOL, "E022", "the condition of `if` is a Boolean")
        self._solver.flow(cells[1], result)
        self._solver.flow(cells[2], result)

        def check() -> None:
            if not compatible(cells[1].type, cells[2].type):
                message = f"`if` gives {described(cells[1].type)} or {described(cells[2].type)}"
                self._found.report("E020", message, call.span, notes=self._notes(call.span, cells[1], cells[2]))

        self._checks.append(check)
        return result

    def _wrong_count(self, call: Call, wanted: int) -> None:
        message = f"the function `{call.name.text}` has {wanted} arguments, here it is given {len(call.arguments)}"
        self._found.report("E011", message, call.span)

    def _unknown_function(self, call: Call) -> None:
        name = call.name.text
        hint = None if self._found.many else meant(name, [*FUNCTIONS, *LATER, "if"])
        if name in self._names.signatures:
            hint = f"`{name}(...)` is a fact where it stands alone, between commas and without parentheses"
        self._found.report("E015", f"there is no function `{name}`", call.name.span, hint=hint)

    # ---- what an expression must be

    def _needs(self, expression: Expression, cell: Cell, wanted: Type, code: str, message: str) -> None:
        def check() -> None:
            if compatible(cell.type, wanted):
                return
            hint = None
            if isinstance(expression, Literal) and isinstance(expression.value, Symbol) and wanted is BOOL:
                hint = f"a fact names its owner: `{expression.value}(R)`"
            text = f"{message}, this is {described(cell.type)}"
            notes = self._notes(expression.span, cell)
            self._found.report(code, text, expression.span, hint=hint, notes=notes)

        self._checks.append(check)

    def _needs_number(self, expression: Expression, cell: Cell, message: str) -> None:
        def check() -> None:
            if cell.type.base not in NUMBERS | {Base.OPEN}:
                notes = self._notes(expression.span, cell)
                self._found.report("E020", f"{message}, this is {described(cell.type)}", expression.span, notes=notes)

        self._checks.append(check)
