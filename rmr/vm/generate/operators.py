"""Code generation for operators, specialised by the abstract values of the operands.

Where the types are known, the operator is written in line with the checks that remain. Otherwise, and for a result
without value, the source calls the function that the interpreter calls, so values and messages are the same.
"""

from rmr.base.values import INT_MAX, INT_MIN, Robot, Symbol
from rmr.bytecode import arithmetic
from rmr.bytecode.conform import LENGTH_MAX, NUMBERS, comparable
from rmr.bytecode.functions import FLOAT_MAX
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Base, Type
from rmr.vm.generate.form import Equality
from rmr.vm.generate.known import (
    BOOL,
    FLOAT,
    INT,
    NOTHING,
    RESULTS,
    Bounds,
    Known,
    common,
    different,
    negative,
    nonzero,
    quotient,
    remainder,
    within,
)
from rmr.vm.generate.source import Pool, Source, fails

SIGNS = {
    Op.ADD: "+",
    Op.SUB: "-",
    Op.MUL: "*",
    Op.DIV: "/",
    Op.MOD: "%",
    Op.EQ: "==",
    Op.NE: "!=",
    Op.LT: "<",
    Op.LE: "<=",
    Op.GT: ">",
    Op.GE: ">=",
}

CLASSES: dict[Base, tuple[str, type]] = {
    Base.ROBOT: ("Robot", Robot),
    Base.BOOL: ("bool", bool),
    Base.STRING: ("str", str),
    Base.SYMBOL: ("Symbol", Symbol),
}
"""Types whose values are equal only to values of the same type: their Python classes, by name."""

DISTINCT = (int, Symbol, Robot)
"""Types of constants with exact equality: an expression equals at most one of them, so it can select among cases."""


def binary(op: Op, left: Source, right: Source, pool: Pool) -> Source:
    """Return an operator of two operands."""
    if op in (Op.EQ, Op.NE):
        return _equal(op, left, right, pool)
    if op in (Op.LT, Op.LE, Op.GT, Op.GE):
        return _ordered(op, left, right, pool)
    if left.known.base in NUMBERS and right.known.base in NUMBERS:
        if op in RESULTS:
            bounds = RESULTS[op](left.known.bounds, right.known.bounds)
            text = f"{left.text} {SIGNS[op]} {right.text}"
            return in_range(text, kind_of(left, right), bounds, left, right, pool=pool)
        return _division(op, left, right, pool)
    if op is Op.ADD and left.known.base is right.known.base is Base.LIST:
        return _joined(left, right, pool)
    return _by_function(op, left, right, pool)


def unary(op: Op, operand: Source, pool: Pool) -> Source:
    """Return an operator of one operand."""
    if op is Op.NOT:
        condition = truth(operand, pool)
        return Source(f"(not {condition.text})", BOOL, condition.fails)
    if op is Op.FLOAT:
        return _float(operand, pool)
    known = operand.known
    if known.type is not None and known.base in NUMBERS:
        return in_range(f"-{operand.text}", known.type, negative(known.bounds), operand, pool=pool)
    return Source(f"{pool.helper('negate', arithmetic.UNARY[op])}({operand.text})", NOTHING, True)


def truth(condition: Source, pool: Pool) -> Source:
    """Return a condition that is certainly a Boolean or has no value."""
    if condition.known.base is Base.BOOL:
        return condition
    return Source(f"{pool.helper('truth', arithmetic.truth)}({condition.text})", BOOL, True)


def listed(items: list[Source], pool: Pool) -> Source:
    """Return a list of `items`."""
    kind = items[0].known.type if items else None
    for item in items:
        kind = None if kind is None or item.known.type is None else common(kind, item.known.type)
    text = f"({''.join(f'{item.text}, ' for item in items).rstrip()})"
    known = within(Type(Base.LIST, element=kind), (len(items), len(items)))
    if all(_is_flat(item.known.type) for item in items):
        return Source(text, known, fails(*items))
    return Source(f"{pool.helper('built', arithmetic.built)}({text})", known, True)


