"""What source an expression becomes, with which checks, and what is known of its value."""

import warnings

import pytest
from vm_hand import V, code

from rmr.base.values import INT_MAX, INT_MIN, Robot, Symbol, Value
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Base, Code, Instruction, Type
from rmr.vm.evaluate import NoValue, evaluate
from rmr.vm.generate.expression_source import condition, expression, narrowed
from rmr.vm.generate.form import Local
from rmr.vm.generate.known import Known
from rmr.vm.generate.source import Pool, Source
from rmr.vm.generate.trees import DEPTH_MAX

VARIABLES = ("me", "n", "m", "x", "q", "text", "area", "flag", "any")
NAMES = {slot: Local(name) for slot, name in enumerate(VARIABLES)}
KNOWN = {
    0: Known(Type(Base.ROBOT)),
    1: Known(Type(Base.INT)),
    2: Known(Type(Base.INT)),
    3: Known(Type(Base.FLOAT)),
    4: Known(Type(Base.LIST, element=Type(Base.INT))),
    5: Known(Type(Base.STRING)),
    6: Known(Type(Base.SYMBOL, "area")),
    7: Known(Type(Base.BOOL)),
    8: Known(None),
}
ME, N, M, X, Q, TEXT, AREA, FLAG, ANY = map(V, range(9))
ENV: list[Value] = [Robot(7), 5, 0, 2.5, (1, 2), "yes", Symbol("hall"), True, Symbol("hall")]


def written(*parts: object, known: dict[int, Known] = KNOWN) -> Source:
    return expression(code(*parts), NAMES, known, Pool())


def value(expr: Code, known: dict[int, Known] = KNOWN) -> Value:
    pool = Pool()
    source = expression(expr, NAMES, known, pool)
    given = dict(zip(VARIABLES, ENV, strict=True)) | {"now": 0}
    result: Value = eval(source.text, pool.globals | given)
    return result


def conditional(decider: Code, then: Code, otherwise: Code) -> Code:
    skips = Instruction(Op.JUMP_IF_FALSE, len(then) + 1), Instruction(Op.JUMP, len(otherwise))
    return (*decider, skips[0], *then, skips[1], *otherwise)


def both(left: Code, right: Code, op: Op = Op.AND) -> Code:
    return (*left, Instruction(op, len(right)), *right)


@pytest.mark.parametrize(
    ("parts", "text"),
    [
        ((N, 1000, Op.LT), "(n < 1000)"),
        ((N, 4, Op.MOD, 3, Op.EQ), "((n % 4) == 3)"),
        ((N, X, Op.ADD), "(n + x)"),
        ((N, 2, Op.DIV), "(n / 2)"),
        ((N, Op.FLOAT), "(n + 0.0)"),
        ((X, Op.FLOAT), "x"),
        ((X, Op.NEG), "(-x)"),
        ((N, M, "call:min"), "(n if n <= m else m)"),
        ((X, N, "call:max"), "float(x if x >= n else n)"),
        ((N, "call:floor"), "n"),
        ((X, "call:sin"), "sin(x)"),
        ((ME, "call:id"), "int(me)"),
        ((Q, "call:len"), "len(q)"),
        ((N, Q, "call:member"), "(n in q)"),
        ((FLAG, Op.NOT), "(not flag)"),
        ((ME, ME, Op.EQ), "(me == me)"),
        ((ME, N, Op.EQ), "False"),
        ((ME, N, Op.NE), "True"),
        ((AREA, ANY, Op.EQ), "(area == any and type(any) is Symbol)"),
        ((ANY, N, Op.EQ), "same(any, n)"),
        (("call:now",), "(now / 1000000000)"),
    ],
)
def test_generated_expression_that_cannot_fail_is_inlined_without_a_check(parts: tuple[object, ...], text: str) -> None:
    source = written(*parts)
    assert source.text == text
    assert not source.fails


@pytest.mark.parametrize(
    ("parts", "text"),
    [
        ((N, 1, Op.ADD), f"(t0 if (t0 := n + 1) <= {INT_MAX} else checked(t0))"),
        ((N, 1, Op.SUB), f"(t0 if (t0 := n - 1) >= {INT_MIN} else checked(t0))"),
        ((N, M, Op.MUL), f"(t0 if {INT_MIN} <= (t0 := n * m) <= {INT_MAX} else checked(t0))"),
        ((X, X, Op.MUL), "(t0 if (t0 := x * x) - t0 == 0.0 else checked(t0))"),
        ((N, M, Op.MOD), "((n % m) if m else divide(1, 0))"),
        ((X, "call:sqrt"), "(sqrt(x) if x >= 0 else call('sqrt', [x], now))"),
        ((Q, N, "call:nth"), "(q[n] if len(q) > n >= 0 else nth_of(q, n))"),
        ((ANY, Op.NEG), "negate(any)"),
        ((ANY, 1, Op.LT), "(any < 1 if type(any) is int else less(any, 1))"),
        ((TEXT, N, Op.LT), "less(text, n)"),
        ((ANY, Op.NOT), "(not truth(any))"),
    ],
)
def test_generated_expression_that_may_fail_has_the_remaining_check_or_is_a_call(
    parts: tuple[object, ...], text: str
) -> None:
    source = written(*parts)
    assert source.text == text
    assert source.fails


def test_a_counter_behind_its_guard_is_a_bare_sum() -> None:
    known = narrowed(code(N, 100000, Op.LT), KNOWN)
    source = written(N, 1, Op.ADD, known=known)
    assert source == Source("(n + 1)", Known(Type(Base.INT), INT_MIN + 1, 100000), False)


