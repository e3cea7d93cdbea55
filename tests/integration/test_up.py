"""`rmr up` with real processes: how a run ends, what it leaves behind, and that it leaves no process behind."""

import json
import os
import shutil
import signal
import subprocess
import sys

import pytest
from launched import CORRIDOR, LABS, TESTBED, UP, eventually

DASH = LABS / "dash"


@pytest.fixture
def refused(tmp_path):
    """Return a function that runs `rmr up` to its refusal and returns exit code and message."""

    def run(*arguments):
        answer = subprocess.run([*UP, *map(str, arguments)], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert answer.stdout == ""
        assert "Traceback" not in answer.stderr
        assert not (tmp_path / "runs").exists(), "nothing was to run"
        return answer.returncode, answer.stderr

    return run


@pytest.fixture
def lab(tmp_path):
    """Return a function that makes a copy of the small lab with a text exchanged in one of its files."""

    def make(file, old, new):
        folder = tmp_path / "lab"
        shutil.copytree(DASH, folder)
        path = folder / file
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))
        return folder

    return make


# --- success ------------------------------------------------------------------------------------------------


def test_a_run_that_finishes_leaves_a_report_logs_byte_code_and_no_process(up):
    run = up(DASH)
    assert run.wait() == 0, run.out + run.err
    assert run.left() == []
    report = run.report()
    assert report["finished"]
    assert report["mode"] == "processes"
    assert set(report["robots"]) == {"1", "2", "3"}
    assert all(0 < part["finish_s"] <= report["time_s"] for part in report["robots"].values())
    assert all(part["distance_m"] > 0.4 for part in report["robots"].values())
    assert report["collisions"] == 0
    assert (run.folder / "dash.rbc").read_bytes()
    logs = sorted(path.name for path in (run.folder / "logs").iterdir())
    assert logs == ["robot-1.jsonl", "robot-2.jsonl", "robot-3.jsonl", "world.jsonl"]
    for log in (run.folder / "logs").iterdir():
        assert [json.loads(line) for line in log.read_text().splitlines()]


@pytest.mark.slow
def test_robots_sharing_processes_finish_and_communicate_within_and_between_processes(up):
    run = up(DASH, "--processes", "2")
    assert run.wait() == 0, run.out + run.err
    assert run.left() == []
    report = run.report()
    assert (report["finished"], report["collisions"]) == (True, 0)
    assert sorted(run.pids) == ["robot-1", "robot-2-3", "world"]
    assert all(part["frames"]["received"] > 0 for part in report["robots"].values())


@pytest.mark.slow
def test_a_part_of_the_report_larger_than_a_message_arrives(up):
    run = up(LABS / "ledger", "--robots", "1")
    assert run.wait() == 0, run.out + run.err
    assert (run.folder / "report.json").stat().st_size > 1 << 20
    assert len(run.report()["robots"]["1"]["facts"]) == 16_000


@pytest.mark.slow
def test_with_json_standard_output_is_the_report_and_nothing_else(up):
    run = up(DASH, "--json", "--robots", "1", "--seed", "11")
    assert run.wait() == 0, run.err
    report = json.loads(run.out)
    assert report == run.report()
    assert report["seed"] == 11
    assert set(report["robots"]) == {"1"}
    assert "robot 1  finished" in run.err


@pytest.mark.slow
def test_three_robots_pass_the_corridor_in_the_order_of_their_deadlines(up):
    run = up(CORRIDOR, "--robots", "3", "--strict")
    assert run.wait(100) == 0, run.out + run.err
    report = run.report()
    by_finish = sorted(report["robots"], key=lambda robot: report["robots"][robot]["finish_s"])
    by_deadline = sorted(report["robots"], key=lambda robot: report["robots"][robot]["assertions"][0]["deadline_s"])
    assert by_finish == by_deadline
    assert report["deadlines"] == {"met": 3, "missed": 0, "best_possible": 3}
    assert report["schedule"][0]["order"] == [int(robot) for robot in by_deadline]
    assert run.left() == []