def in_range(text: str, kind: Type, bounds: Bounds, *operands: Source, pool: Pool) -> Source:
    """Return the number `text` of type `kind`, checked unless it is known to be in range."""
    known = within(kind, bounds)
    lowest, highest = (-FLOAT_MAX, FLOAT_MAX) if kind.base is Base.FLOAT else (INT_MIN, INT_MAX)
    low = bounds[0] >= lowest
    high = bounds[1] <= highest
    if low and high:
        return Source(f"({text})", known, fails(*operands))
    name = pool.temporary()
    if kind.base is Base.FLOAT:
        # x - x is 0 for finite floats and NaN for infinite ones: the cheapest test without a call.
        test = f"({name} := {text}) - {name} == 0.0"
    elif low:
        test = f"({name} := {text}) <= {INT_MAX}"
    elif high:
        test = f"({name} := {text}) >= {INT_MIN}"
    else:
        test = f"{INT_MIN} <= ({name} := {text}) <= {INT_MAX}"
    return Source(f"({name} if {test} else {pool.helper('checked', arithmetic.checked)}({name}))", known, True)


def kind_of(*operands: Source) -> Type:
    """Return the type of a result of numbers: a float if one of them is."""
    return FLOAT if any(operand.known.base is Base.FLOAT for operand in operands) else INT


def _by_function(op: Op, left: Source, right: Source, pool: Pool) -> Source:
    """Return a call of the interpreter's function, after an in-line test for ints where the operands may be ints."""
    name = {Op.ADD: "add", Op.SUB: "subtract", Op.MUL: "multiply", Op.DIV: "divide", Op.MOD: "modulo"}[op]
    function = pool.helper(name, arithmetic.BINARY[op])
    ints = _if_ints(left, right, pool) if op in RESULTS else None
    if ints is None:
        text = f"{function}({left.text}, {right.text})"
    else:
        test, one, other = ints
        result = pool.temporary()
        bounded = f"{INT_MIN} <= ({result} := {one} {SIGNS[op]} {other}) <= {INT_MAX}"
        text = f"({result} if {test} and {bounded} else {function}({one}, {other}))"
    if op is Op.DIV or Base.FLOAT in (left.known.base, right.known.base):
        known = Known(FLOAT)
    elif left.known.base is right.known.base:
        known = Known(left.known.type)
    else:
        known = NOTHING
    return Source(text, known, True)


def _division(op: Op, left: Source, right: Source, pool: Pool) -> Source:
    """Return a quotient or remainder of numbers; a dividend that may fail does so before a divisor of zero."""
    whole = right.known.base is Base.INT
    if nonzero(right.known.bounds):
        return _divided(op, left, right, whole, pool)
    first = ""
    if left.fails:  # `is not None` is always true: it evaluates the dividend first
        dividend = pool.temporary()
        first = f"({dividend} := {left.text}) is not None and "
        left = Source(dividend, left.known, False)
    divisor, again = pool.held(right)
    divided = _divided(op, left, Source(again, right.known, False), whole, pool)
    by_zero = f"{pool.helper('divide', arithmetic.BINARY[Op.DIV])}(1, 0)"
    return Source(f"({divided.text} if {first}{divisor} else {by_zero})", divided.known, True)


def _divided(op: Op, left: Source, right: Source, whole: bool, pool: Pool) -> Source:
    text = f"{left.text} {SIGNS[op]} {right.text}"
    one = left.known.bounds
    other = right.known.bounds
    if op is Op.DIV:
        return in_range(text, FLOAT, quotient(one, other, whole=whole), left, right, pool=pool)
    kind = kind_of(left, right)
    bounds = remainder(one, other, whole=kind.base is Base.INT)
    return Source(f"({text})", within(kind, bounds), fails(left, right))


def _joined(left: Source, right: Source, pool: Pool) -> Source:
    """Return the concatenation of two lists; where items have no length of their own, only their number is checked."""
    one = left.known
    other = right.known
    assert one.type is not None
    assert other.type is not None
    low, high = RESULTS[Op.ADD](one.bounds, other.bounds)
    known = within(common(one.type, other.type) or Type(Base.LIST), (low, high))
    text = f"{left.text} + {right.text}"
    built = pool.helper("built", arithmetic.built)
    if not (_is_flat(one.element) and _is_flat(other.element)):
        return Source(f"{built}({text})", known, True)
    if high <= LENGTH_MAX:
        return Source(f"({text})", known, fails(left, right))
    name = pool.temporary()
    return Source(f"({name} if len({name} := {text}) <= {LENGTH_MAX} else {built}({name}))", known, True)


