"""Constant folding: evaluation of constant expressions at compile time.

The functions are those of the virtual machine, so that folding never changes a result. An expression is folded only if
its types agree: contradictions are reported by inference, which needs the unfolded expression. An expression without a
value (`1 / 0`, an int beyond 64 bits) stays in place and is recorded.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace

from rmr.base.record import record
from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.arithmetic import BINARY, UNARY, NoValue, OutOfRange, built
from rmr.bytecode.functions import Takes
from rmr.bytecode.functions import call as called
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Base, Type
from rmr.lang.analyse.let_lifting import Lifter
from rmr.lang.analyse.types import (
    BOOL,
    CALLABLE,
    INT,
    NUMBERS,
    OPEN,
    ROBOT,
    SORTED,
    compatible,
    converted,
    join,
    value_type,
)
from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import Binary, Call, Expression, LetTerm, ListTerm, Literal, Unary, Variable

INSTRUCTIONS = {
    "+": Op.ADD,
    "-": Op.SUB,
    "*": Op.MUL,
    "/": Op.DIV,
    "%": Op.MOD,
    "=": Op.EQ,
    "!=": Op.NE,
    "<": Op.LT,
    "<=": Op.LE,
    ">": Op.GT,
    ">=": Op.GE,
}
"""Instructions of the strict operators; `&&` and `||` compile to jumps instead."""


@record
class Valueless:
    """An expression that never has a value."""

    span: Span
    reason: str
    out_of_range: bool
    """True for overflow: the number does not fit into 64 bits."""


class Folder:
    """Folds expressions under the constants `named`."""

    def __init__(
        self, named: Mapping[Symbol, Literal], lifter: Lifter | None = None, own: Collection[str] = ()
    ) -> None:
        """`own` are the names of the program's functions, which hide those of the language."""
        self._own = own
        self._named = named
        self._lifter = lifter or Lifter()
        self.valueless: list[Valueless] = []
        """Innermost expressions without a value, in the order of the text."""

    def fold(self, expression: Expression) -> Expression:
        """Return `expression` with its constant parts evaluated; the recursion is bounded by the parser."""
        if isinstance(expression, Variable):
            return expression
        if isinstance(expression, Literal):
            named = self._named.get(expression.value) if isinstance(expression.value, Symbol) else None
            return expression if named is None else Literal(named.value, expression.span)
        if isinstance(expression, LetTerm):
            values = [(each.variable, self.fold(each.value)) for each in expression.bindings]
            return self._lifter.lifted(values, self.fold(expression.body), expression.span)
        before = _operands(expression)
        after = [self.fold(each) for each in before]
        if any(one is not other for one, other in zip(before, after, strict=True)):
            expression = _with_operands(expression, after)
        # Tested before the operands: `X / 0` has no value for any X.
        if _divides_by_zero(expression):
            self.valueless.append(Valueless(expression.span, "division by zero", out_of_range=False))
            return expression
        if isinstance(expression, Call) and expression.name.text in self._own:
            return expression
        constants = [each.value for each in after if isinstance(each, Literal)]
        if len(constants) < len(after) or not _agrees(expression, constants):
            return expression
        try:
            return Literal(_widened(expression, constants), expression.span)
        except NoValue as reason:
            self.valueless.append(Valueless(expression.span, str(reason), isinstance(reason, OutOfRange)))
            return expression


def _divides_by_zero(expression: Expression) -> bool:
    """Whether the divisor is the constant 0."""
    match expression:
        case Binary(operator="/" | "%", right=Literal(value=int() | float() as value)):
            return not isinstance(value, bool | Robot) and value == 0
        case _:
            return False


Compound = Unary | Binary | Call | ListTerm


def _operands(expression: Compound) -> tuple[Expression, ...]:
    match expression:
        case Unary(operand=operand):
            return (operand,)
        case Binary(left=left, right=right):
            return (left, right)
        case Call(arguments=arguments):
            return arguments
        case ListTerm(items=items, rest=rest):
            return items if rest is None else (*items, rest)


