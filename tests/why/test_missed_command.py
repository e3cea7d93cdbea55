"""`rmr why RUN --missed` on a recorded run: forms of the answer, wrong questions, and the hint at the end of a run."""

import json
import re
from itertools import pairwise
from pathlib import Path

import pytest
from command_runner import invoke

from rmr_deploy.why_program import why_command
from rmr_sim.main import main as simulate

pytestmark = pytest.mark.medium

PAGE = (Path(__file__).parents[2] / "docs" / "why-late.md").read_text("utf-8")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The first run of docs/why-late.md: three missed deadlines."""
    folder = tmp_path_factory.mktemp("missed")
    for name in ("late.rmr", "late.yaml"):
        (folder / name).write_text(re.search(rf"^```\w+ {name}\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)[1])
    simulate([str(folder / "late.yaml"), "--run", str(folder / "run")])
    return folder / "run"


def why(*words):
    return invoke(why_command(), [str(word) for word in words], name="rmr why")


def told(*words):
    """Return what a question that cannot be answered is answered, with its exit code."""
    result = why(*words)
    assert result.stdout == ""
    return result.stderr.splitlines()[0].removeprefix("rmr why: "), result.exit_code


def test_json_has_intervals_that_sum_to_the_lateness_after_the_deadline(run):
    data = json.loads(why(run, "--missed", "crossing@1", "--json").stdout)
    [delay] = data["delays"]
    assert data["problems"] == []
    spans = [(each["begin_ns"], each["end_ns"]) for each in delay["intervals"]]
    assert spans[0][0] == delay["start_ns"]
    assert spans[-1][1] == delay["end_ns"]
    assert all(one[1] == other[0] for one, other in pairwise(spans))
    late = sum(each["end_ns"] - each["begin_ns"] for each in delay["intervals"] if each["after_deadline"])
    assert late == delay["end_ns"] - delay["deadline_ns"] == round(delay["lateness_s"] * 1e9)
    assert sum(owner["ns"] for owner in delay["owners"]) == delay["end_ns"] - delay["start_ns"]
    assert [owner["ns"] for owner in delay["owners"]] == sorted((o["ns"] for o in delay["owners"]), reverse=True)


def test_stalled_robot_is_named_by_those_that_stand_for_it(run):
    data = json.loads(why(run, "--missed", "--json").stdout)
    by_robot = {delay["robot"]: delay for delay in data["delays"]}
    assert sorted(by_robot) == [1, 2, 3]
    stood = [i for i in by_robot[3]["intervals"] if i["owner"] == "standing" and i["begin_ns"] / 1e9 > 3.5]
    assert max(stood, key=lambda i: i["s"])["whom"] == [2]
    assert sum(i["s"] for i in stood) > 1.0
    assert any(each["owner"] == "late tick" and each["s"] > 1.9 for each in by_robot[2]["intervals"])


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["crossing"], "'crossing' names no job: write the assertion and the robot, such as crossing@3"),
        (["crosing@1"], "no job of this run is called crosing; there are crossing"),
        (["crossing@9"], "robot 9 has no log in this recording; robots 1-3 have"),
        (["crossing@1", "--at", "99s"], "crossing@1 did not run at 99.000 s, but from 0.000 to 12.050 s"),
        (["--timeline"], "--timeline is for one job: write the assertion and the robot, such as crossing@3"),
        (["--at", "3s"], "--at is for one job: write the assertion and the robot, such as crossing@3"),
        (["crossing@1", "--not"], "--missed explains the time of deadlines: --not does not go with it"),
        (["crossing@1", "--dot"], "--missed explains the time of deadlines: --dot does not go with it"),
    ],
)
def test_wrong_question_about_a_deadline_is_told(run, words, sentence):
    assert told(run, "--missed", *words) == (sentence, 2)


def test_question_without_fact_and_timeline_without_missed_are_told(run):
    assert told(run) == ("FACT is missing, such as 'at(@4, exit)'; or give --missed", 2)
    assert told(run, "at(@1, exit)", "--timeline") == ("--timeline is a form of --missed crossing@3", 2)


def test_run_without_recording_is_told(tmp_path):
    (tmp_path / "empty").mkdir()
    sentence, code = told(tmp_path / "empty", "--missed")
    assert code == 3
    assert "no recording of a run" in sentence


def test_recording_cut_short_is_explained_as_far_as_it_goes(run, tmp_path):
    octets = (run / "run.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(octets[: len(octets) // 2])
    result = why(cut, "--missed")
    assert result.exit_code == 0
    assert "cut short" in result.stderr


def test_run_with_missed_deadlines_ends_with_the_command_that_explains_them(run, capsys):
    lab = run.parent / "late.yaml"
    simulate([str(lab), "--run", str(run.parent / "again")])
    hint = f"why 3 deadlines were missed: rmr why {run.parent / 'again'} --missed"
    assert hint in capsys.readouterr().err
    simulate([str(lab), "--run", str(run.parent / "unrecorded"), "--no-record"])
    assert "rmr why" not in capsys.readouterr().err


PERMIT = """
type action wait(robot, float).
type !done(robot).
type !over(robot).
start(@1).
asked(@2).
done_in_time: assert(asked(R), done(R), 20, say(R, "late")).
start(R) -o wait(R, 2) then permit(@2).
permit(R) -o done(R), over(R), over(@1).
"""
UNHEARD = """
lab: permit
program: permit.rmr
seed: 1
duration: 60s
finish: over(R)
arena: {size: [1.5, 1.0]}
robots: [{id: 1, pose: [0.3, 0.3, 0deg]}, {id: 2, pose: [0.9, 0.3, 0deg]}]
faults: [{from: 1s, to: 51s, loss: 1.0}]
"""


def test_deliveries_that_were_given_up_stand_below_the_answer(tmp_path):
    """Robot 2 waits for the permit of robot 1, which a radio that carries nothing for 50 s loses."""
    (tmp_path / "permit.rmr").write_text(PERMIT)
    (tmp_path / "permit.yaml").write_text(UNHEARD)
    simulate([str(tmp_path / "permit.yaml"), "--run", str(tmp_path / "run")])
    line = "not delivered: permit(@2) from robot 1 to robot 2, given up 47.0"
    for question in ([], ["done_in_time@2"]):
        text = why(tmp_path / "run", "--missed", *question).stdout
        assert text.splitlines()[-1].startswith(line), text
        [lost] = json.loads(why(tmp_path / "run", "--missed", *question, "--json").stdout)["undelivered"]
        assert (lost["robot"], lost["destination"], lost["why"]) == (1, 2, "no acknowledgement")
        assert 45 <= lost["at_s"] - 2 < 45.1
