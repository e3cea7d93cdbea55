"""`rmr sim --seeds`: what a sweep prints, what it keeps, and that it is the same whoever runs it."""

import json
import os

import pytest
from test_command import LAB, code_of, tiny

from rmr_sim.arguments import JOBS_MAX, cores, parse
from rmr_sim.main import main
from rmr_sim.seed_run import row_of
from rmr_sim.simulation import Simulation
from rmr_sim.sweep_summary import failing_lines, quantile, summary_of

pytestmark = pytest.mark.medium

DONE = "done(R).\n"
NEVER = "idle(R).\nidle(R), done(R) -o 1.\n"
LOUD = """
from rmr_sim.event import Event

print("loaded")

class Hello(Event):
    def callback(self, simulation):
        print("happened")

def events(lab, seed):
    return [Hello(0)]
"""
LATE = """
type action wait(R: robot, T: float) -o done(R).
late: watch(go(R), done(R), 0.5, say(R, "late")).
go(R).
$go(R) -o wait(R, 1).
"""


def swept(folder, program, *options, lab=LAB, name="run"):
    """Run a sweep of a tiny lab; return its exit code and the folder that it leaves."""
    run = folder / name
    return main([str(tiny(folder, program, lab)), "--run", str(run), *options]), run


def row(seed, **others):
    given = {"finished": True, "time_s": 1.0 * seed, "bound_s": 1.0, "time_to_bound": 1.0 * seed, "collisions": 0}
    deadlines = {"met": 1, "missed": 0, "best_possible": 1}
    return {"seed": seed, **given, "deadlines": deadlines, "violations": {}, "unhandled": 0, "error": None, **others}


def test_a_sweep_has_a_row_for_each_seed_and_their_summary(tmp_path, capsys):
    code, run = swept(tmp_path, DONE, "--seeds", "3-5", "--jobs", "1", "--json")
    assert code == 0
    out, err = capsys.readouterr()
    document = json.loads(out)
    assert document == json.loads((run / "sweep.json").read_text())
    assert [row["seed"] for row in document["rows"]] == [3, 4, 5]
    assert (document["first_seed"], document["last_seed"], document["summary"]["finished"]) == (3, 5, 3)
    assert not (run / "failed").exists()
    assert err.startswith("3 of 3 runs in ")  # not on a terminal: nothing else


def test_the_rows_are_the_same_however_many_processes_share_them(tmp_path):
    lab = LAB.replace("robots:", "areas: {spot: {at: [0.7, 0.7]}}\nrobots:").replace("done(R)", "at(R, spot)")
    go = "type action moveto(R: robot, A: area) -o at(R, A).\ntype sensor at(robot, area).\ngo(R).\n"
    program = go + "go(R) -o moveto(R, spot).\n"
    octets = []
    for jobs in ("1", "2"):
        code, run = swept(
            tmp_path, program, "--seeds", "1-3", "--jobs", jobs, lab=lab.replace("2s", "9s"), name=f"with{jobs}"
        )
        assert code == 0
        octets.append((run / "sweep.json").read_bytes())
    assert octets[0] == octets[1]
    times = {row["time_s"] for row in json.loads(octets[0])["rows"]}
    assert len(times) == 3, "each seed is a run of its own"


def test_failing_seed_is_kept_and_reported_with_the_command_to_repeat_it(tmp_path, capsys):
    code, run = swept(tmp_path, NEVER, "--seeds", "7", "--jobs", "1", "--loss", "0.25", "--strict")
    assert code == 1
    command = f"rmr sim {tmp_path} --loss 0.25 --strict --seed 7"
    out = capsys.readouterr().out
    assert f"seed 7: not finished\n    {command}\n" in out
    report = json.loads((run / "failed" / "seed-7" / "report.json").read_text())
    assert (report["seed"], report["finished"]) == (7, False)
    assert (run / "failed" / "seed-7" / "trace.jsonl").exists()
    assert json.loads((run / "sweep.json").read_text())["failing"] == [{"seed": 7, "command": command}]
    assert main([*command.split()[2:], "--run", str(tmp_path / "again")]) == 1
    assert json.loads((tmp_path / "again" / "report.json").read_text()) == report


def test_internal_error_in_a_run_is_reported_without_a_traceback_which_is_kept(tmp_path, capsys, monkeypatch):
    def run(simulation):
        assert simulation.seed != 2, "a bug"
        return True

    monkeypatch.setattr(Simulation, "run", run)
    code, folder = swept(tmp_path, DONE, "--seeds", "1-3", "--jobs", "1")
    assert code == 1
    out, err = capsys.readouterr()
    assert "seed 2: AssertionError: a bug" in out
    assert "2 (66.7 %), 1 broke down" in out
    assert "Traceback" not in out + err
    assert "Traceback" in (folder / "failed" / "seed-2" / "breakdown.txt").read_text()


def test_internal_error_in_a_single_run_is_reported_without_a_traceback(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Simulation, "run", lambda _: 1 / 0)
    code, folder = swept(tmp_path, DONE, "--seed", "1")
    assert code == 1
    out, err = capsys.readouterr()
    assert f"rmr sim: broke down: ZeroDivisionError: division by zero; where is told in {folder}" in err
    assert "Traceback" not in out + err
    assert "Traceback" in (folder / "breakdown.txt").read_text()


