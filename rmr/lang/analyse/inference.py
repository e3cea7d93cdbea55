"""Type inference: constraints from declarations and uses, their solution, and the contradictions between them.

A forward data-flow analysis over a lattice (see `types`). Every argument of a predicate and every variable of a rule
is a cell. Types flow forward (a constant into an argument, an argument into a variable, an expression into a head) and
only widen: open, then int, then float; a symbol of no particular set, then of a set; a list as its items. A cell still
open after that takes its type backwards, from the cells its value flows to. Declared cells never change.
Contradictions are searched at the end, against the final types: each is reported once, with both places.
"""

from collections.abc import Callable, Iterator

from rmr.bytecode.conform import NESTING_MAX
from rmr.bytecode.program import Base, Type
from rmr.lang.analyse.expression_types import Expressions, TypeScope
from rmr.lang.analyse.names import Names, Signature
from rmr.lang.analyse.solver import Solver
from rmr.lang.analyse.type_demands import Demands, literal_hint
from rmr.lang.analyse.types import (
    INT,
    LIST,
    OPEN,
    ROBOT,
    SYMBOL,
    WINNING,
    TypeCell,
    Types,
    cell_of,
    compatible,
    constants,
    described,
    fits,
    literal_cell,
    matched_variables,
)
from rmr.lang.diagnostics.diagnostic import Diagnostics
from rmr.lang.read.syntax import (
    AggregateNode,
    AssertionItem,
    Binary,
    ChoiceNode,
    ComprehensionNode,
    Condition,
    Conjunct,
    Expression,
    FactItem,
    FactNode,
    FoldNode,
    FunctionItem,
    GoalItem,
    HeadItem,
    ListTerm,
    Literal,
    ModuleNode,
    Parameter,
    RuleItem,
    StepsNode,
    TypeDeclaration,
    Variable,
    walk,
)