@pytest.mark.slow
def test_a_fifth_of_all_frames_lost_the_robots_still_pass_without_contact(up, tmp_path):
    folder = tmp_path / "lab"
    shutil.copytree(TESTBED, folder)
    path = folder / "lab.yaml"
    path.write_text(path.read_text().replace("loss: 0.0", "loss: 0.2"))
    run = up(folder, "--robots", "3", "--seed", "5")
    assert run.wait(90) == 0, run.out + run.err
    assert run.report()["collisions"] == 0
    assert run.left() == []


@pytest.mark.slow
def test_faults_of_rmr_fault_and_of_the_lab_file_stand_in_the_report_and_in_the_log_of_the_world(up, lab):
    slow = "robot: {speed: 0.04}\nfaults: [{from: 0.1s, to: 0.2s, loss: 0.5}]\nrobots:\n"
    run = up(lab("lab.yaml", "robots:\n", slow)).running()
    words = [sys.executable, "-P", "-m", "rmr_deploy.fault"]
    for wish in (["link", "1,2", "--cut", "--for", "500ms"], ["radio", "--loss", "0.25"]):
        subprocess.run([*words, *wish, "--run", str(run.folder)], check=True, capture_output=True)
    assert run.wait(80) == 0, run.out + run.err
    report = run.report()
    given = {"from": 0.1, "to": 0.2, "loss": 0.5}
    assert given in report["faults"]
    assert report["faults"] == sorted(report["faults"], key=lambda fault: fault["from"])
    cut, loss = (fault for fault in report["faults"] if fault != given)  # the cut may begin before 0.1 s
    assert cut == {"from": cut["from"], "to": round(cut["from"] + 0.5, 3), "link": [1, 2], "cut": True}
    assert loss == {"from": loss["from"], "to": loss["to"], "loss": 0.25}
    assert cut["from"] < loss["from"] < report["time_s"] <= loss["to"] < report["time_s"] + 5
    log = (run.folder / "logs" / "world.jsonl").read_text()
    assert log.count("the lab file disturbs the radio: ") == 1
    assert log.count("rmr fault disturbs the radio: ") == 2


# --- death --------------------------------------------------------------------------------------------------


def test_killed_robot_is_announced_and_reported_with_its_last_known_status(up):
    run = up(DASH).running()
    os.kill(run.pids["robot-2"], signal.SIGKILL)
    assert run.wait() == 1
    assert "robot-2 (pid " in run.out
    assert "was killed by SIGKILL" in run.out
    assert run.report()["died"] == {"robot-2": -9}
    assert set(run.report()["robots"]) == {"1", "2", "3"}
    assert run.left() == []


@pytest.mark.slow
def test_a_world_that_is_killed_ends_the_run_with_a_report(up):
    run = up(DASH).running()
    os.kill(run.pids["world"], signal.SIGKILL)
    assert run.wait() == 1
    assert run.report()["reason"] == "world died"
    assert run.left() == []


@pytest.mark.slow
@pytest.mark.parametrize("victim", ["leader", "follower"])
def test_the_others_pass_the_corridor_without_a_leader_or_a_follower_that_died(up, victim):
    run = up(CORRIDOR, "--robots", "3", "--keep-going").running()
    leader = run.leader("corridor")
    dead = leader if victim == "leader" else next(robot for robot in (1, 2, 3) if robot != leader)
    os.kill(run.pids[f"robot-{dead}"], signal.SIGKILL)
    assert run.wait(110) == 1
    report = run.report()
    finished = [robot for robot, part in report["robots"].items() if part["finish_s"] is not None]
    assert finished == [str(robot) for robot in (1, 2, 3) if robot != dead], run.out
    assert report["collisions"] == 0
    assert report["died"] == {f"robot-{dead}": -9}
    assert run.left() == []


def by_hand(run, robot):
    """Start a robot of a run by hand, as a person would; return its process."""
    endpoint = json.loads((run.folder / "processes.json").read_text())["connect"]
    words = [sys.executable, "-P", "-m", "rmr_agent.main", "--id", str(robot), "--connect", endpoint]
    words += ["--secret", str(run.folder / "secret")]
    with (run.folder / f"by-hand-{robot}").open("w") as said:
        return subprocess.Popen([*words, str(run.folder / "dash.rbc")], stdout=said, stderr=said)


