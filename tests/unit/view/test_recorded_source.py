"""A recording in the page: what the server tells of it is what happened in the run."""

import json
import re
from pathlib import Path
from urllib.parse import quote

import pytest
from command_runner import invoke
from served_page import heard, served

from rmr.commands.replay_command import command as replay
from rmr_deploy.why_program import why_command
from rmr_sim.main import command as sim
from rmr_view.recorded_source import RecordedSource
from rmr_world.provided_labs import labs_folder

pytestmark = pytest.mark.medium


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded") / "run"
    lab = labs_folder() / "corridor"
    answer = invoke(sim(), [str(lab), "--robots", "3", "--run", str(folder)], name="rmr sim")
    assert answer.exit_code == 0, answer.stderr
    return folder


@pytest.fixture(scope="module")
def report(folder):
    return json.loads((folder / "report.json").read_text())


@pytest.fixture(scope="module")
def browser(folder):
    with served(RecordedSource(folder), token=None) as browser:
        yield browser


def test_run_has_floor_program_and_report(browser, report):
    run = browser.get("/api/run")
    assert (run["lab"], run["mode"], run["robots"], run["live"], run["control"]) == (
        "corridor", "simulated", [1, 2, 3], False, False
    )  # fmt: skip
    assert run["problems"] == []
    assert run["floor"]["passages"] == [["bottleneck", ["entry"]]]
    assert run["program"]["name"] == "corridor.rmr"
    assert "time" in run["program"]["source"]
    assert run["report"] == report
    assert run["end_s"] >= report["time_s"] - 0.001, "the report rounds to milliseconds"


def test_jobs_of_the_timeline_are_those_of_the_report(browser, report):
    lanes = {lane["robot"]: lane for lane in browser.get("/api/timeline")["lanes"]}
    for robot, part in report["robots"].items():
        (told,) = lanes[int(robot)]["deadlines"]
        (job,) = part["assertions"]
        assert (told["job"], told["met"], round(told["finish_s"], 3)) == (job["job"], job["met"], job["finish_s"])
        kinds = [one["kind"] for one in lanes[int(robot)]["intervals"]]
        assert kinds[0] == "asking"
        assert kinds[-1] == "inside"


def test_tracks_reach_from_start_to_end_with_estimates_near_the_truth(browser):
    poses = browser.get("/api/poses")
    run = browser.get("/api/run")
    assert poses["t"][0] == 0.0
    assert poses["t"][-1] >= run["end_s"] - 0.2
    track = poses["robots"]["2"]
    index = poses["t"].index(5.0)
    estimate = poses["estimates"]["2"]
    near = min(range(len(estimate["t"])), key=lambda i: abs(estimate["t"][i] - 5.0))
    assert abs(estimate["x"][near] - track["x"][index]) < 0.05


def test_frames_routes_and_trace_are_read_by_their_window(browser):
    for kind in ("frames", "routes", "trace"):
        entries = browser.get(f"/api/{kind}?begin=2&end=8")["entries"]
        assert entries
        assert all(1.9 <= entry["t"] <= 8 for entry in entries)


def test_robot_at_an_instant_is_replayed_and_at_the_end_is_the_reports(browser, report):
    late = browser.get("/api/robot/2")
    part = report["robots"]["2"]
    assert (late["facts"], late["goals"]) == (part["facts"], part["goals"])
    assert "at(@2, exit)" in late["sensed"]
    assert late["problem"] is None
    early = browser.get("/api/robot/2?t=2.0")
    assert "at(@2, exit)" not in early["sensed"]
    assert all(one["t"] <= 2.0 for one in early["fired"])
    assert [action["end_s"] for action in early["actions"]] == [None]
    assert early["route"]
    assert early["fired"] == [one for one in late["fired"] if one["t"] <= 2.0]


def test_why_is_the_answer_of_rmr_why(browser, folder):
    fact = "waiting(@2)"
    told = invoke(why_command(), [str(folder), fact, "--json"], name="rmr why")
    assert told.exit_code == 0, told.stderr
    assert {"version": 1, **browser.get(f"/api/why?robot=2&fact={fact}")} == json.loads(told.stdout)