def _is_flat(kind: Type | None) -> bool:
    """Return whether values of `kind` have no characters or items that count."""
    return kind is not None and kind.base in (Base.ROBOT, Base.INT, Base.FLOAT, Base.BOOL)


def _if_ints(left: Source, right: Source, pool: Pool) -> tuple[str, str, str] | None:
    """Return a test that operands of open type are ints, and the text of each operand after the test; else None.

    Operands are evaluated in the order of the test, so the other one must be repeatable unless both are tested.
    """
    one = left.known.base
    other = right.known.base
    if one is Base.OPEN and other is Base.OPEN:
        first, again = pool.held(left)
        second, second_again = pool.held(right)
        return f"type({first}) is type({second}) is int", again, second_again
    if (one, other) == (Base.OPEN, Base.INT) and right.repeatable:
        first, again = pool.held(left)
        return f"type({first}) is int", again, right.text
    if (one, other) == (Base.INT, Base.OPEN) and left.repeatable:
        second, again = pool.held(right)
        return f"type({second}) is int", left.text, again
    return None


def _equal(op: Op, left: Source, right: Source, pool: Pool) -> Source:
    one = left.known.type or Type(Base.OPEN)
    other = right.known.type or Type(Base.OPEN)
    failing = fails(left, right)
    if comparable(one, other):
        equality = Equality(left.text, right.text) if op is Op.EQ and type(right.constant) in DISTINCT else None
        return Source(f"({left.text} {SIGNS[op]} {right.text})", BOOL, failing, equality=equality)
    if different(one, other) and not failing:
        return Source(str(op is Op.NE), BOOL, False, repeatable=True)
    return Source(_same(op, left, right, pool), BOOL, failing)


def _same(op: Op, left: Source, right: Source, pool: Pool) -> str:
    """Return the strict comparison of values, at least one of which is of open type."""
    # Against a class whose values equal no other class's, a test of the type makes Python's == strict.
    for wanted, unknown, flip in ((right, left, False), (left, right, True)):
        if wanted.known.base in CLASSES and unknown.known.base is Base.OPEN:
            first, again = pool.held(unknown)
            one, other = (wanted.text, first) if flip else (first, wanted.text)
            kind = pool.helper(*CLASSES[wanted.known.base])
            if op is Op.NE:
                return f"({one} != {other} or type({again}) is not {kind})"
            return f"({one} == {other} and type({again}) is {kind})"
    text = f"{pool.helper('same', arithmetic.same)}({left.text}, {right.text})"
    return f"(not {text})" if op is Op.NE else text


def _ordered(op: Op, left: Source, right: Source, pool: Pool) -> Source:
    one = left.known.base
    other = right.known.base
    if (one in NUMBERS and other in NUMBERS) or one is other is Base.STRING:
        return Source(f"({left.text} {SIGNS[op]} {right.text})", BOOL, fails(left, right))
    name = {Op.LT: "less", Op.LE: "at_most", Op.GT: "greater", Op.GE: "at_least"}[op]
    function = pool.helper(name, arithmetic.BINARY[op])
    ints = _if_ints(left, right, pool)
    if ints is None:
        return Source(f"{function}({left.text}, {right.text})", BOOL, True)
    test, first, second = ints
    return Source(f"({first} {SIGNS[op]} {second} if {test} else {function}({first}, {second}))", BOOL, True)


def _float(operand: Source, pool: Pool) -> Source:
    """Return a number converted to float, or a list with its items converted."""
    known = operand.known
    kind = operand.known.type
    if kind is not None and _innermost(kind).base is Base.FLOAT:
        return operand
    if known.base is Base.INT:
        return Source(f"({operand.text} + 0.0)", within(FLOAT, known.bounds), operand.fails)
    if known.base is Base.LIST and known.element.base is Base.INT:
        text = f"tuple(map(float, {operand.text}))"
        return Source(text, within(Type(Base.LIST, element=FLOAT), known.bounds), operand.fails)
    return Source(f"{pool.helper('as_float', arithmetic.UNARY[Op.FLOAT])}({operand.text})", NOTHING, True)


def _innermost(kind: Type) -> Type:
    while kind.element is not None:
        kind = kind.element
    return kind