def test_both_sides_of_a_guard_narrow() -> None:
    between = both(code(0, N, Op.LE), code(N, 10, Op.LT))
    assert narrowed(between, KNOWN)[1] == Known(Type(Base.INT), 0, 9)
    equal = narrowed(code(M, N, Op.EQ), narrowed(between, KNOWN))
    assert equal[2] == Known(Type(Base.INT), 0, 9)
    assert narrowed(code(N, 3, Op.EQ), KNOWN)[1] == Known(Type(Base.INT), 3, 3)
    assert narrowed((*both(code(N, 0, Op.LT), code(N, 9, Op.GT), Op.OR), Instruction(Op.NOT)), KNOWN)[1].bounds == (
        0,
        9,
    )


def test_a_sum_that_a_guard_compares_needs_no_check_behind_it() -> None:
    further = narrowed(code(M, N, 1, Op.ADD, Op.GT), KNOWN)
    assert written(N, 1, Op.ADD, known=further).text == "(n + 1)"
    shorter = narrowed(code(N, 1, Op.ADD, 7, Op.NE), KNOWN)
    assert written(N, 1, Op.ADD, known=shorter).text == "(n + 1)"
    assert written(N, 2, Op.ADD, known=shorter).fails


def test_a_guard_that_cannot_be_true_narrows_to_nothing_absurd() -> None:
    known = narrowed(both(code(N, 0, Op.LT), code(N, 5, Op.GT)), KNOWN)
    low, high = known[1].bounds
    assert low <= high


def test_a_list_that_is_long_enough_is_taken_apart_without_a_check() -> None:
    known = narrowed(code(Q, "call:len", 1, Op.GE), KNOWN)
    assert written(Q, 0, "call:nth", known=known) == Source("q[0]", Known(Type(Base.INT)), False)
    assert written(Q, 1, "call:rest", known=known).text == "q[1:]"
    assert not written(Q, 1, "call:rest", known=known).fails
    assert written(Q, 1, "call:nth", known=known).fails


def test_a_branch_knows_its_condition() -> None:
    divided = conditional(code(N, 0, Op.GT), code(10, N, Op.DIV), code(0.0))
    assert expression(divided, NAMES, KNOWN, Pool()) == Source(
        "((10 / n) if (n > 0) else 0.0)", Known(Type(Base.FLOAT), 0.0, 10.0), False
    )
    guarded = both(code(N, 0, Op.NE), code(N, 0, Op.GT), Op.OR)
    assert expression(guarded, NAMES, KNOWN, Pool()).text == "((n != 0) or (n > 0))"


def test_non_boolean_guard_is_reported() -> None:
    pool = Pool()
    source = condition(code(ANY), NAMES, KNOWN, pool)
    assert source.fails
    with pytest.raises(NoValue, match="a condition that is neither true nor false"):
        eval(source.text, pool.globals | {"any": 1})
    assert condition(code(FLAG), NAMES, KNOWN, Pool()) == Source("flag", KNOWN[7], False, repeatable=True)


@pytest.mark.parametrize("constant", [Robot(1), 1, True, 1.0, Symbol("a"), "a", -0.0, -5, (), (True, Symbol("true"))])
def test_a_constant_stands_for_itself_with_its_type(constant: Value) -> None:
    pool = Pool()
    made = eval(pool.constant(constant), pool.globals)
    assert (type(made), repr(made)) == (type(constant), repr(constant))


def test_constants_that_are_equal_in_python_only_are_kept_apart() -> None:
    pool = Pool()
    texts = [pool.constant(each) for each in (Symbol("a"), "a", Robot(1), 1, True, Symbol("a"), (1,), (True,))]
    assert len(set(texts)) == 7
    assert texts[0] == texts[5]


def test_code_that_jumps_otherwise_is_interpreted() -> None:
    crooked = (*code(N), Instruction(Op.JUMP, 0), *code(3, Op.ADD))
    source = expression(crooked, NAMES, KNOWN, Pool())
    assert source.text == "evaluate(k1, (None, n,), now)"
    assert source.fails
    assert value(crooked) == evaluate(crooked, ENV, 0) == 8
    assert narrowed(crooked, KNOWN) == KNOWN


@pytest.mark.parametrize("depth", [DEPTH_MAX - 1, DEPTH_MAX, 1000])
@pytest.mark.parametrize("more", [code(1, Op.ADD), code(X, Op.DIV), code(X, "call:max"), code("call:abs")])
def test_deeply_nested_code_generates_source_that_python_accepts(depth: int, more: Code) -> None:
    deep = (*code(N), *more * depth)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert value(deep) == evaluate(deep, ENV, 0)


def test_branches_in_branches_without_end_are_interpreted() -> None:
    nested = code(N)
    for _ in range(1000):
        nested = conditional(code(FLAG), code(M), nested)
    assert expression(nested, NAMES, KNOWN, Pool()).text.startswith("evaluate(")
    assert value(nested) == 0


def test_the_first_of_two_failures_is_the_reason() -> None:
    overflow, by_zero = code(INT_MAX, N, Op.ADD), code(N, M, Op.DIV)
    for first, other, reason in ((overflow, by_zero, "64 bits"), (by_zero, overflow, "zero")):
        for op in (Op.ADD, Op.DIV, Op.MOD, Op.EQ, Op.LT):
            with pytest.raises(NoValue, match=reason):
                value((*first, *other, Instruction(op)))
        with pytest.raises(NoValue, match=reason):
            value((*first, *code(M, Op.DIV)) if first is overflow else (*first, *other, *code("call:atan2")))
