"""Generated source has the value of the byte-code, for all values that are what is known of them.

The expressions are drawn over all instructions, mostly of types that go together; the known types are those of the
values, wider ones or none, the known bounds lie around the values.
"""

from collections.abc import Callable
from functools import partial
from random import Random

import pytest

from rmr.base.record import record
from rmr.base.values import INT_MAX, INT_MIN, Robot, Symbol, Value, format_value
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.opcodes import Op
from rmr.bytecode.part_checks import Constants, examine
from rmr.bytecode.program import Base, Code, Instruction, Type
from rmr.bytecode.scope import type_of_value
from rmr.vm.evaluate import NoValue, evaluate
from rmr.vm.generate.expression_source import condition, expression, narrowed
from rmr.vm.generate.form import Local
from rmr.vm.generate.known import LIMITS, Known, of_value
from rmr.vm.generate.source import Pool, Source

EXPRESSIONS = 1200
VALUES = 4
"""Of the slots, for each expression."""
SLOTS = 6
NOW = 2_500_000_001
DEPTH = 4

INTS = (0, 1, -1, 2, 3, 7, 10, -10, 255, 65536, 2**53 + 1, 2**62, -(2**62), INT_MAX, INT_MIN, INT_MAX - 1, INT_MIN + 1)
FLOATS = (0.0, -0.0, 1.0, -1.0, 0.5, 2.5, -3.75, 1e308, -1e308, 1.7976931348623157e308, 5e-324, -5e-324, 2.0**63, 1e16)
TEXTS = ("", "a", "b", "yes", "A longer\n'text'", "\u00e9")
SCALARS: dict[Base, tuple[Value, ...]] = {
    Base.INT: INTS,
    Base.FLOAT: FLOATS,
    Base.BOOL: (True, False),
    Base.STRING: TEXTS,
    Base.SYMBOL: tuple(map(Symbol, ("a", "b", "yes"))),
    Base.ROBOT: tuple(map(Robot, (0, 1, 2, 65533))),
}
NUMERIC = (Op.ADD, Op.SUB, Op.MUL, Op.DIV, Op.MOD)
ORDERED = (Op.LT, Op.LE, Op.GT, Op.GE)
RESULTS = {
    "len": Base.INT,
    "id": Base.INT,
    "floor": Base.INT,
    "member": Base.BOOL,
    "sort": Base.LIST,
    "rest": Base.LIST,
}


def drawn_value(random: Random, kind: Type) -> Value:
    if kind.base is Base.OPEN:
        kind = Type(random.choice([*SCALARS, Base.LIST]))
    if kind.base is Base.LIST:
        element = kind.element or Type(random.choice([*SCALARS, Base.OPEN]))
        return tuple(drawn_value(random, element) for _ in range(random.choice([0, 1, 2, 3])))
    if kind.base is Base.INT and random.random() < 0.5:
        return random.randint(-20, 20)
    if kind.base is Base.FLOAT and random.random() < 0.3:
        return random.uniform(-20, 20)
    return random.choice(SCALARS[kind.base])


def drawn_type(random: Random) -> Type:
    base = random.choice([Base.INT, Base.INT, Base.FLOAT, Base.FLOAT, *SCALARS, Base.LIST, Base.LIST])
    if base is not Base.LIST:
        return Type(base)
    element = random.choice([None, Type(Base.OPEN), Type(Base.LIST, element=Type(Base.INT)), *map(Type, SCALARS)])
    return Type(base, element=element)


def widened(random: Random, kind: Type, values: list[Value]) -> Known:
    """Return something that is true of all `values`, which are of type `kind`."""
    if random.random() < 0.15:
        return Known(random.choice([None, Type(Base.OPEN)]))
    if kind.base not in LIMITS or random.random() < 0.3:
        return Known(kind)
    measures = [len(value) if isinstance(value, str | tuple) else value for value in values]
    least, most = LIMITS[kind.base]
    slack = random.choice([0, 0, 1, 100])
    low = max(least, min(measures) - slack)
    high = min(most, max(measures) + slack)
    return random.choice([Known(kind, low, high), Known(kind, None, high), Known(kind, low, None)])