@pytest.mark.slow
def test_with_keep_going_a_robot_started_again_by_hand_restarts_in_the_report_and_the_run_waits_for_it(up, lab):
    run = up(lab("lab.yaml", "robots:\n", "robot: {speed: 0.04}\nrobots:\n"), "--keep-going").running()
    os.kill(run.pids["robot-2"], signal.SIGKILL)
    eventually(lambda: "robot 2  died" in run.out)
    process = by_hand(run, 2)
    try:
        eventually(lambda: "robot 2 is back" in run.out)
        assert run.wait(80) == 1, "a process died"
        assert process.wait(10) == 0, "it is asked to stop like the others"
    finally:
        process.kill()
        process.wait()
    report = run.report()
    assert report["finished"], run.out
    assert report["reason"].startswith("every robot holds the finish fact; robot-2 died")
    assert report["died"] == {"robot-2": -9}
    assert [report["robots"][robot]["restarts"] for robot in "123"] == [0, 1, 0]
    assert all(part["finish_s"] is not None for part in report["robots"].values())
    assert report["time_s"] == max(part["finish_s"] for part in report["robots"].values())
    assert run.out.index("robot 2 is back") < run.out.rindex("robot 2  finished")
    assert run.left() == []


@pytest.mark.slow
def test_with_keep_going_a_robot_started_by_hand_that_dies_too_is_waited_for_no_longer(up, lab):
    run = up(lab("lab.yaml", "robots:\n", "robot: {speed: 0.04}\nrobots:\n"), "--keep-going").running()
    os.kill(run.pids["robot-2"], signal.SIGKILL)
    process = by_hand(run, 2)
    eventually(lambda: "robot 2 is back" in run.out)
    process.kill()
    process.wait()
    eventually(lambda: "robot 2 has left again" in run.out)
    assert run.wait(80) == 1
    report = run.report()
    assert (report["finished"], report["robots"]["2"]["finish_s"]) == (False, None)
    assert report["reason"] == "every robot that lives holds the finish fact; robot 2 died"


def test_a_launcher_that_is_killed_takes_every_process_with_it(up):
    run = up(DASH).running()
    assert len(run.left()) == 4
    run.process.kill()
    eventually(lambda: run.left() == [], 5)


def test_a_stopped_robot_does_not_outlive_a_killed_launcher(up):
    run = up(DASH).running()
    os.kill(run.pids["robot-1"], signal.SIGSTOP)
    run.process.kill()
    eventually(lambda: run.left() == [], 5)


# --- output that nobody takes ------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_closed_standard_output_neither_ends_the_run_nor_loses_the_report(tmp_path):
    words = [*UP, str(DASH), "--run", str(tmp_path / "run")]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=tmp_path, text=True)
    process.stdout.readline()
    process.stdout.close()
    err = process.stderr.read()
    process.stderr.close()
    process.wait(60)
    report = json.loads((tmp_path / "run" / "report.json").read_text())
    assert (report["finished"], report["reason"]) == (True, "every robot holds the finish fact")
    assert err == ""


@pytest.mark.slow
def test_a_report_that_cannot_be_written_is_named_and_the_table_and_the_json_come_out(up):
    run = up(DASH, "--json").running()
    (run.folder / "report.json").mkdir()
    (run.folder / "report.json" / "in the way").touch()
    assert run.wait() == 1
    assert json.loads(run.out)["finished"]
    assert f"rmr up: cannot write {run.folder / 'report.json'}: Is a directory\n" in run.err
    assert "dash: finished after " in run.err
    assert "there is no report" in run.err


@pytest.mark.slow
def test_a_run_folder_that_is_removed_is_made_anew_for_the_report(up):
    run = up(DASH).running()
    shutil.rmtree(run.folder)
    assert run.wait() == 0, run.out + run.err
    assert run.report()["finished"]
    assert f"{run.folder} was removed during the run: its logs and compiled program are lost\n" in run.out + run.err


# --- Ctrl-C -------------------------------------------------------------------------------------------------


def test_ctrl_c_stops_in_order_and_the_report_is_written(up):
    run = up(DASH).running()
    run.interrupt()
    assert run.wait(15) == 1
    report = run.report()
    assert report["reason"] == "interrupted"
    assert not report["finished"]
    assert report["died"] == {}
    assert "Traceback" not in run.out + run.err
    assert run.left() == []


