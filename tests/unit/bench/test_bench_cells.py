"""The benchmark of the cells: what it expects is what robots spread evenly would need."""

from dataclasses import asdict
from random import Random

import cells
import pytest


@pytest.mark.parametrize("arena", [0.5, 1, 4, 9])
def test_the_share_that_is_expected_is_that_of_places_drawn_evenly(arena):
    case, rng = cells.Case(50, arena, cells=True, seconds=1.0), Random(1)

    def cell():
        return cells.GRID.cell_of(*(rng.uniform(0.0, case.side_m) for _ in "xy"))

    far = sum(cell() not in cell().ring for _ in range(4_000)) / 4_000
    assert cells.expected_percent(case) == pytest.approx(100.0 * far, abs=2.5)


@pytest.mark.slow
def test_with_one_cell_all_others_are_told_of_what_is_announced():
    counted, _ = cells.run(cells.Case(3, 1, cells=False, seconds=1.0))
    assert 0 < counted.delivered <= 2 * counted.announced
    assert counted.near == counted.delivered


def test_a_row_of_the_table_tells_what_the_data_tell():
    row = cells.Row(50, 9, 79.1, 0.6, 100.0, 4900.0, 500.0, 89.8, 90.0, 3.5, 0.5, 0.2, 0.06, 0.03, 1, 0)
    assert len(cells.cells_of(row)) == len(cells.HEADER)
    assert cells.cells_of(row)[2:5] == ("4,900", "500", "89.8 %")
    assert asdict(row)["saved_percent"] == 89.8