class Drawn:
    """Draws code, mostly such that types go together."""

    def __init__(self, random: Random, types: list[Type]) -> None:
        self.random = random
        self.types = types

    def code(self, wanted: Base, depth: int) -> list[Instruction]:
        random = self.random
        if random.random() < 0.04:
            wanted = random.choice([*SCALARS, Base.LIST])
        if depth == 0 or random.random() < 0.15:
            return [self.leaf(wanted)]
        if random.random() < 0.12:
            return self.conditional(wanted, depth - 1)
        return random.choice(self.makers(wanted))(depth - 1)

    def leaf(self, wanted: Base) -> Instruction:
        fitting = [slot for slot, kind in enumerate(self.types) if kind.base is wanted]
        if fitting and self.random.random() < 0.75:
            return Instruction(Op.LOAD, self.random.choice(fitting))
        value = drawn_value(self.random, Type(wanted))
        return Instruction(Op.INT if type(value) is int else Op.CONST, value)

    def makers(self, wanted: Base) -> list[Callable[[int], list[Instruction]]]:
        number = self.random.choice([Base.INT, Base.FLOAT])
        if wanted is Base.INT:
            return [
                self.arithmetic(Base.INT),
                self.arithmetic(Base.INT),
                self.call_to_int(),
                self.nth(),
                self.negated(Base.INT),
            ]
        if wanted is Base.FLOAT:
            return [
                self.arithmetic(Base.FLOAT),
                self.arithmetic(Base.FLOAT),
                self.call_to_float(),
                self.nth(),
                self.negated(Base.FLOAT),
                lambda depth: [*self.code(number, depth), Instruction(Op.FLOAT)],
            ]
        if wanted is Base.BOOL:
            return [
                self.compared(),
                self.compared(),
                self.compared(),
                self.logical(),
                self.logical(),
                self.negation(),
                self.call("member", self.anything(), Base.LIST),
            ]
        if wanted is Base.STRING:
            return [lambda depth: self.binary(Op.ADD, Base.STRING, Base.STRING, depth)]
        if wanted is Base.LIST:
            return [
                self.listing(),
                lambda depth: self.binary(Op.ADD, Base.LIST, Base.LIST, depth),
                self.call("sort", Base.LIST),
                self.call("rest", Base.LIST, Base.INT),
                lambda depth: [*self.code(Base.LIST, depth), Instruction(Op.FLOAT)],
            ]
        return [lambda _: [self.leaf(wanted)]]

    def anything(self) -> Base:
        return self.random.choice([*SCALARS, Base.LIST])

    def binary(self, op: Op, left: Base, right: Base, depth: int) -> list[Instruction]:
        return [*self.code(left, depth), *self.code(right, depth), Instruction(op)]

    def arithmetic(self, base: Base) -> Callable[[int], list[Instruction]]:
        op = self.random.choice(NUMERIC)
        if base is Base.INT:
            return lambda depth: self.binary(op, base, base, depth)
        left, right = self.random.choice([(base, base), (base, Base.INT), (Base.INT, base), (Base.INT, Base.INT)])
        return lambda depth: self.binary(op, left, right, depth)

    def negated(self, base: Base) -> Callable[[int], list[Instruction]]:
        return lambda depth: [*self.code(base, depth), Instruction(Op.NEG)]

    def call(self, name: str, *args: Base) -> Callable[[int], list[Instruction]]:
        index = next(i for i, function in enumerate(FUNCTIONS) if function.name == name)
        return lambda depth: [
            *(each for arg in args for each in self.code(arg, depth)),
            Instruction(Op.CALL, index),
        ]

    def call_to_int(self) -> Callable[[int], list[Instruction]]:
        random = self.random
        return random.choice(
            [
                self.call("abs", Base.INT),
                self.call("min", Base.INT, Base.INT),
                self.call("max", Base.INT, Base.INT),
                self.call("floor", random.choice([Base.INT, Base.FLOAT])),
                self.call("id", Base.ROBOT),
                self.call("len", random.choice([Base.LIST, Base.STRING])),
            ]
        )

    def call_to_float(self) -> Callable[[int], list[Instruction]]:
        random = self.random
        one, other, third, fourth = (random.choice([Base.INT, Base.FLOAT]) for _ in range(4))
        return random.choice(
            [
                *(self.call(name, one) for name in ("sqrt", "sin", "cos", "abs")),
                *(self.call(name, one, other) for name in ("atan2", "min", "max")),
                self.call("dist", one, other, third, fourth),
                self.call("now"),
            ]
        )

    def nth(self) -> Callable[[int], list[Instruction]]:
        return self.call("nth", Base.LIST, Base.INT)

    def compared(self) -> Callable[[int], list[Instruction]]:
        random = self.random
        if random.random() < 0.6:
            base, op = random.choice([Base.INT, Base.INT, Base.FLOAT, Base.STRING]), random.choice([*ORDERED, Op.EQ])
            other = base if base is Base.STRING or random.random() < 0.7 else random.choice([Base.INT, Base.FLOAT])
            return lambda depth: self.binary(op, base, other, depth)
        base, op = self.anything(), random.choice([Op.EQ, Op.NE])
        return lambda depth: self.binary(op, base, base if random.random() < 0.8 else self.anything(), depth)

    def logical(self) -> Callable[[int], list[Instruction]]:
        op = self.random.choice([Op.AND, Op.OR])

        def made(depth: int) -> list[Instruction]:
            right = self.code(Base.BOOL, depth)
            return [*self.code(Base.BOOL, depth), Instruction(op, len(right)), *right]

        return made

    def negation(self) -> Callable[[int], list[Instruction]]:
        return lambda depth: [*self.code(Base.BOOL, depth), Instruction(Op.NOT)]

    def listing(self) -> Callable[[int], list[Instruction]]:
        base, count = self.anything(), self.random.choice([0, 1, 2, 3])
        return lambda depth: [
            *(each for _ in range(count) for each in self.code(base, max(0, depth - 1))),
            Instruction(Op.LIST, count),
        ]

    def conditional(self, wanted: Base, depth: int) -> list[Instruction]:
        then, otherwise = self.code(wanted, depth), self.code(wanted, depth)
        return [
            *self.code(Base.BOOL, depth),
            Instruction(Op.JUMP_IF_FALSE, len(then) + 1),
            *then,
            Instruction(Op.JUMP, len(otherwise)),
            *otherwise,
        ]


