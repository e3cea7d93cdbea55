"""The experiment of formation control, on one run with four robots."""

import json

import formation
import pytest
from experiment import as_json
from runs import Run, simulated

from rmr_view.chart import Figure


@pytest.mark.medium
def test_a_run_is_taken_shape_by_shape_and_its_barriers_are_part_of_the_time():
    runs = simulated([Run("formation/lab.yaml", 1, {}, formation.measured)], jobs=1)
    (taken,) = runs
    assert taken["rounds"] == len(formation.SHAPES)
    assert abs(sum(taken["shapes_s"]) - taken["time_s"]) < 0.05
    assert all(0.0 < barrier < shape for barrier, shape in zip(taken["barriers_s"], taken["shapes_s"], strict=True))
    assert taken["fleet_bound_s"] < taken["time_s"]
    assert 0.999999 < taken["sum_ratio"] < 1.1
    row = {"robots": 4, **formation.summary(runs)}
    assert all(each["met"] for each in formation.targets(row))
    lines = formation.tables({"rows": [row]})[formation.NAME]
    assert len(lines) == 3
    assert Figure.model_validate(json.loads(as_json({"figure": formation.drawn([row])}))["figure"]).panels
