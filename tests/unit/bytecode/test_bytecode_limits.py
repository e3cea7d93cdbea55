"""What a program may have too much of, and which values and types there are."""

import pytest
from vm_hand import AREA, FLOAT, INT, OPEN, ROBOT, Hand, V, code, guard

from rmr.base.values import INT_MAX, INT_MIN, ROBOT_ID_MAX, Robot, Symbol
from rmr.bytecode import limits
from rmr.bytecode.codec import BytecodeError, encode
from rmr.bytecode.conform import LENGTH_MAX, NESTING_MAX, conforms, fits, sound
from rmr.bytecode.layout import SIZE_MAX
from rmr.bytecode.limits import Excess, exceeded
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Base, Effect, InitialFact, Rule, Serving, Type
from rmr.bytecode.verify import verify

STRING = Type(Base.STRING)
BOOL = Type(Base.BOOL)


def numbers(element: Type | None = INT) -> Type:
    return Type(Base.LIST, element=element)


def hand() -> Hand:
    made = Hand()
    made.temporary("p", INT)
    made.action("go")
    return made


LONG = code(1, *[1, Op.ADD] * limits.INSTRUCTIONS_MAX)

TOO_MUCH = {
    "arguments": lambda h: h.temporary("t", *[INT] * 256),
    "effects": lambda h: h.action("t", effects=(Effect(0, (code(1),)),) * 256),
    "variables": lambda h: h.rules.append(Rule(1025, (), ())),
    "items in the head": lambda h: h.rule([], [h.each([], [], [h.head(0, 1)] * 1024)]),
    "conjuncts in a body": lambda h: h.rule([], [h.each([], [guard(True)] * 257, [])]),
    "instructions in an expression": lambda h: h.rule([guard(*LONG)], []),
    "actions that serve it": lambda h: h.asserts(
        h.keep(0, V(1)), h.keep(0, V(2)), 1, h.head(1), serving=(Serving(1, ()),) * 1025
    ),
}


@pytest.mark.parametrize("what", TOO_MUCH)
def test_exceeded_program_limit_is_named_with_its_entry(what):
    made = hand()
    assert list(exceeded(made.program())) == []
    TOO_MUCH[what](made)
    (excess,) = exceeded(made.program())
    last = {"predicates": made.predicates, "rules": made.rules, "assertions": made.assertions}[excess.table]
    assert excess.entry == len(last) - 1
    assert what in excess.text


def test_an_effect_and_a_violation_may_be_too_long_as_well():
    made = hand()
    made.action("t", effects=(Effect(0, (LONG,)),))
    made.asserts(made.keep(0, V(1)), made.keep(0, V(2)), LONG, made.head(1))
    assert [excess[:2] for excess in exceeded(made.program())] == [("predicates", 2), ("assertions", 0)]
    assert isinstance(next(exceeded(made.program())), Excess)


def test_a_program_larger_than_a_robot_reads_is_not_written():
    made = Hand()
    made.temporary("p", STRING)
    texts = [f"{number:06}".ljust(LENGTH_MAX, "x") for number in range(SIZE_MAX // LENGTH_MAX)]
    made.facts.extend(InitialFact(0, None, (text,)) for text in texts)
    assert verify(made.program()) == []
    with pytest.raises(BytecodeError, match=r"the program takes .* octets, at most"):
        encode(made.program(), debug=False)


def nested(depth: int) -> tuple:
    return (nested(depth - 1),) if depth > 1 else ()


SOUND = [
    *(True, 0, INT_MIN, INT_MAX, -0.0, 1e308, Robot(0), Robot(ROBOT_ID_MAX)),
    *("", "ß" * LENGTH_MAX, Symbol("a")),
    *((), nested(NESTING_MAX), (0,) * LENGTH_MAX, ("ab", "cd")),
]
UNSOUND = [
    *(INT_MAX + 1, INT_MIN - 1, float("nan"), float("-inf"), Robot(ROBOT_ID_MAX + 1), Robot(-1)),
    *("x" * (LENGTH_MAX + 1), "\udc00"),
    *(nested(NESTING_MAX + 1), (0,) * (LENGTH_MAX + 1), ("x" * LENGTH_MAX,), (INT_MAX + 1,)),
    *(None, [], b""),
]


@pytest.mark.parametrize("value", SOUND, ids=range(len(SOUND)))
def test_a_value_within_all_bounds_is_sound(value):
    assert sound(value)


@pytest.mark.parametrize("value", UNSOUND, ids=range(len(UNSOUND)))
def test_any_other_value_is_not(value):
    assert not sound(value)


def test_a_list_that_stands_in_lists_many_times_is_not_counted_for_ever():
    value = tuple(range(100))
    for _ in range(NESTING_MAX - 1):
        value = (value,) * 100
    assert not sound(value)


VALUES = {
    OPEN: [1, 2.5, "a", Symbol("a"), Robot(1), True, (1, "a")],
    INT: [1],
    FLOAT: [2.5],
    STRING: ["a"],
    AREA: [Symbol("a")],
    ROBOT: [Robot(1)],
    BOOL: [True],
    numbers(): [(), (1, 2)],
    numbers(None): [(), (1, 2), (1, "a")],
    numbers(numbers()): [(), ((), (1,))],
}


@pytest.mark.parametrize("kind", VALUES)
def test_a_type_takes_its_own_values_alone(kind):
    assert all(conforms(value, kind) for value in VALUES[kind])
    others = [value for values in VALUES.values() for value in values]
    expected = {repr(value) for value in others if fits_by_hand(value, kind)}
    assert {repr(value) for value in others if conforms(value, kind)} == expected


def fits_by_hand(value: object, kind: Type) -> bool:
    if kind.base is Base.LIST:
        return type(value) is tuple and all(fits_by_hand(each, kind.element or OPEN) for each in value)
    names = {Base.INT: "int", Base.FLOAT: "float", Base.STRING: "str", Base.SYMBOL: "Symbol", Base.ROBOT: "Robot"}
    return kind.base is Base.OPEN or type(value).__name__ == {**names, Base.BOOL: "bool"}[kind.base]


def test_one_type_fits_another_if_all_its_values_do():
    fitting = {(str(one), str(other)) for one in VALUES for other in VALUES if fits(one, other)}
    expected = {
        (str(one), str(other))
        for one in VALUES
        for other in VALUES
        if all(conforms(value, other) for value in VALUES[one])
    }
    assert fitting == expected
    assert fits(Type(Base.SYMBOL, "area"), Type(Base.SYMBOL, "line"))