class Inference:
    """The type constraints of one program, collected item by item, then solved and checked."""

    def __init__(self, names: Names, broken: frozenset[str], found: Diagnostics) -> None:
        self._names = names
        self._broken = broken
        self._found = found
        self._solver = Solver()
        self._demands = Demands(found)
        self._expressions = Expressions(names, self._solver, self._demands, found)
        self.types = Types({}, self._expressions.cells)
        for signature in names.signatures.values():
            self.types.positions[signature.name] = self._positions(signature)

    def run(self, module: ModuleNode) -> Types:
        """Return the types of `module`; report contradictions."""
        for item in module.items:
            self._item(item)
        self._solver.solve()
        self._name_provided_sets()
        self._demands.check()
        self._expressions.lists.check()
        return self.types

    # ---- cells

    @staticmethod
    def _positions(signature: Signature) -> list[TypeCell]:
        owner = TypeCell(ROBOT, signature.place, fixed=True)
        declared = signature.declaration
        cells = [owner]
        # No owner declared (E021): its parameters may be shifted by one, and fixed types would add false errors.
        if declared is not None and declared.parameters and declared.parameters[0].type.name != "robot":
            return [*cells, *(TypeCell(OPEN, None) for _ in signature.types)]
        for index, kind in enumerate(signature.types, start=1):
            if declared is not None:
                cells.append(cell_of(kind, declared.parameters[index].span, fixed=True))
            elif kind.base is Base.SYMBOL:
                # A provided set is a default: it must not contradict the set that the program declares for its own.
                cells.append(TypeCell(SYMBOL, signature.place))
            else:
                cells.append(TypeCell(kind, signature.place, fixed=kind.base is not Base.OPEN))
        return cells

    def _name_provided_sets(self) -> None:
        """Give symbols of provided predicates their provided set where no set of the program's own reached them."""
        for signature in self._names.signatures.values():
            cells = self.types.positions[signature.name][1:]
            for cell, kind in zip(cells, signature.types, strict=True):
                if cell.kind == SYMBOL and kind.base is Base.SYMBOL:
                    cell.kind = kind

    # ---- items

    def _item(self, item: object) -> None:
        match item:
            case FactItem(fact=fact) | GoalItem(fact=fact):
                self._derived(fact, TypeScope({}, {}))
            case TypeDeclaration():
                self._declaration(item)
            case RuleItem():
                scope = TypeScope({}, {})
                self._body(item.body, scope)
                for part in item.head:
                    self._head(part, scope)
            case AssertionItem():
                self._assertion(item)
            case FunctionItem():
                self._expressions.function(item)
            case _:
                pass

    def _declaration(self, item: TypeDeclaration) -> None:
        scope = TypeScope({}, {})
        cells = self.types.positions[item.name.text]
        for parameter, cell in zip(item.parameters, cells, strict=False):
            self._shallow(parameter)
            if parameter.variable is not None and not parameter.variable.anonymous:
                self._solver.flow(cell, scope.variable(parameter.variable))
        for effect in (*item.effects, *item.else_effects):
            self._derived(effect, scope)

    def _shallow(self, parameter: Parameter) -> None:
        depth = 0
        kind = parameter.type.element
        while kind is not None:
            depth = depth + 1
            kind = kind.element
        if depth > NESTING_MAX:
            self._found.report("E004", f"lists are nested more than {NESTING_MAX} deep", parameter.type.span)

    def _assertion(self, item: AssertionItem) -> None:
        scope = TypeScope({}, {})
        self._matched(item.start, scope)
        self._matched(item.finish, scope)
        deadline = self._expressions.cell(item.deadline, scope)
        hint = "it is written `10`, `2s` or `500ms`"
        self._demands.number(item.deadline, deadline, "a deadline is a number of seconds", hint)
        self._derived(item.violation, scope)

    def _head(self, part: HeadItem, scope: TypeScope) -> None:
        match part:
            case FactNode():
                self._derived(part, scope)
            case StepsNode(derived=derived):
                for fact in derived:
                    self._derived(fact, scope)
            case ComprehensionNode():
                inner = scope.inner()
                for variable in part.variables:
                    inner.cells[variable.name] = TypeCell(OPEN, None)
                self._body(part.body, inner)
                for fact in part.head:
                    self._derived(fact, inner)
            case AggregateNode():
                self._aggregate(part, scope)
            case ChoiceNode(condition=condition, then=then, otherwise=otherwise):
                self._demands.truth(condition, self._expressions.cell(condition, scope.using()), "`if` needs a Boolean")
                for each in (*then, *otherwise):
                    self._head(each, scope)

    def _body(self, body: tuple[Conjunct, ...], scope: TypeScope) -> None:
        for name, constant in constants(body).items():
            scope.constants.setdefault(name, constant)
        # Three kinds of variables, the stronger binding first: matched by a fact, equated, taken out of a list.
        direct = matched_variables(body)
        given = frozenset(_equated(body)) - direct
        reading = TypeScope(scope.cells, scope.constants, given, frozenset(_listed(body)) - direct - given)
        for conjunct in body:
            if isinstance(conjunct, Condition):
                cell = self._expressions.cell(conjunct.expression, reading)
                self._demands.truth(conjunct.expression, cell, "a condition is a Boolean")
            elif isinstance(conjunct, FoldNode):
                inner = reading.inner()
                self._body(conjunct.body, inner)
                value = self._gathered(conjunct, inner)
                if conjunct.result is not None:
                    self._solver.flow(value, scope.variable(conjunct.result))
            else:
                self._matched(conjunct, reading)

    # ---- aggregates

    def _aggregate(self, part: AggregateNode, scope: TypeScope) -> None:
        inner = scope.inner()
        self._body(part.body, inner)
        result = self._gathered(part, inner)
        head = (inner if part.operator.text in WINNING else scope).inner()
        head.cells[part.result.name] = result
        for fact in part.head:
            self._derived(fact, head)

    def _gathered(self, part: AggregateNode | FoldNode, inner: TypeScope) -> TypeCell:
        """Return the cell of an aggregate's result."""
        operator = part.operator.text
        term = part.term
        each = TypeCell(OPEN, None) if term is None else self._expressions.cell(term, inner)
        if operator == "count":
            return TypeCell(INT, part.operator.span, fixed=True)
        result = value = TypeCell(OPEN, None, mixed=operator == "sum")  # the sum of no match is the int 0
        if operator == "collect":
            value = TypeCell(OPEN, None, depth=1)
            result = TypeCell(LIST, part.span, items=value)
            self._expressions.lists.makes(result, part.span)
        self._solver.flow(each, value)
        if isinstance(term, Variable):
            self._solver.fall_back(value, each)
        if term is not None and operator == "sum":
            hint = "`count` counts matches, `collect` lists values"
            self._demands.number(term, each, "`sum` adds numbers", hint)
        elif term is not None and operator in WINNING:
            example = f"{operator}(id(B), ...)"
            if isinstance(part, AggregateNode):
                example = f"[{operator} id(B) => {part.result.name} | ..."
            self._demands.later(lambda: self._demands.order_now(f"`{operator}`", example, (term, each)))
        return result

    # ---- facts

    def _matched(self, fact: FactNode, scope: TypeScope) -> None:
        for argument, position in zip(fact.arguments, self.types.positions[fact.name.text], strict=False):
            cell = self._expressions.cell(argument, scope)
            # Matching reads: the predicate's type flows into variables. Only constants, here and in equations, are
            # evidence of the predicate's type; any other expression is compared with it and nothing more.
            if isinstance(argument, Variable | ListTerm):
                self._solver.flow(position, cell)
                self._solver.fall_back(cell, position)
            elif isinstance(argument, Literal):
                self._solver.flow(cell, position)
            if isinstance(argument, Variable) and (constant := scope.constants.get(argument.name)) is not None:
                self._solver.flow(literal_cell(constant), position)
            self._compare(fact, argument, cell, position, fits if isinstance(argument, Literal) else compatible)

    def _derived(self, fact: FactNode, scope: TypeScope) -> None:
        for argument, position in zip(fact.arguments, self.types.positions[fact.name.text], strict=False):
            # Deriving writes: the argument's type flows into the predicate, and back only if the argument stays open.
            cell = self._expressions.cell(argument, scope)
            self._solver.flow(cell, position)
            if isinstance(argument, Variable | ListTerm):
                self._solver.fall_back(position, cell)
            self._compare(fact, argument, cell, position, fits)

    def _compare(
        self,
        fact: FactNode,
        argument: Expression,
        cell: TypeCell,
        position: TypeCell,
        good: Callable[[Type, Type], bool],
    ) -> None:
        name = fact.name.text
        owner = position is self.types.positions[name][0]

        def check() -> None:
            if good(cell.type, position.type):
                return
            # The declaration may be in text that did not parse: an inferred type proves nothing.
            if name in self._broken and not position.fixed:
                return
            code = "E021" if owner else "E020"
            what = f"the first argument of `{name}`" if owner else f"this argument of `{name}`"
            message = f"{what} is {described(position.type)}, here it is {described(cell.type)}"
            cells = (cell,) if owner else (position, cell)
            hint = literal_hint(argument, position.type) or self._float_hint(argument, cell, position)
            self._demands.contradiction(message, argument.span, *cells, code=code, hint=hint)

        self._demands.later(check)

    def _float_hint(self, argument: Expression, cell: TypeCell, position: TypeCell) -> str | None:
        """Return the hint for a float in the place of an int, or None."""
        if position.kind != INT or cell.kind.base is not Base.FLOAT:
            return None
        divides = any(isinstance(each, Binary) and each.operator == "/" for each in walk(argument))
        if divides or cell.origin in self._expressions.divisions:
            return "`/` gives a float; `floor(X / Y)` gives an int"
        return "`floor(X)` gives an int"


def _equated(body: tuple[Conjunct, ...]) -> Iterator[str]:
    """Yield the variables that are one whole side of an equation."""
    for side in _sides(body):
        if isinstance(side, Variable):
            yield side.name


def _listed(body: tuple[Conjunct, ...]) -> Iterator[str]:
    """Yield the variables in list patterns: sides of equations and arguments of positive facts."""
    stack: list[Expression] = [side for side in _sides(body) if isinstance(side, ListTerm)]
    for fact in body:
        if isinstance(fact, FactNode) and not fact.absent:
            stack += [argument for argument in fact.arguments if isinstance(argument, ListTerm)]
    while stack:
        part = stack.pop()
        if isinstance(part, Variable):
            yield part.name
        elif isinstance(part, ListTerm):
            stack += part.items
            stack += () if part.rest is None else (part.rest,)


def _sides(body: tuple[Conjunct, ...]) -> Iterator[Expression]:
    for conjunct in body:
        match conjunct:
            case Condition(expression=Binary("=", left, right)):
                yield from (left, right)
            case _:
                pass
