"""Expressions: checked integers, finite floats, and no value for what makes no sense."""

import math

import pytest
from vm_hand import V, code

from rmr.base.time import seconds
from rmr.base.values import INT_MAX, INT_MIN, Robot, Symbol, Value
from rmr.bytecode.conform import LENGTH_MAX, NESTING_MAX
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Instruction
from rmr.vm.evaluate import NoValue, evaluate, same

ENV: list[Value] = [Robot(7), "text"]


def result(*parts: object) -> Value:
    return evaluate(code(*parts), ENV, seconds(2.5))


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ((1, 2, Op.ADD), 3),
        ((1, 2.0, Op.ADD), 3.0),
        ((7, 2, Op.DIV), 3.5),
        ((-7, 2, Op.MOD), 1),
        ((INT_MAX, 1, Op.SUB), INT_MAX - 1),
        ((3, Op.NEG), -3),
        ((3, Op.FLOAT), 3.0),
        ((V(1), V(1), Op.ADD), "texttext"),
        ((2.9, "call:floor"), 2),
        ((1, 2.5, "call:min"), 1.0),
        ((1, 2, "call:max"), 2),
        ((0, 0, 3, 4, "call:dist"), 5.0),
        ((V(0), "call:id"), 7),
        (("call:now",), 2.5),
        ((1, 1.0, Op.EQ), True),
        ((V(0), 7, Op.EQ), False),
        (("a", V(1), Op.NE), True),
        ((1, 2, Op.LE, Op.NOT), False),
    ],
)
def test_an_expression_has_the_value_of_its_operators(parts: tuple[object, ...], expected: Value) -> None:
    value = result(*parts)
    assert value == expected
    assert type(value) is type(expected)


@pytest.mark.parametrize(
    "parts",
    [
        (1, 0, Op.DIV),
        (1.0, 0, Op.MOD),
        (INT_MAX, 1, Op.ADD),
        (INT_MIN, Op.NEG),
        (INT_MIN, "call:abs"),
        (1e308, 10, Op.MUL),
        (-1, "call:sqrt"),
        (1e300, "call:floor"),
        ("a", 1, Op.ADD),
        (True, 1, Op.ADD),
        (V(0), 1, Op.ADD),
        ("a", "b", Op.LT),
        (1, Op.NOT),
        (3, "call:id"),
    ],
)
def test_result_out_of_range_or_operand_of_wrong_type_has_no_value(parts: tuple[object, ...]) -> None:
    with pytest.raises(NoValue):
        result(*parts)


def test_joined_lists_are_bounded() -> None:
    with pytest.raises(NoValue, match="too long"):
        result(tuple(range(LENGTH_MAX)), Instruction(Op.INT, 1), Instruction(Op.LIST, 1), Op.ADD)


def test_and_and_or_leave_the_right_side_alone_once_decided() -> None:
    boom = (1, 0, Op.DIV)
    assert result(False, Instruction(Op.AND, 3), *boom) is False
    assert result(True, Instruction(Op.OR, 3), *boom) is True
    assert result(True, Instruction(Op.AND, 1), False) is False


def test_a_condition_takes_one_way_only() -> None:
    for condition, expected in ((True, 1), (False, 2)):
        jump, leave = Instruction(Op.JUMP_IF_FALSE, 2), Instruction(Op.JUMP, 1)
        assert result(condition, jump, 1, leave, 2) == expected


def test_values_of_different_kinds_are_never_the_same() -> None:
    values: list[Value] = [True, Robot(1), 1, "a", Symbol("a"), (1,), (True,)]
    for index, left in enumerate(values):
        assert [same(left, right) for right in values] == [index == other for other in range(len(values))]
    assert same(2, 2.0)
    assert same((1, (2.0,)), (1.0, (2,)))


def test_functions_agree_with_their_mathematics() -> None:
    assert result(1, 2, "call:atan2") == math.atan2(1, 2)
    assert result(1, "call:sin") == math.sin(1)
    assert result(1, "call:cos") == math.cos(1)
    assert result(2, "call:sqrt") == math.sqrt(2)