def _with_operands(expression: Compound, operands: list[Expression]) -> Compound:
    match expression:
        case Unary():
            return replace(expression, operand=operands[0])
        case Binary():
            return replace(expression, left=operands[0], right=operands[1])
        case Call():
            return replace(expression, arguments=tuple(operands))
        case ListTerm(rest=rest):
            items, behind = (operands, None) if rest is None else (operands[:-1], operands[-1])
            return replace(expression, items=tuple(items), rest=behind)


def _widened(expression: Compound, values: list[Value]) -> Value:
    """Return the value for operands whose types agree, converted as inference would type it. Raises NoValue."""
    value = _value(expression, values)
    match expression:
        case Call(name=name) if name.text == "if":
            return converted(value, join(value_type(values[1]), value_type(values[2])))
        case Unary() | Binary() | Call() | ListTerm():
            return converted(value, value_type(value)) if isinstance(value, tuple) else value


def _value(expression: Compound, values: list[Value]) -> Value:
    """Return the value for operands whose types agree. Raises NoValue."""
    match expression:
        case Unary(operator=operator):
            return UNARY[Op.NOT if operator == "not" else Op.NEG](values[0])
        case Binary(operator="&&"):
            return values[0] and values[1]
        case Binary(operator="||"):
            return values[0] or values[1]
        case Binary(operator=operator):
            return BINARY[INSTRUCTIONS[operator]](*values)
        case Call(name=name) if name.text == "if":
            return values[1] if values[0] else values[2]
        case Call(name=name):
            return called(name.text, values, 0)
        case ListTerm(rest=rest):
            if rest is None:
                return built(tuple(values))
            assert isinstance(values[-1], tuple)
            return built((*values[:-1], *values[-1]))


# ---- type check of constant operands


def _agrees(expression: Compound, values: list[Value]) -> bool:
    """Whether constant operands have the types that the expression requires."""
    kinds = [value_type(value) for value in values]
    match expression:
        case Unary(operator=operator):
            return kinds[0] == BOOL if operator == "not" else kinds[0].base in NUMBERS
        case Binary(operator=operator):
            return _operator_agrees(operator, *kinds)
        case Call(name=name):
            return _function_agrees(name.text, kinds)
        case ListTerm(rest=rest):
            items = kinds if rest is None else kinds[:-1]
            whole = value_type(tuple(values)) if rest is None else kinds[-1]
            return whole.base is Base.LIST and all(_is_item(kind, whole) for kind in items) and _alike(items)


def _alike(kinds: list[Type]) -> bool:
    return all(compatible(kinds[0], kind) for kind in kinds)


def _is_item(kind: Type, whole: Type) -> bool:
    return compatible(Type(Base.LIST, element=kind), whole)


def _operator_agrees(operator: str, left: Type, right: Type) -> bool:
    bases = {left.base, right.base}
    if operator in {"&&", "||"}:
        return bases == {Base.BOOL}
    if operator in {"=", "!="}:
        return compatible(left, right)
    if operator == "+" and bases <= {Base.STRING, Base.LIST}:
        return compatible(left, right)
    return bases <= NUMBERS or (operator in {"<", "<=", ">", ">="} and bases == {Base.STRING})


def _function_agrees(name: str, kinds: list[Type]) -> bool:
    if name == "if" and len(kinds) == 3:
        condition, then, otherwise = kinds
        return condition == BOOL and compatible(then, otherwise)
    function = CALLABLE.get(name)
    if function is None or function.timed or function.drawn or len(kinds) != function.arity:
        return False
    whole = kinds[function.list_at] if function.list_at is not None else OPEN
    return all(_takes(takes, kind, whole) for takes, kind in zip(function.takes, kinds, strict=True))


def _takes(takes: Takes, kind: Type, whole: Type) -> bool:
    """Whether an argument may be of type `kind` where the list argument is of type `whole`."""
    match takes:
        case Takes.NUMBER:
            return kind.base in NUMBERS
        case Takes.ROBOT:
            return kind == ROBOT
        case Takes.LIST:
            return kind.base is Base.LIST
        case Takes.LIST_OR_STRING:
            return kind.base in {Base.LIST, Base.STRING}
        case Takes.SORTABLE_LIST:
            return kind.base is Base.LIST and kind.element is not None and kind.element.base in SORTED
        case Takes.POSITION | Takes.INT:
            return kind == INT
        case Takes.ITEM:
            return _is_item(kind, whole)