def test_ctrl_c_twice_stops_at_once(up):
    run = up(DASH).running()
    run.interrupt()
    run.interrupt()
    assert run.wait(5) == 1
    assert run.left() == []


FAULTS = (
    "[{at: 500ms, kill: 3}, {at: 1s, restart: 3}, {from: 500ms, to: 1s, stall: 2}, {from: 200ms, to: 1s, outage: 1}]"
)


@pytest.mark.slow
def test_faults_of_robots_in_the_lab_file_are_performed_on_processes_and_reported(up, lab):
    text = "lab.yaml", "robots:\n", f"faults: {FAULTS}\nrobot: {{speed: 0.04}}\nrobots:\n"
    run = up(lab(*text), "--robots", "3").running()
    assert run.wait(80) == 0, run.out + run.err
    report = run.report()
    done = [(one, entry[one]) for entry in report["faults"] for one in entry if one not in ("at", "from", "to")]
    assert sorted(done) == [("kill", 3), ("outage", 1), ("restart", 3), ("stall", 2)]
    assert report["robots"]["3"]["restarts"] == 1
    assert (report["finished"], report["dead"], report["died"]) == (True, [], {"robot-3": -9})
    events = [json.loads(line) for line in (run.folder / "events.jsonl").read_text().splitlines()]
    assert [one["fault"] for one in events if one["event"] == "fault"][-1] == {"at": 1.0, "restart": 3}
    assert "robot 1 hears no beacon until" in (run.folder / "logs" / "world.jsonl").read_text()


# --- bad input ----------------------------------------------------------------------------------------------


def test_a_lab_that_is_not_there_is_wrong_usage(refused):
    code, message = refused("nowhere")
    assert code == 2
    assert "nowhere" in message


@pytest.mark.parametrize("seed", [10**18, -1])
def test_seed_out_of_the_range_of_messages_is_wrong_usage(refused, seed):
    code, message = refused(DASH, "--seed", seed)
    assert code == 2
    assert "a whole number from 0 to 999999999999999999" in message


def test_every_mistake_of_a_lab_file_is_shown_at_once_with_its_place(refused, lab):
    code, message = refused(lab("lab.yaml", "robots:\n", "colour: red\nrobots:\n  - {id: 9, pose: [99, 0, 0deg]}\n"))
    assert code == 3
    assert "colour" in message
    assert "robots.0" in message
    assert "lab.yaml:" in message


def test_a_program_with_a_mistake_is_shown_with_its_place(refused, lab):
    code, message = refused(lab("dash.rmr", "start(R) -o moveto(R, goal).", "start(R) -o moveto(R, G)."))
    assert code == 3
    assert "dash.rmr:8:" in message
    assert "error[E" in message


def test_an_area_that_the_lab_does_not_define_is_an_error(refused, lab):
    code, message = refused(lab("dash.rmr", "moveto(R, goal)", "moveto(R, gaol)"))
    assert code == 3
    assert "'gaol'" in message
    assert "'goal'" in message


def test_a_program_whose_action_has_no_handler_does_not_start(refused, lab):
    code, message = refused(
        lab("dash.rmr", "start(R).\n", "type action blink(robot).\nstart(R).\nstart(R) -o blink(R).\n")
    )
    assert code == 3
    assert "no handler for action blink, declared at " in message


def test_more_robots_than_the_lab_has_are_an_error(refused):
    code, message = refused(DASH, "--robots", "4")
    assert code == 3
    assert "3 robots" in message


def test_byte_code_that_is_damaged_does_not_run(refused, lab, tmp_path):
    (tmp_path / "broken.rbc").write_bytes(b"RMR\x00garbage")
    code, message = refused(lab("lab.yaml", "program: dash.rmr", "program: ../broken.rbc"))
    assert code == 3
    assert "broken.rbc" in message


def test_a_run_folder_in_use_is_wrong_usage(refused, tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "report.json").write_text("{}")
    code, message = refused(DASH, "--run", tmp_path / "full")
    assert code == 2
    assert "not empty" in message


def test_a_run_folder_that_cannot_be_written_is_wrong_usage(refused, tmp_path):
    (tmp_path / "blocked").write_text("a file")
    code, message = refused(DASH, "--run", tmp_path / "blocked")
    assert code == 2
    assert "blocked: " in message
