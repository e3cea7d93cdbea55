"""The verbs of a fleet upon launchers whose processes are stand-ins."""

import json
import shutil
import signal
import subprocess
import sys

import pytest
from fleet_runs import StandinRun, eventually, rmr, rows

from rmr_deploy.active_runs import REGISTER_VARIABLE, active_runs, register, write_processes
from rmr_deploy.process_identity import lives
from rmr_deploy.run_choice import how_to_start
from rmr_deploy.run_requests import ask_launcher

pytestmark = pytest.mark.slow


@pytest.fixture
def start(tmp_path, monkeypatch):
    """Return a function that starts a run of stand-ins; verbs are carried out in the same folder."""
    monkeypatch.setenv(REGISTER_VARIABLE, str(tmp_path / "register"))
    monkeypatch.chdir(tmp_path)
    started = []

    def make(first, second, *options, name="standin"):
        run = StandinRun(tmp_path, name, first, second, *options)
        started.append(run)
        return run

    yield make
    for run in started:
        run.end()


def refused(answer, code=2):
    assert (answer.exit_code, answer.stdout) == (code, "")
    return answer.stderr


def test_verbs_without_a_lab_say_how_to_start_one(tmp_path, monkeypatch):
    monkeypatch.setenv(REGISTER_VARIABLE, str(tmp_path / "register"))
    monkeypatch.chdir(tmp_path)
    for verb in ("ps", "down"):
        assert refused(rmr(verb)) == f"rmr {verb}: no lab runs on this machine; {how_to_start()}\n"
    for verb in ("wait", "logs", "events"):
        assert "no run of it has left a folder in ./runs; start one with rmr up LAB -d" in refused(rmr(verb))
    answer = rmr("ls")
    first, second = answer.stdout.splitlines()
    assert (answer.exit_code, first) == (0, "no lab runs on this machine; start one with rmr up LAB -d")
    assert second.startswith(
        f"looked in ./runs and {tmp_path / 'register'}; a lab that is not there is found by its run"
    )
    assert how_to_start() == (
        "start one with rmr up LAB -d, or name its run folder with --run "
        f"(looked in ./runs and {tmp_path / 'register'})"
    )
    assert json.loads(rmr("ls", "--json").stdout) == {"version": 1, "labs": []}
    assert rmr("down", "--all").exit_code == 0


def test_run_is_listed_shown_waited_for_and_brought_down(start):
    run = start("roam", "finish").running()
    (row,) = json.loads(rmr("ls", "--json").stdout)["labs"]
    assert (row["lab"], row["state"], row["robots"], row["folder"]) == ("standin", "running", 2, "run-standin")
    assert row["launcher"] == run.process.pid
    eventually(lambda: rows()["robot-2"]["state"] == "finished")
    shown = rows()
    assert list(shown) == ["launcher", "world", "robot-1", "robot-2"]
    assert {name: row["pid"] for name, row in shown.items() if name != "launcher"} == run.pids()
    assert shown["robot-1"]["state"] == "running"
    assert shown["robot-1"]["progress"].startswith("turn ")
    assert rmr("ps").stdout.splitlines()[0].split() == ["NAME", "STATE", "PID", "UP", "RESTARTS", "DOING"]
    assert "standin still runs after 0 s" in refused(rmr("wait", "--timeout", "0"), 1)
    answer = rmr("down")
    assert (answer.exit_code, answer.stdout, answer.stderr) == (
        0,
        "lab standin is down; the report is run-standin/report.json\n",
        "",
    )
    assert run.wait() == 1, "not every robot has finished"
    assert not any(map(lives, run.pids().values()))
    assert "no lab runs" in refused(rmr("ps"))
    answer = rmr("wait", "--run", "run-standin")
    assert (answer.exit_code, answer.stdout) == (1, "lab standin: interrupted; exit code 1\n")
    states = {name: row["state"] for name, row in rows("--run", "run-standin").items()}
    assert states == dict.fromkeys(("launcher", "world", "robot-1", "robot-2"), "ended")
    assert register() is not None
    assert list(register().iterdir()) == []


