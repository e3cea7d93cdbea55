"""The loads of a lab file in `rmr up`: a robot distributes each over the radio, the report tells its outcome."""

import json

import pytest

OLD = "type note(robot, int).\nnote(R, 1).\n"
NEW = "type note(robot, int).\nnote(R, 2).\n"
LAB = """
lab: notes
program: old.rmr
duration: {duration}
arena: {{size: [3.0, 3.0]}}
robots: [{{ids: 1-2, grid: {{from: [0.4, 0.4], step: [0.5, 0], columns: 2}}}}]
radio: {{loss: {loss}}}
loads: [{{at: {at}, program: new.rmr}}]
"""


def lab_in(folder, at, duration, new=NEW, loss=0.0):
    (folder / "old.rmr").write_text(OLD)
    (folder / "new.rmr").write_text(new)
    (folder / "lab.yaml").write_text(LAB.format(at=at, duration=duration, loss=loss))
    return folder / "lab.yaml"


@pytest.mark.slow
def test_load_of_the_lab_file_is_distributed_by_a_robot_and_told_in_report_and_events(up, tmp_path):
    launched = up(lab_in(tmp_path, "0.5s", "14s"), "--no-view", "--no-record")
    assert launched.wait() == 0, launched.err
    report = launched.report()
    (load,) = report["loads"]
    assert (load["file"], load["switched"]) == ("new.rmr", True)
    assert load["by"] in {1, 2}
    assert 0.5 <= load["begin_s"] < load["at_s"]
    assert load["robots"]["2"]["carried"] == 1
    assert {robot: report["robots"][robot]["facts"] for robot in ("1", "2")} == {
        "1": ["note(@1, 1)", "note(@1, 2)"],
        "2": ["note(@2, 1)", "note(@2, 2)"],
    }
    events = [json.loads(line) for line in (launched.folder / "events.jsonl").read_text().splitlines()]
    assert [event["load"] for event in events if event["event"] == "load"] == [load]
    assert launched.left() == []


def test_load_that_is_under_way_when_the_run_ends_is_told_as_undecided(up, tmp_path):
    launched = up(lab_in(tmp_path, "0.2s", "1s", loss=0.99), "--no-view", "--no-record")
    assert launched.wait() == 0, launched.err
    (load,) = launched.report()["loads"]
    assert (load["switched"], load["problem"]) == (None, "the run was over before it was decided")
    assert launched.left() == []


@pytest.mark.parametrize(
    ("new", "options", "said"),
    [
        ("note(R, \n", (), "new.rmr"),
        (NEW, ("--durable",), "loads: the state of a durable robot belongs to its program"),
    ],
)
def test_load_that_cannot_be_is_refused_before_the_run(up, tmp_path, new, options, said):
    launched = up(lab_in(tmp_path, "0.5s", "5s", new), "--no-view", *options)
    assert launched.wait() == 3
    assert said in launched.err