MIXED = (1, 2.5, "a", Symbol("a"), True, Robot(1), (1,))


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        (((), "call:len"), 0),
        (((1, "a", (2, 3)), "call:len"), 3),
        ((V(1), "call:len"), 4),
        (((5, 6, 7), 0, "call:nth"), 5),
        (((5, 6, 7), 2, "call:nth"), 7),
        ((1.0, (0, 1), "call:member"), True),
        ((Robot(1), (0, 1), "call:member"), False),
        (((1,), ((2,), (1,)), "call:member"), True),
        ((1, (), "call:member"), False),
        (((), "call:sort"), ()),
        (((3, 1, 2), "call:sort"), (1, 2, 3)),
        (((Symbol("b"), Symbol("a")), "call:sort"), (Symbol("a"), Symbol("b"))),
        (((Robot(10), Robot(9)), "call:sort"), (Robot(9), Robot(10))),
        (((1, 2, 3), 0, "call:rest"), (1, 2, 3)),
        (((1, 2, 3), 2, "call:rest"), (3,)),
        (((1, 2, 3), 3, "call:rest"), ()),
        ((1, V(0), Instruction(Op.LIST, 2), (2,), Op.ADD), (1, Robot(7), 2)),
        ((Instruction(Op.LIST, 0),), ()),
    ],
)
def test_lists_are_built_taken_apart_and_searched(parts: tuple[object, ...], expected: Value) -> None:
    value = result(*parts)
    assert same(value, expected)
    assert type(value) is type(expected)


@pytest.mark.parametrize(
    "parts",
    [
        (3, "call:len"),
        (Symbol("a"), "call:len"),
        ((1, 2), 2, "call:nth"),
        ((1, 2), -1, "call:nth"),
        ((), 0, "call:nth"),
        ((1, 2), 0.0, "call:nth"),
        ((1, 2), True, "call:nth"),
        (V(1), 0, "call:nth"),
        (1, 1, "call:member"),
        (1, "call:sort"),
        ((1, 2), 3, "call:rest"),
        ((1, 2), -1, "call:rest"),
        ((1,), 1, Op.ADD),
    ],
)
def test_missing_list_item_has_no_value(parts: tuple[object, ...]) -> None:
    with pytest.raises(NoValue):
        result(*parts)


def test_items_of_different_kinds_and_those_without_an_order_are_not_sorted() -> None:
    for index, item in enumerate(MIXED):
        for other in MIXED[index + 1 :]:
            if not {type(item), type(other)} <= {int, float}:
                with pytest.raises(NoValue, match="without an order"):
                    result((item, other), "call:sort")
    for item in (True, (1,)):
        with pytest.raises(NoValue, match="without an order"):
            result((item,), "call:sort")


def test_sorting_keeps_the_order_of_equal_numbers() -> None:
    value = result((2, 1.0, 1, 0.5, 1.0), "call:sort")
    assert isinstance(value, tuple)
    assert [(type(item), item) for item in value] == [(float, 0.5), (float, 1.0), (int, 1), (float, 1.0), (int, 2)]


def test_lists_in_lists_are_bounded_in_depth_and_in_all() -> None:
    pair = Instruction(Op.LIST, 2)
    deep: Value = ()
    for _ in range(NESTING_MAX - 1):
        deep = (deep,)
    assert evaluate((Instruction(Op.LOAD, 0), Instruction(Op.LIST, 0), Instruction(Op.ADD)), [deep], 0) == deep
    with pytest.raises(NoValue, match="too deep"):
        evaluate((Instruction(Op.LOAD, 0), Instruction(Op.LIST, 1)), [deep], 0)
    half: Value = tuple(range(LENGTH_MAX // 2))
    load = Instruction(Op.LOAD, 0)
    with pytest.raises(NoValue, match="too long"):
        evaluate((load, load, pair), [half], 0)
    with pytest.raises(NoValue, match="too long"):
        evaluate((load, load, pair), ["x" * (LENGTH_MAX // 2)], 0)
    with pytest.raises(NoValue, match="too long"):
        evaluate((load, load, Instruction(Op.ADD)), ["x" * (LENGTH_MAX // 2 + 1)], 0)
