"""Operators on columns give, value by value and bit for bit, what they give for single values."""

import math
from itertools import product
from random import Random

import numpy as np
import pytest

from rmr.analysis.straight_line import work_out
from rmr.base.streams import Choices
from rmr.base.values import INT_MAX, INT_MIN
from rmr.bytecode.arithmetic import NoValue
from rmr.bytecode.program import Base
from rmr.columns.columns import below, streams
from rmr.columns.numbers import WORK, write

EDGE = [0, 1, -1, 2, 3, -7, 10, 1 << 31, (1 << 53) - 1, 1 << 53, (1 << 53) + 1, -(1 << 53) - 1, 3037000500, -3037000500]
INTS = [*EDGE, INT_MAX, INT_MAX - 1, INT_MIN, INT_MIN + 1, 4611686018427387905, 6148914691236517205]
FLOATS = [0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 3.0, 1e-308, 5e-324, 1e308, -1.7e308, 9007199254740993.0, 2.0**62, 2.0**63]
FLOATS += [-(2.0**63), math.nextafter(2.0**63, 0), 0.1, 1 / 3, 1e17]
COLUMNS = {Base.INT: INTS, Base.FLOAT: FLOATS}
TYPES = {Base.INT: np.int64, Base.FLOAT: np.float64, Base.BOOL: np.bool_}
BINARY = ["add", "sub", "mul", "div", "mod", "eq", "ne", "lt", "le", "gt", "ge", "min", "max", "atan2"]
UNARY = ["neg", "abs", "floor", "sqrt", "sin", "cos", "float"]


def bits(value: object) -> object:
    """Tell 0.0 from -0.0, 1 from 1.0."""
    return type(value), value.hex() if isinstance(value, float) else value


def expected(name: str, values: tuple[object, ...]) -> object:
    try:
        return bits(work_out(name, list(values)))  # type: ignore[arg-type]
    except NoValue:
        return None


def found(name: str, bases: list[Base], rows: list[tuple[object, ...]]) -> list[object]:
    """What an operation makes of columns with these rows; None where there is no value."""
    columns = [np.array(each, TYPES[base]) for each, base in zip(zip(*rows, strict=True), bases, strict=True)]
    with np.errstate(all="ignore"):
        held = WORK[name](columns, bases)
    valid = [True] * len(rows) if held.valid is None else np.broadcast_to(held.valid, len(rows)).tolist()
    return [bits(value) if there else None for value, there in zip(held.value.tolist(), valid, strict=True)]


@pytest.mark.parametrize("bases", list(product(COLUMNS, repeat=2)), ids=lambda bases: "-".join(b.name for b in bases))
@pytest.mark.parametrize("name", BINARY)
def test_an_operator_of_two_is_exact(name: str, bases: tuple[Base, Base]) -> None:
    random = Random(name)
    rows: list[tuple[object, ...]] = list(product(*[COLUMNS[base] for base in bases]))
    drawn = [[random.getrandbits(random.randint(1, 63)) - (1 << 40) for _ in range(200)] for _ in bases]
    rows += zip(
        *[each if b is Base.INT else [x / 7 for x in each] for each, b in zip(drawn, bases, strict=True)], strict=True
    )
    assert found(name, list(bases), rows) == [expected(name, row) for row in rows]


@pytest.mark.parametrize("base", COLUMNS)
@pytest.mark.parametrize("name", UNARY)
def test_an_operator_of_one_is_exact(name: str, base: Base) -> None:
    rows: list[tuple[object, ...]] = [(each,) for each in COLUMNS[base]]
    assert found(name, [base], rows) == [expected(name, row) for row in rows]


def test_a_distance_is_exact() -> None:
    rows: list[tuple[object, ...]] = list(product(FLOATS[:9], repeat=4))
    assert found("dist", [Base.FLOAT] * 4, rows) == [expected("dist", row) for row in rows]


@pytest.mark.parametrize("kind", [np.bool_, np.uint8, np.uint16, np.int64, np.float64])
def test_rows_of_a_column_are_written_and_no_others(kind: type) -> None:
    rows = np.array([True, False, True, True, False])
    column, other = np.array([1, 0, 0, 1, 1], kind), np.array([0, 1, 1, 1, 0], kind)
    for value in (other, np.asarray(1, kind)):
        wanted = np.where(rows, value, column)
        changed = column.copy()
        write(changed, value, rows)
        assert changed.tolist() == wanted.tolist()


def test_columns_draw_what_single_streams_draw() -> None:
    names = [f"7/robot{robot}/vm" for robot in range(50)]
    states, alone = streams(names), [Choices(name) for name in names]
    for bound in (1, 2, 3, 7, 250):
        bounds = np.arange(len(names), dtype=np.uint64) % np.uint64(5) + np.uint64(bound)
        wanted = [each.below(int(most)) for each, most in zip(alone, bounds, strict=True)]
        assert below(states, bounds).tolist() == wanted
    assert states.tolist() == [each.state for each in alone]
