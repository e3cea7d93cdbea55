"""The score goes red when a row is worse than landed, and only then."""

import json
import re
from pathlib import Path

import pytest
import score
import score_table
from score_run import Entry, drawn_entry, taken
from score_table import compared, cost_ratio, failures

FINE = {
    "name": "lab",
    "seed": 1,
    "finished": True,
    "contacts": 0,
    "violations": {},
    "met": 20,
    "missed": 0,
    "time_s": 50.0,
    "bound_s": 25.0,
    "wrong": [],
    "lab_s": 50.0,
    "cost": 4.0,
}
REFUSED = {"name": "lab", "seed": 1, "refused": ["lab.yaml:1: areas: too small"]}


def worse(landed=FINE, name="lab", **changed):
    return list(compared(name, {**FINE, **changed}, landed).worse)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"finished": False, "wrong": ["not finished"]}, "not finished 0 -> 1"),
        ({"contacts": 1, "wrong": ["1 contact"]}, "contacts 0 -> 1"),
        ({"violations": {"stands still": 2}, "wrong": ["stands still (2)"]}, "stands still 0 -> 2"),
        ({"wrong": ["KeyError: 3"]}, "errors 0 -> 1"),
        ({"met": 18, "missed": 2}, "deadlines 20 -> 18"),
        ({"time_s": 52.6}, "time 50.0 s -> 52.6 s"),
    ],
)
def test_what_is_worse_is_red(changed, words):
    assert worse(**changed) == [words]


@pytest.mark.parametrize("changed", [{}, {"met": 19, "missed": 1}, {"time_s": 52.4}, {"cost": 40.0}])
def test_what_is_equal_or_hardly_worse_is_not_red(changed):
    assert worse(**changed) == []


def test_a_known_failure_is_red_only_when_it_gets_worse():
    known = {**FINE, "contacts": 2, "finished": False, "wrong": ["not finished", "2 contacts"]}
    assert compared("lab", known, known) == score_table.Verdict("lab", (), ())
    assert compared("lab", {**known, "contacts": 3}, known).worse == ("contacts 2 -> 3",)
    mended = compared("lab", FINE, known)
    assert mended.worse == ()
    assert set(mended.better) == {"contacts 2 -> 0", "not finished 1 -> 0"}


def test_a_new_lab_is_red_if_it_fails():
    assert worse(landed=None) == []
    assert worse(landed=None, contacts=1) == ["contacts 0 -> 1"]


def test_a_refusal_is_red_where_nothing_was_wrong_and_for_a_provided_lab():
    known = {**FINE, "contacts": 2, "wrong": ["2 contacts"]}
    assert compared("drawn/1", REFUSED, known) == score_table.Verdict("drawn/1", (), ("refused",))
    assert compared("drawn/1", REFUSED, REFUSED) == score_table.Verdict("drawn/1", (), ())
    assert compared("drawn/1", REFUSED, None).worse == ()
    assert compared("drawn/1", REFUSED, FINE).worse == ("refused",)
    assert compared("corridor", REFUSED, known).worse == ("refused",)


def test_processor_time_is_judged_in_sum_weighed_with_the_landed_lab_time():
    landed = {"a": FINE, "b": {**FINE, "cost": 1.0, "lab_s": 200.0}, "c": REFUSED}
    now = {"a": {**FINE, "cost": 6.0, "lab_s": 10.0}, "b": landed["b"], "c": FINE, "new": FINE}
    assert cost_ratio(now, landed) == pytest.approx((6.0 * 50 + 200) / (4.0 * 50 + 200))
    assert cost_ratio({"new": FINE}, landed) is None


@pytest.mark.parametrize(("cost", "red"), [(4.3, False), (4.5, True)])
def test_the_score_is_red_from_a_tenth_more_processor_time_in_sum(cost, red, capsys):
    rows = {"lab": {**FINE, "cost": cost}}
    assert score.judge(rows, {"form": score.form()}, {"lab": FINE}, {"lab": "rmr sim lab"}) is red
    assert ("RED" in capsys.readouterr().out) is red


