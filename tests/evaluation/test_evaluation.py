"""The evaluation, reduced: each of its experiments with next to nothing, and what the page must have."""

import heapq
import json
from importlib import import_module
from pathlib import Path

import evaluate
import figure14
import localisation
import planning
import pytest
import seeds
import standoffs
from experiment import as_json, renewed, target, target_lines
from runs import Run, pooled, simulated

from rmr_view.chart import Figure

PAGE = Path(__file__).parents[2] / "docs" / "evaluation" / "README.md"


def drawable(data):
    """Return the figure of data as `rmr plot` would read it from a file."""
    return Figure.model_validate(json.loads(as_json(data))["figure"])


def marks(experiment, data):
    return [mark for mark in experiment.tables(data) if f"<!-- {mark}: begin -->" not in PAGE.read_text("utf-8")]


def test_every_experiment_keeps_to_the_interface():
    for name in evaluate.EXPERIMENTS:
        experiment = import_module(name)
        assert name == experiment.NAME
        assert len(experiment.QUICK) <= len(experiment.SEEDS)
        assert f"<!-- {name}: begin -->" in PAGE.read_text("utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("name", evaluate.EXPERIMENTS)
def test_experiment_runs_with_its_first_seed_and_fills_its_tables(name, tmp_path, capsys):
    chosen = evaluate.options([name, "--quick", "--seeds", "1", "--jobs", "1", "--out", str(tmp_path)])
    assert evaluate.attempted(name, chosen, tmp_path), capsys.readouterr().err
    data = json.loads((tmp_path / f"{name}.json").read_text("utf-8"))
    assert (data["seeds"], data["quick"]) == ("1-1", True)
    assert marks(import_module(name), data) == []


@pytest.mark.medium
def test_both_labs_finish_without_contact_within_their_bounds():
    data = seeds.run(range(1, 4), 1)
    assert [each["what"] for each in data["targets"] if not each["met"]] == []
    assert len(drawable(data).panels[0].series) == 2
    assert marks(seeds, data) == []


def test_the_phases_of_a_run_add_up_to_its_time():
    found = simulated([Run("testbed", 1, {"robots": n}, figure14.measured) for n in (1, 2)], 1)
    for row in found:
        assert sum(row[name] for name in figure14.PHASES) == pytest.approx(row["time_s"], abs=0.01)
        assert all(row[name] > 0.0 for name in figure14.PHASES)
    kinds = (("testbed", "simulated"), ("testbed", "processes"), ("hall", "simulated"))
    points = [(lab, mode, n) for lab, mode in kinds for n in (1, 2)]
    runs = [figure14.named(mode, (lab, n, 1), found[n - 1]) for lab, mode, n in points]
    rows = [
        {"lab": lab, "mode": mode, "robots": n, **figure14.summary(figure14.chosen(runs, lab, mode, n))}
        for lab, mode, n in points
    ]
    assert len(drawable({"figure": figure14.drawn(rows, 1, 1)}).panels) == 2
    assert figure14.growth(runs, "testbed", (1, 2))["value"] == pytest.approx(found[1]["time_s"] - found[0]["time_s"])


def test_a_robot_of_the_hall_finishes():
    (row,) = simulated([Run("hall", 1, {"robots": 1})], 1)
    assert row["finished"]
    assert row["time_s"] >= row["bound_s"]


def optimum(floor):
    """Return the cost of the best way by Dijkstra's algorithm, written anew."""
    best, queue = {floor.start: 0.0}, [(0.0, floor.start)]
    while queue:
        so_far, here = heapq.heappop(queue)
        if here == floor.goal:
            return so_far
        for there, cost in floor.moves(here) if so_far == best[here] else ():
            if so_far + cost < best.get(there, float("inf")):
                best[there] = so_far + cost
                heapq.heappush(queue, (so_far + cost, there))
    raise AssertionError("no way")


@pytest.mark.parametrize("seed", range(1, 11))
def test_a_star_finds_a_way_of_least_cost(seed):
    floor = planning.floor_of(30, seed)
    path = planning.ours(floor)
    assert not planning.cuts(floor, path)
    assert planning.length(floor, path) == pytest.approx(optimum(floor))


def test_followers_save_most_of_the_expansions():
    rows = [planning.shared(seed) for seed in (1, 2, 3)]
    assert sum(row["together"] for row in rows) <= 0.3 * sum(row["alone"] for row in rows)


@pytest.mark.medium
def test_planners_are_compared_whether_others_are_installed_or_not(monkeypatch):
    monkeypatch.setattr(planning, "installed", list)
    data = planning.run(range(1, 3), 1)
    assert [row["planner"] for row in data["rows"]] == ["rmr"]
    assert data["not_installed"] == ["skimage", "skimage_cutting", "networkx", "pathfinding"]
    assert marks(planning, data) == []
    drawable(data)


def test_a_robot_knows_where_it_is_to_a_centimetre_and_through_outages_to_five(monkeypatch):
    monkeypatch.setattr(localisation, "DRIVE_S", 15.0)
    data = localisation.run(range(1, 6), 1)
    assert all(each["met"] for each in data["targets"])
    assert marks(localisation, data) == []
    drawable(data)


@pytest.mark.parametrize("scene", [0, 3, 4, 6])
def test_robots_find_their_way_out_of_stand_offs(scene):
    assert standoffs.played((scene, 1))["way_out"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["nope"], "no such experiment: nope; there are figure14"),
        (["--seeds", "abc"], "seeds such as 1-100"),
        (["--seeds", "5-3"], "the least first, not '5-3'"),
        (["--jobs", "0"], "1 to 99 processes, not '0'"),
        (["--out", f"{PAGE}/deeper"], "Not a directory"),
    ],
)
def test_wrong_usage_is_told_before_anything_is_taken(words, told, capsys):
    with pytest.raises(SystemExit) as refused:
        evaluate.options(words)
    assert refused.value.code == 2
    assert told in capsys.readouterr().err


def test_a_table_of_a_page_is_renewed_and_a_page_without_marks_is_told():
    text = "before\n<!-- a: begin -->\nold\n<!-- a: end -->\nafter\n"
    assert renewed(text, ["| new |"], "a") == text.replace("old", "| new |")
    with pytest.raises(ValueError, match="b: begin"):
        renewed(text, [], "b")


def test_a_target_is_met_on_its_bound_and_missed_beyond():
    met, missed = target("time", 1.2, at_most=1.2, unit="s"), target("share", 0.9, at_least=1.0)
    assert [line[-1] for line in target_lines([met, missed])] == ["met", "**missed**"]
    assert target_lines([met])[0][2] == "<= 1.2 s"


def double(number):
    return 2 * number


def test_a_pool_gives_results_in_order():
    assert pooled(double, range(20), 2) == pooled(double, range(20), 1) == list(range(0, 40, 2))


def test_data_are_the_same_after_they_were_written_and_read():
    data = {"rows": [{"a": 1.5, "b": None}], "seeds": "1-3", "empty": [], "figure": {"panels": [1]}}
    assert json.loads(as_json(data)) == data
