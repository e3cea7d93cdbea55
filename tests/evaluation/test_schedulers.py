"""The experiments on scheduling, reduced."""

import json

import pytest
import schedulers
import waiting
from experiment import as_json

from rmr_view.chart import Figure

pytestmark = pytest.mark.medium


def test_orders_are_compared_with_the_best_of_all_orders():
    data = schedulers.run(range(1, 2), 1)
    assert [row["order"] for row in data["rows"]] == ["ours", "edf", "fcfs", "none"]
    assert all(0 <= row["met"]["value"] <= 6 for row in data["rows"])
    assert all(row["optimum"]["value"] >= row["insertion"]["value"] for row in data["paper"])
    assert all(row["optimum"]["value"] >= max(row["edf"]["value"], row["fcfs"]["value"]) for row in data["paper"])
    Figure.model_validate(json.loads(as_json(data))["figure"])
    assert set(schedulers.tables(data)) == {"schedulers", "orders"}


def test_a_fixed_waiting_time_is_waited_and_the_derived_one_serves_all():
    rows = [waiting.carried_out(waiting.Case(1, 20, wait)) for wait in (None, 1000)]
    assert all(row["met"] > 0 for row in rows)
    assert rows[0]["time_s"] != rows[1]["time_s"]
