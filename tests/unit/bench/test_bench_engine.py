"""The comparison of engines measures what it says, and takes no time of a run that came to a wrong end."""

import dataclasses
import json
from pathlib import Path

import costs
import engine
import page
import pytest
from paired import Spread, contest, ratio, timing
from systems import CLIPS, RMR, Lap, RmrSystem, System, WrongResultError
from workloads import SUITE, counter, tokens

from rmr.vm.engines import Engine

pytestmark = pytest.mark.medium

DOCS = Path(__file__).parents[3] / "docs"
BEGIN, END = "<!-- taken: begin -->", "<!-- taken: end -->"

SIZES = {"counter": 9, "ping-pong": 9, "closure": 8, "gradient": 12, "join of 100": 6, "join of 1,000": 7}
ALONE = engine.Plan({}, tuple(engine.MODULES), rounds=1, quick=True)


@pytest.mark.parametrize("entry", SUITE, ids=lambda entry: entry.title)
@pytest.mark.parametrize("kind", Engine, ids=lambda kind: kind.value)
def test_every_workload_comes_to_the_end_that_is_worked_out_without_an_engine(entry, kind):
    workload = entry.make(SIZES.get(entry.title, 5))
    assert workload.firings > 0
    assert any(workload.ending.values()) or workload.name == "tokens"
    laps = contest([RmrSystem(workload, engine=kind)], workload.ending, rounds=2, runs=2)
    assert [lap.total > 0 for lap in laps[RMR]] == [True, True]


def test_facts_that_are_not_the_right_ones_at_the_end_are_no_result():
    system = RmrSystem(counter(5))
    system.once()
    system.checked({"count": [(5,)]})
    with pytest.raises(WrongResultError, match="the facts of count are wrong"):
        system.checked({"count": [(6,)]})


def test_another_number_of_firings_is_no_result():
    workload = dataclasses.replace(tokens(5), firings=6)
    with pytest.raises(WrongResultError, match="5 firings instead of 6"):
        contest([RmrSystem(workload)], workload.ending, 1, 1)


def test_a_wrong_result_is_told_and_fails_the_whole(monkeypatch, tmp_path, capsys):
    wrong = dataclasses.replace(SUITE[0], make=lambda size: dataclasses.replace(counter(size), ending={"count": []}))
    monkeypatch.setattr(engine, "SUITE", (wrong,))
    file = tmp_path / "engine.json"
    assert engine.main(["--quick", "--rounds", "1", "--only", "counter", "--output", str(file)]) == 1
    assert "counter: RMR: the facts of count are wrong" in capsys.readouterr().err
    assert json.loads(file.read_text())["comparisons"] == []


def test_a_rival_that_is_not_installed_is_told_and_is_no_error():
    record = engine.take("counter", ALONE)
    assert record.errors == []
    assert [(each.rival, each.ratio, each.met) for each in record.comparisons] == [(CLIPS, None, None)]
    assert "not installed" in page.rows(engine.as_data(record, ALONE))[0]
    assert record.met


def test_a_missed_target_fails_the_whole():
    times = timing([Lap(1, 1)], 1)
    missed = engine.Comparison("x", 1, 1, CLIPS, times, times, ratio([Lap(1, 1)], [Lap(0, 1)]), 1.0)
    assert missed.met is False
    assert not engine.Record([missed], [], [], []).met
    assert engine.Record([dataclasses.replace(missed, target=2.0)], [], [], []).met


class Noted(System):
    """Notes when it runs."""

    firings = expected_firings = None

    def __init__(self, name, turns):
        self.name, self._turns = name, turns

    def once(self):
        self._turns.append(self.name)
        return Lap(0.5, 1.5)

    def held(self, predicate):
        return []


def test_every_system_runs_once_in_each_round_and_is_the_first_in_turn():
    turns = []
    laps = contest([Noted(name, turns) for name in "abc"], {"p": []}, rounds=3, runs=1)
    assert "".join(turns) == "abc" + "abcbcacab", "once to warm up"
    assert {name: len(of) for name, of in laps.items()} == {"a": 3, "b": 3, "c": 3}


def test_a_ratio_is_of_one_round_and_counts_the_loading():
    mine, theirs = [Lap(1, 1), Lap(2, 2), Lap(3, 6)], [Lap(0, 4), Lap(1, 3), Lap(2, 1)]
    assert ratio(mine, theirs) == Spread(1.0, 0.75, 2.0)
    assert timing(mine, runs=2).run.median == 1.0


def test_what_one_machine_costs_can_be_taken():
    figures = [*costs.latency({}, 100), *costs.memory({}, 5), *costs.load({}, 1)]
    assert all(figure.value > 0 for figure in figures)
    assert sum(figure.target is not None for figure in figures) == 9


@pytest.mark.parametrize("joins", [True, False])
def test_the_programs_of_the_costs_have_thirty_rules(joins):
    program = costs.compiled(costs.source(joins=joins))
    assert (len(program.rules), len(program.facts)) == (30, 50)


def test_a_page_keeps_what_is_written_by_hand():
    text = f"by hand\n{BEGIN}\nold\n{END}\nmore\n"
    assert page.renewed(text, "new\n") == f"by hand\n{BEGIN}\nnew\n{END}\nmore\n"
    with pytest.raises(ValueError, match="no <!--"):
        page.renewed("by hand\n", "new\n")


def test_a_taking_becomes_a_page_with_its_data(tmp_path, monkeypatch):
    monkeypatch.setattr(page, "installed", lambda module: False)  # no figure
    folder = tmp_path / "benchmarks"
    folder.with_suffix(".md").write_text(f"{BEGIN}\n{END}\n")
    page.write(folder, engine.as_data(engine.take("tokens", ALONE), ALONE))
    assert "| tokens | 500 | 0" in folder.with_suffix(".md").read_text()
    assert json.loads((folder / "engine.json").read_text())["rounds"] == 1


def test_the_page_of_the_project_shows_its_data():
    data = json.loads((DOCS / "benchmarks" / "engine.json").read_text())
    assert {each["workload"] for each in data["comparisons"]} == {entry.title for entry in SUITE}
    text = (DOCS / "benchmarks.md").read_text()
    assert page.renewed(text, page.tables(data)) == text