def test_missed_deadline_fails_a_sweep_under_strict_only(tmp_path, capsys):
    assert swept(tmp_path, LATE, "--seeds", "1-2", "--jobs", "1", name="a")[0] == 0
    assert "0 met, 2 missed" in capsys.readouterr().out
    code, run = swept(tmp_path, LATE, "--seeds", "1-2", "--jobs", "1", "--strict", name="b")
    assert code == 4
    assert not (run / "failed").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--jobs", "2"], "name its --seeds"),
        (["--seed", "1", "--seeds", "1-2"], "name one of them"),
        (["--seeds", "1-2", "--trace", "t"], "--trace is of one run"),
        (["--seeds", "2-1"], "the least first"),
        (["--seeds", "1-100001"], "from 1 to 100000 seeds"),
        (["--seeds", "1,2"], "seeds such as 1-100"),
        (["--seeds", "1-2", "--jobs", "0"], "a whole number from 1"),
        (["--seeds", "1-2", "--jobs", "65"], "a whole number from 1 to 64, not '65'"),
        (["--seeds", "1-2", "--jobs", "9" * 5000], "a whole number from 1 to 64, not '999"),
        (["--seed", "9" * 5000], "a whole number from 0, of 18 digits at most, not '999"),
    ],
)
def test_wrong_usage_of_a_sweep_is_reported(tmp_path, capsys, words, said):
    assert code_of([str(tiny(tmp_path, DONE)), *words]) == 2
    assert said in capsys.readouterr().err


def test_one_seed_and_a_range_are_sweeps(tmp_path):
    lab = str(tiny(tmp_path, DONE))
    assert parse([lab, "--seeds", "5"]).seeds == range(5, 6)
    assert parse([lab, "--seeds", "0-99999"]).seeds == range(100_000)


def test_a_sweep_takes_all_processors_where_the_system_does_not_tell_which_are_its_own(monkeypatch):
    assert 1 <= cores() <= JOBS_MAX
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 2 * JOBS_MAX)
    assert cores() == JOBS_MAX


@pytest.mark.parametrize("options", [("--seed", "2"), ("--seeds", "1-2", "--jobs", "1"), ("--seeds", "1-2")])
def test_what_a_users_file_prints_is_kept_apart_from_the_report(tmp_path, capfd, options):
    (tmp_path / "loud.py").write_text(LOUD)
    words = [*options, "--json", "--events", str(tmp_path / "loud.py")]
    assert swept(tmp_path, DONE, *words, lab=LAB.replace("finish: done(R)\n", ""))[0] == 0
    out, err = capfd.readouterr()
    assert json.loads(out)["lab"] == "tiny"
    assert {"loaded", "happened"} <= set(err.split())


def test_wrong_actions_file_is_reported_once_before_all_runs(tmp_path, capsys):
    (tmp_path / "actions.py").write_text("nonsense\n")
    code, run = swept(tmp_path, DONE, "--seeds", "1-3", "--jobs", "2", "--actions", str(tmp_path / "actions.py"))
    assert code == 3
    assert capsys.readouterr().err.count("NameError") == 1
    assert not (run / "sweep.json").exists()


def test_quantiles_are_values_that_were_measured():
    values = [float(n) for n in range(1, 201)]
    assert [quantile(values, percent) for percent in (50, 95, 99, 100)] == [100.0, 190.0, 198.0, 200.0]
    assert quantile([4.0], 99) == 4.0
    assert quantile([], 50) is None


def test_a_summary_takes_times_of_finished_runs_alone_and_counts_the_rest():
    rows = [
        row(1),
        row(2, collisions=2, violations={"contact": 2}),
        row(9, finished=False, time_s=99.0, time_to_bound=99.0, violations={"overlap": 1}),
        row(4, finished=False, time_s=None, bound_s=None, time_to_bound=None, error="AssertionError: x"),
    ]
    summary = summary_of(rows)
    assert (summary["runs"], summary["finished"], summary["failed"], summary["broken"]) == (4, 2, 3, 1)
    assert summary["time_to_bound"] == {"median": 1.0, "p95": 2.0, "p99": 2.0, "max": 2.0}
    assert summary["collisions"] == 2
    assert summary["violations"] == {"contact": 2, "overlap": 1}
    assert failing_lines(rows, "rmr sim lab") == [
        "seed 2: 2 contacts",
        "    rmr sim lab --seed 2",
        "seed 9: not finished, overlap (1)",
        "    rmr sim lab --seed 9",
        "seed 4: AssertionError: x",
        "    rmr sim lab --seed 4",
    ]


def test_first_of_many_failing_seeds_are_reported():
    lines = failing_lines([row(seed, collisions=1) for seed in range(30)], "rmr sim lab")
    assert lines[-1] == "and 10 more seeds; sweep.json has all of them"


def test_a_row_counts_what_the_report_tells():
    report = {
        "seed": 3,
        "finished": True,
        "time_s": 12.0,
        "bound_s": 9.0,
        "deadlines": {"met": 5, "missed": 1, "best_possible": 6},
        "collisions": 1,
        "violations": [{"check": check} for check in ("overlap", "contact", "overlap")],
        "robots": {"1": {"actions_unhandled": 2}, "2": {"unsendable": 3}},
    }
    assert row_of(report) == {
        "seed": 3,
        "finished": True,
        "time_s": 12.0,
        "bound_s": 9.0,
        "time_to_bound": 1.3333,
        "deadlines": {"met": 5, "missed": 1, "best_possible": 6},
        "collisions": 1,
        "violations": {"overlap": 2, "contact": 1},
        "unhandled": 2,
        "unsendable": 3,
        "error": None,
    }