def test_processor_time_of_another_form_of_the_program_is_not_compared(capsys):
    rows = {"lab": {**FINE, "cost": 40.0}}
    assert not score.judge(rows, {"form": "another"}, {"lab": FINE}, {"lab": "rmr sim lab"})
    assert "not compared" in capsys.readouterr().out


def test_what_is_red_is_told_with_the_command_that_repeats_it(capsys):
    rows = {"lab": {**FINE, "contacts": 1, "wrong": ["1 contact"]}}
    assert score.judge(rows, {}, {"lab": FINE}, {"lab": "rmr sim lab --seed 1"})
    assert "RED  lab: contacts 0 -> 1\n    rmr sim lab --seed 1\n" in capsys.readouterr().out


def test_a_table_that_is_written_reads_the_same(tmp_path):
    rows = {"drawn/10": {**FINE, "name": "drawn/10"}, "drawn/9": {**REFUSED, "name": "drawn/9"}, "lab": FINE}
    path = tmp_path / "landed.jsonl"
    score_table.write({"form": "interpreted"}, rows, path)
    assert score_table.read(path) == ({"form": "interpreted"}, rows)
    assert [json.loads(line).get("name") for line in path.read_text().splitlines()] == [
        None,
        "lab",
        "drawn/9",
        "drawn/10",
    ]


def test_every_lab_file_of_the_tree_is_in_the_score_and_in_that_of_ci():
    files = {file for folder in score.LABS for file in (score.ROOT / folder).rglob("*.yaml")}
    assert {entry.lab for entry in score.provided()} == files
    assert {entry.lab for entry in score.in_ci(score.provided())} == files
    assert len({entry.name for entry in score.provided()}) == len(files)


def test_the_landed_table_has_a_row_for_each_run_of_the_score_and_of_ci():
    head, landed = score_table.read()
    assert head["form"] == "interpreted"
    wanted = [*score.provided(), *score.in_ci(score.provided())]
    wanted += [drawn_entry(seed) for seed in score.DRAWN_SEEDS]
    assert {entry.name for entry in wanted} == set(landed)


def test_a_row_says_what_a_run_is_judged_by():
    lab = score.ROOT / "deploy" / "labs" / "formation" / "lab.yaml"
    row = taken(Entry("formation", 1, lab), calibration=lambda: 0.001)
    assert (row["finished"], row["contacts"], row["violations"], row["missed"]) == (True, 0, {}, 0)
    assert row["cost"] > 0.0
    assert row["off_m"] < 0.05
    assert failures(row) == {}


def test_a_lab_that_is_refused_has_a_row_that_says_why(tmp_path):
    text = (score.ROOT / "deploy" / "labs" / "formation" / "lab.yaml").read_text()
    file = tmp_path / "lab.yaml"
    file.write_text(re.sub("finish: .*", "finish: at(R, nowhere)", text))
    (tmp_path / "formation.rmr").write_text((score.ROOT / "deploy/labs/formation/formation.rmr").read_text())
    row = taken(Entry("wrong", 1, Path(file)))
    assert "nowhere" in row["refused"][0]
    assert failures(row) == {}


@pytest.mark.parametrize(
    ("entry", "command"),
    [
        (drawn_entry(7), "python tests/score/drawn_lab.py 7 && rmr sim build/drawn/7"),
        (drawn_entry(7, chaos=True), "python tests/score/drawn_lab.py 7 && rmr sim build/drawn/7 --chaos"),
        (
            Entry("hall, 20 robots", 1, score.ROOT / "deploy" / "labs" / "hall" / "lab.yaml", {"robots": 20}),
            "rmr sim deploy/labs/hall/lab.yaml --seed 1 --robots 20",
        ),
    ],
)
def test_a_run_is_repeated_by_one_command(entry, command):
    assert entry.command == command