def crooked(random: Random, code: Code) -> Code:
    """Return `code` with another skip or instruction somewhere, if the verifier takes it."""
    at = random.randrange(len(code))
    skip = Instruction(random.choice([Op.JUMP, Op.AND, Op.OR, Op.JUMP_IF_FALSE]), random.randrange(4))
    if code[at].op in (Op.JUMP, Op.AND, Op.OR, Op.JUMP_IF_FALSE):
        changed = (*code[:at], Instruction(code[at].op, random.randrange(8)), *code[at + 1 :])
    else:
        changed = (*code[:at], skip, *code[at:])
    return code if examine(changed, Constants()).wrong else changed


@record
class Case:
    """An expression, what is known of its slots, and some values of them."""

    code: Code
    known: dict[int, Known]
    environments: list[list[Value]]


def drawn(seed: int, *wanted: Base) -> Case:
    """Return a case of one of the `wanted` types, if any is."""
    random = Random(seed)
    types = [Type(Base.ROBOT), *(drawn_type(random) for _ in range(SLOTS - 1))]
    environments = [[drawn_value(random, kind) for kind in types] for _ in range(VALUES)]
    known = {slot: widened(random, kind, [env[slot] for env in environments]) for slot, kind in enumerate(types)}
    code = tuple(Drawn(random, types).code(random.choice(wanted or (*SCALARS, Base.INT, Base.LIST)), DEPTH))
    assert not examine(code, Constants()).wrong
    return Case(crooked(random, code) if random.random() < 0.1 else code, known, environments)