def test_with_several_labs_they_are_named_and_one_is_chosen(start):
    first = start("roam", "roam", name="east").running()
    second = start("roam", "roam", name="west").running()
    assert refused(rmr("ps")) == (
        "rmr ps: several labs run: east (run-east), west (run-west); choose with --run DIR or --lab NAME\n"
    )
    assert rows("--lab", "west")["launcher"]["pid"] == second.process.pid
    assert rows("--run", "run-east")["launcher"]["pid"] == first.process.pid
    assert "no lab moon runs on this machine; what runs: east (run-east), west (run-west)" in refused(
        rmr("down", "--lab", "moon")
    )
    assert "--all goes without --run, --lab and --connect" in refused(rmr("down", "--all", "--lab", "east"))
    assert rmr("down", "--all").exit_code == 0
    assert active_runs() == []


@pytest.mark.parametrize("verb", [["ps"], ["stats", "--once"], ["facts"], ["stop", "1"], ["down"]])
def test_folder_of_a_run_decides_where_another_register_is_used(start, tmp_path, monkeypatch, verb):
    run = start("roam", "roam").running()
    eventually(lambda: rmr("facts", "1").exit_code == 0)
    monkeypatch.setenv(REGISTER_VARIABLE, str(tmp_path / "another"))
    assert "looked in ./runs and" in refused(rmr(*verb))
    answer = rmr(*verb, "--run", str(run.folder))
    assert answer.exit_code == 0, answer.stderr


def test_run_that_cannot_be_registered_says_so(start, tmp_path, monkeypatch):
    (tmp_path / "no folder").write_text("")
    monkeypatch.setenv(REGISTER_VARIABLE, str(tmp_path / "no folder"))
    run = start("roam", "roam").running()
    eventually(lambda: "this run is not in the register: there is no folder for it that only you can" in run.said)
    (event,) = [line for line in (run.folder / "events.jsonl").read_text().splitlines() if '"started"' in line]
    assert json.loads(event)["warning"].endswith(f"other commands find it by --run {run.folder} alone")
    assert rmr("down", "--run", str(run.folder)).exit_code == 0


def test_run_whose_folder_was_removed_is_brought_down(start):
    run = start("roam", "roam").running()
    pids = run.pids()
    shutil.rmtree(run.folder)
    (row,) = json.loads(rmr("ls", "--json").stdout)["labs"]
    assert row["state"] == "running, folder removed"
    assert rows()["robot-1"]["state"] == "running", "as the system tells"
    assert "was removed" in refused(rmr("logs"), 1)
    answer = rmr("down")
    assert answer.exit_code == 0
    assert answer.stdout.startswith("lab standin is down; ")
    run.wait()
    assert not any(map(lives, pids.values()))


def test_launcher_that_hangs_is_killed_and_nothing_is_left(start):
    run = start("roam", "roam").running()
    pids = run.pids()
    run.process.send_signal(signal.SIGSTOP)
    answer = rmr("down", "--timeout", "0.5")
    assert answer.exit_code == 0
    assert f"the launcher (pid {run.process.pid}) did not end in 0.5 s" in answer.stderr
    assert run.wait() == -signal.SIGKILL
    assert not any(map(lives, pids.values()))
    assert "how the run of lab standin ended is not known: its launcher was killed" in refused(
        rmr("wait", "--run", "run-standin"), 1
    )