def stepped(folder, *lines):
    """Return what the terminal's form prints after each line."""
    told = invoke(replay, [str(folder), "--robot", "2", "--step"], name="rmr replay", text="\n".join(lines))
    return [block.splitlines() for block in re.split(r"^@2 .* s> .*\n", told.stdout, flags=re.MULTILINE)[1:]]


def test_step_leads_to_the_stops_of_the_terminal_and_tells_the_same_there(browser, folder):
    lines = ["next", "until at(@2, exit)", "back input 2", "to 1.5s", "back", "step 3", "start", "end"]
    asked = ["show", "facts", "goals", "agenda"]
    blocks = stepped(folder, *[each for line in lines for each in (line, *asked)])
    at = -1
    for place, line in enumerate(lines):
        found = browser.get(f"/api/step?robot=2&at={at}&do={quote(line)}")
        at = found["at"]
        _, stop, facts, goals, agenda = blocks[5 * place : 5 * place + 5]
        assert found["stop"] == stop
        assert [*found["facts"], *(f"{each}  (sensed)" for each in found["sensed"])] == [
            each for each in facts if each != "no facts"
        ]
        assert found["goals"] == [each for each in goals if each != "no goal is open"]
        assert found["agenda"] == agenda
        assert found["nowhere"] is None
    assert at == found["stops"] - 1


def test_step_has_breakpoints_and_what_was_passed_over(browser, folder):
    first = browser.get("/api/step?robot=2")
    assert (first["at"], first["stop"], first["passed"]) == (-1, ["before the first input"], None)
    rule = next(each["rule"] for each in first["rules"] if each["fires"] == 1 and each["rule"].endswith(":21"))
    found = browser.get(f"/api/step?robot=2&at=-1&do={quote(f'break {rule}')}%0Acontinue")
    assert f"rule {rule}" in found["stop"][0]
    assert found["passed"] == stepped(folder, "break 21", "continue", "passed")[2]
    again = browser.get(f"/api/step?robot=2&at={found['at']}&do={quote(f'break {rule}')}%0Acontinue")
    assert (again["at"], again["nowhere"].partition(" after")[0]) == (
        found["at"], "there is no firing of a rule with a breakpoint"
    )  # fmt: skip


@pytest.mark.parametrize("line", ["to soon", "until at(@2", "until nothing(@2)", "continue", "break 99", "next 0"])
def test_step_that_is_none_is_refused_with_the_sentence_of_the_terminal(browser, folder, line):
    status, content, _ = browser.fetch(f"/api/step?robot=2&do={quote(line)}")
    assert status == 400
    assert stepped(folder, line) == [[f"error: {content['error']}"]]


def test_client_of_a_recording_gets_its_end_at_once(browser, report):
    with browser.follow() as following:
        clock = heard(following, "clock")
        assert (clock["running"], clock["speed"]) == (False, None)
        assert heard(following, "end")["report"] == report


def test_recording_cut_short_is_shown_as_far_as_it_reaches(folder, tmp_path):
    octets = (folder / "run.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(octets[: len(octets) // 2])
    with served(RecordedSource(cut), token=None) as browser:
        run = browser.get("/api/run")
        assert len(run["problems"]) >= 1
        assert "cut short" in run["problems"][0]
        assert 1.0 < browser.get("/api/poses")["t"][-1] <= run["end_s"]
        assert browser.get("/api/robot/2?t=1")["facts"]
        found = browser.get("/api/step?robot=2&do=end")
        assert (found["stops"] > 2, found["t"] <= run["end_s"]) == (True, True)
        assert any("cut short" in problem for problem in found["problems"])


def test_file_that_is_replaced_by_other_octets_is_refused(tmp_path):
    for name, octets in (("empty.mcap", b""), ("text.mcap", b"hello"), ("zeros.mcap", b"\0" * 100)):
        file = Path(tmp_path / name)
        file.write_bytes(octets)
        with pytest.raises(Exception, match=name):
            RecordedSource(file)