Outcome = tuple[str, str]
"""What kind of value, or NoValue, and how it is written, or why there is none."""


def described(value: Value) -> str:
    """Return a value as text that tells every two apart: also 1 and true inside a list, and the two zeros."""
    if type(value) is tuple:
        return f"[{', '.join(map(described, value))}]"
    return f"{type(value).__name__} {format_value(value)}"


def outcome(evaluated: Callable[[], Value]) -> Outcome:
    try:
        return "value", described(evaluated())
    except NoValue as reason:
        return type(reason).__name__, str(reason)


def function(source: Source, pool: Pool) -> Callable[..., Value]:
    """Return the function of the slots and the instant that has `source` for its value."""
    slots = ", ".join(f"x{slot}" for slot in range(SLOTS))
    made: dict[str, object] = dict(pool.globals)
    exec(f"def made({slots}, now): return {source.text}", made)
    return made["made"]  # type: ignore[return-value]


def is_what_is_known(value: Value, known: Known) -> bool:
    """Tell whether `known` is true of `value`."""
    kind = known.type
    if kind is None or kind.base is Base.OPEN:
        return True
    if kind.base is not (Base.LIST if type(value) is tuple else type_of_value(value).base):
        return False
    if kind.base not in LIMITS:
        return True
    low, high = known.bounds
    if type(value) is tuple:
        return low <= len(value) <= high and all(is_what_is_known(item, Known(kind.element)) for item in value)
    measure = len(value) if isinstance(value, str) else value
    assert isinstance(measure, int | float)
    return low <= measure <= high


NAMES = {slot: Local(f"x{slot}") for slot in range(SLOTS)}


def check_expression(case: Case) -> int:
    """Check one case; return how often it had a value."""
    pool = Pool()
    source = expression(case.code, NAMES, case.known, pool)
    call = function(source, pool)
    values = 0
    for env in case.environments:
        expected = outcome(partial(evaluate, case.code, env, NOW))
        assert outcome(partial(call, *env, NOW)) == expected, (source.text, env)
        if expected[0] == "value":
            values += 1
            assert is_what_is_known(evaluate(case.code, env, NOW), source.known), (source, env)
        else:
            assert source.fails, (source.text, env)
    return values


def check_condition(case: Case) -> int:
    """Check one case as a guard; return how often it held."""
    pool = Pool()
    call = function(condition(case.code, NAMES, case.known, pool), pool)
    narrower = narrowed(case.code, case.known)
    held = 0
    for env in case.environments:
        expected = outcome(partial(evaluate, case.code, env, NOW))
        if expected[0] == "value" and not expected[1].startswith("bool"):
            expected = "NoValue", "a condition that is neither true nor false"
        assert outcome(partial(call, *env, NOW)) == expected
        if expected == ("value", "bool true"):
            held += 1
            assert all(is_what_is_known(env[slot], known) for slot, known in narrower.items()), (narrower, env)
    return held


@pytest.mark.medium
def test_source_has_the_value_of_its_code_and_fails_with_the_same_reason() -> None:
    values = sum(check_expression(drawn(seed)) for seed in range(EXPRESSIONS))
    assert EXPRESSIONS * VALUES // 3 < values < EXPRESSIONS * VALUES


@pytest.mark.medium
def test_a_guard_narrows_to_what_holds_of_all_values_for_which_it_is_true() -> None:
    held = sum(check_condition(drawn(seed, Base.BOOL)) for seed in range(EXPRESSIONS, 2 * EXPRESSIONS))
    assert held > EXPRESSIONS // 2


@pytest.mark.parametrize("value", [each for values in SCALARS.values() for each in values] + [(), (1, (True, 1.0))])
def test_a_constant_keeps_its_type(value: Value) -> None:
    pool = Pool()
    made = eval(pool.constant(value), pool.globals)
    assert described(made) == described(value)
    assert is_what_is_known(made, of_value(value))