def test_processes_that_a_dead_launcher_has_left_are_ended_by_their_ids(tmp_path, monkeypatch):
    monkeypatch.setenv(REGISTER_VARIABLE, str(tmp_path / "register"))
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "runs" / "old"
    folder.mkdir(parents=True)
    idle = [subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"]) for _ in range(3)]
    try:
        pids = {"world": idle[0].pid, "robot-1": idle[1].pid, "robot-2": idle[2].pid}
        write_processes(folder, "tcp/127.0.0.1:7", pids, {"name": "old", "roster": [1, 2]})
        record = json.loads((folder / "processes.json").read_text())
        record["started"] |= {"launcher": "gone", "robot-2": "of another process"}
        for path in (folder / "processes.json", next(register().iterdir())):
            path.write_text(json.dumps({**record, "folder": str(folder)}))
        idle[0].send_signal(signal.SIGSTOP)
        (row,) = json.loads(rmr("ls", "--json").stdout)["labs"]
        assert row["state"] == "stranded"
        answer = rmr("down")
        assert answer.exit_code == 0, answer.stderr
        assert f"world (pid {idle[0].pid}), robot-1 (pid {idle[1].pid}) had no launcher any more" in answer.stdout
        assert [one.wait(60) for one in idle[:2]] == [-signal.SIGTERM] * 2
        assert idle[2].poll() is None, "it is another process"
        assert active_runs() == []
    finally:
        for one in idle:
            one.kill()
            one.wait()


# --- orders about robots


def test_robot_that_was_killed_and_restarted_counts_as_itself_and_the_run_waits_for_it(start):
    run = start("finish", "roam").running()
    eventually(lambda: rows()["robot-1"]["state"] == "finished")
    first = rows()["robot-1"]["pid"]
    answer = rmr("kill", "1")
    assert (answer.exit_code, answer.stdout, answer.stderr) == (0, "robot 1 is killed\n", "")
    assert not lives(first)
    assert "robot-1" not in rmr("ps").stdout
    assert rows()["robot-1"]["state"] == "killed (9)"
    assert refused_order(rmr("kill", "1")) == "rmr kill: robot 1 is dead already\n"
    answer = rmr("restart", "1")
    assert (answer.exit_code, answer.stdout, answer.stderr) == (0, "robot 1 is started again\n", "")
    assert rows()["robot-1.1"]["restarts"] == 1
    eventually(lambda: rows()["robot-1.1"]["state"] == "finished")
    assert run.process.poll() is None, "robot 2 has not finished"
    assert refused_order(rmr("restart", "1")) == (
        "rmr restart: robot 1 lives: kill it before it is restarted; rmr restart --force stops it first\n"
    )
    assert refused_order(rmr("start", "1")) == "rmr start: robot 1 runs already\n"
    assert rmr("restart", "--force", "1").exit_code == 0
    assert rows()["robot-1.1"]["state"] == "ended (0)"
    assert "robot-1.2" in rmr("ps").stdout
    assert rmr("down").exit_code == 0
    run.wait()
    report = run.report()
    assert report["died"] == {"robot-1": -9}, "the second was stopped"
    assert report["dead"] == []
    assert [sorted(entry)[1] for entry in report["faults"]] == ["kill", "restart", "restart"]
    told = [one for one in rmr("events", "--json", "--run", "run-standin").stdout.splitlines() if '"request"' in one]
    assert [(json.loads(one)["do"], json.loads(one)["robot"]) for one in told] == [
        *(("kill", 1), ("restart", 1), ("stop", 1), ("restart", 1))
    ]


def refused_order(answer):
    return refused(answer, 1)


def starting(run):
    """Wait until the launcher answers."""
    eventually((run.folder / "processes.json").exists)
    eventually(lambda: rows()["robot-1"]["state"] == "ready")
    return run


def test_order_waits_until_the_lab_has_started(start, tmp_path):
    run = starting(start("roam", "late"))
    told = tmp_path / "told"
    with told.open("w") as sink:
        words = [sys.executable, "-P", "-m", "rmr_deploy.fleet", "restart", "--force", "1"]
        order = subprocess.Popen(words, stdout=sink, stderr=sink, cwd=tmp_path)
    try:
        eventually(lambda: "rmr restart: lab standin is starting: waiting until its robots" in told.read_text())
        assert "robot-1.1" not in rows()
        run.release()
        assert order.wait(60) == 0
        assert told.read_text().endswith("robot 1 is started again\n")
        assert run.process.poll() is None, run.said
    finally:
        order.kill()
        order.wait()


def test_what_is_asked_of_the_world_waits_until_the_lab_has_started(start, tmp_path):
    run = starting(start("roam", "late"))
    told = tmp_path / "told"
    with told.open("w") as sink:
        order = subprocess.Popen([sys.executable, "-P", "-m", "rmr_deploy.fault", "list"], stdout=sink, stderr=sink)
    try:
        eventually(lambda: "rmr fault: lab standin is starting: waiting until its robots" in told.read_text())
        assert order.poll() is None
        run.release()
        assert order.wait(60) == 1
        assert "no lab's world answers at" in told.read_text(), "the stand-in has none"
    finally:
        order.kill()
        order.wait()


@pytest.mark.parametrize("first", ["roam", "deaf"])  # with the latter the launcher takes seconds to end
def test_order_to_a_lab_that_is_over_before_it_has_started_says_so(start, tmp_path, first):
    run = starting(start(first, "late"))
    told = tmp_path / "told"
    with told.open("w") as sink:
        words = [sys.executable, "-P", "-m", "rmr_deploy.fleet", "pause", "1"]
        order = subprocess.Popen(words, stdout=sink, stderr=sink, cwd=tmp_path)
    try:
        eventually(lambda: "is starting" in told.read_text())
        run.process.send_signal(signal.SIGINT)
        assert order.wait(60) == 1
        assert "lab standin was over before it had started; rmr events --run run-standin tells why" in told.read_text()
    finally:
        order.kill()
        order.wait()


def test_stop_that_was_asked_for_while_the_lab_starts_is_no_death(start):
    run = starting(start("roam", "late"))
    ask_launcher(run.folder, {"do": "stop", "robot": 1})
    eventually(lambda: rows()["robot-1"]["state"] == "ended (0)")
    assert rmr("start", "1").stdout == "robot 1 is started\n", run.said
    run.release()
    run.running()
    eventually(lambda: rows()["robot-1.1"]["state"] == "running")


def test_finish_of_a_restarted_robot_is_waited_for_and_the_exit_code_is_0(start, monkeypatch):
    run = start("finish", "stall").running()
    eventually(lambda: rows()["robot-1"]["state"] == "finished")
    assert rmr("kill", "1", "-s", "TERM").exit_code == 0
    assert rmr("start", "1").stdout == "robot 1 is started\n"
    run.release()
    assert run.wait() == 0, run.said
    report = run.report()
    assert report["finished"]
    assert report["dead"] == []
    assert report["reason"].startswith("every robot holds the finish fact; robot-1 was stopped on the way and came")


def test_robot_that_does_not_stop_is_killed_and_the_run_ends_with_the_last_robot(start):
    run = start("roam", "deaf").running()
    answer = rmr("stop", "1")
    assert (answer.exit_code, answer.stdout) == (0, "robot 1 is stopped\n")
    assert rows()["robot-1"]["state"] == "ended (0)"
    answer = rmr("stop", "--timeout", "0.2", "2")
    assert (answer.exit_code, answer.stderr) == (0, "robot 2 did not stop in 0.2 s and was killed\n")
    run.wait()
    assert run.report()["reason"] == "robot-1, robot-2 were stopped", "no robot was left"


def test_paused_robot_is_held_until_it_is_unpaused(start):
    run = start("roam", "roam").running()
    assert rmr("pause", "2").stdout == "robot 2 is paused\n"
    assert rows()["robot-2"]["state"] == "paused"
    answer = rmr("pause", "2", "1")
    assert (answer.exit_code, answer.stdout) == (1, "robot 1 is paused\n")
    assert answer.stderr == "rmr pause: robot 2 is paused already\n"
    assert rows()["robot-1"]["state"] == "paused", "a refusal does not keep the others"
    assert rmr("unpause", "1", "2").stdout == "robot 1 is going on\nrobot 2 is going on\n"
    eventually(lambda: rows()["robot-2"]["state"] == "running")
    assert refused_order(rmr("unpause", "2")) == "rmr unpause: robot 2 is not paused\n"
    assert "SIGSTOP is sent by the order pause" in refused_order(rmr("kill", "-s", "STOP", "2"))
    assert "lab standin has no robot 9: it has 1-2" in refused(rmr("kill", "9"))
    assert "should be a signal, such as KILL" in refused(rmr("kill", "-s", "NONE", "2"))
    assert "missing: ROBOT" in refused(rmr("kill"))
    rmr("pause", "1")
    assert rmr("down").exit_code == 0
    run.wait()
    assert sorted(entry["stall"] for entry in run.report()["faults"]) == [1, 1, 2]


def test_robot_that_fails_is_started_again_as_often_as_the_policy_says(start):
    run = start("crash", "roam", "--restart", "on-failure:2")
    run.ready.touch()
    eventually(lambda: "robot-1.2" in run.said and run.process.poll() is not None)
    assert run.wait() == 1
    report = run.report()
    assert report["died"] == {"robot-1": 1, "robot-1.1": 1, "robot-1.2": 1}
    assert report["dead"] == [1]


def test_robot_that_was_killed_by_a_person_is_not_started_again_by_the_policy(start):
    run = start("roam", "roam", "--restart", "on-failure").running()
    rmr("kill", "1")
    rmr("stop", "2")
    assert run.wait() == 1
    report = run.report()
    assert (report["died"], report["dead"], report["stopped"]) == ({"robot-1": -9}, [1, 2], [2])
    assert report["reason"] == "robot-1 died, robot-2 was stopped"
    assert "; robot 1 died, robot 2 was stopped\n" in run.said, "the summary"
    assert [line.split()[2] for line in run.said.splitlines() if line.startswith("   @")] == ["died", "stopped"]


# --- what robots use and hold


def test_processor_time_memory_facts_and_lab_of_a_run_are_shown(start):
    run = start("roam", "finish").running()
    (line,) = rmr("stats", "--once", "--json").stdout.splitlines()
    used = {row["name"]: row for row in json.loads(line)["processes"]}
    assert list(used) == ["launcher", "world", "robot-1", "robot-2"]
    assert all(row["memory_mb"] > 1.0 and row["cpu_percent"] >= 0.0 for row in used.values())
    assert rmr("stats", "--once").stdout.splitlines()[0].startswith("NAME")
    eventually(lambda: rmr("facts", "2").stdout == "waiting(@2)\n")
    assert rmr("facts").stdout == "1: waiting(@1)\n2: waiting(@2)\n"
    assert json.loads(rmr("facts", "--json", "--predicate", "at", "1").stdout)["facts"] == {"1": []}
    lab = json.loads(rmr("config").stdout)
    assert (lab["lab"], lab["duration_s"], lab["seed"], lab["robots"][1]["id"]) == ("standin", 600.0, 0, 2)
    assert json.loads(rmr("config", "standin").stdout) == lab
    assert "LAB goes without --run, --lab and --connect" in refused(rmr("config", "standin", "--lab", "standin"))
    rmr("down")
    run.wait()
    assert json.loads(rmr("config", "--run", "run-standin").stdout) == lab
    assert rmr("facts", "--run", "run-standin", "2").stdout == "waiting(@2)\n"
    (run.folder / "report.json").unlink()
    (run.folder / "lab.json").unlink()
    assert "run-standin/report.json cannot be read" in refused(rmr("facts", "--run", "run-standin", "2"), 1)
    assert "of a lab file: rmr config LAB" in refused(rmr("config", "--run", "run-standin"), 1)


def test_logs_are_followed_until_the_run_is_over(start, tmp_path):
    start("roam", "roam").running()
    output = tmp_path / "followed"
    with output.open("w") as sink:
        words = [sys.executable, "-P", "-m", "rmr_deploy.fleet", "events", "-f"]
        following = subprocess.Popen(words, stdout=sink, cwd=tmp_path)
    try:
        eventually(lambda: "2 robots are ready" in output.read_text())
        rmr("kill", "2")
        eventually(lambda: "robot-2 was killed by SIGKILL" in output.read_text())
        assert following.poll() is None
        rmr("down")
        assert following.wait(60) == 0
        assert output.read_text().splitlines()[-1].endswith("interrupted")
    finally:
        following.kill()
        following.wait()
