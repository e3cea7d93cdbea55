"""`rmr sim`: what it prints, what it leaves, how it says what is wrong."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from rmr_sim.main import main
from rmr_sim.sim_command import failures
from rmr_sim.simulation import Simulation

LABS = Path(__file__).parents[2] / "deploy" / "labs"

LAB = """
lab: tiny
program: tiny.rmr
arena: {size: [1.0, 1.0], cell: 0.05}
robots: [{id: 1, pose: [0.5, 0.5, 0deg]}]
finish: done(R)
duration: 2s
"""


def code_of(arguments: list[str]) -> int:
    """Return the exit code, also where the arguments themselves are refused."""
    try:
        return main(arguments)
    except SystemExit as refused:
        return int(refused.code or 0)


def tiny(folder: Path, program: str, lab: str = LAB) -> Path:
    (folder / "lab.yaml").write_text(lab)
    (folder / "tiny.rmr").write_text(program)
    return folder


def test_help_and_wrong_usage_load_neither_world_nor_nodes():
    code = "import sys; import rmr_sim.main; print([m for m in sys.modules if m.startswith(('rmr.node', 'rmr_world'))])"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout == "[]\n"


def test_json_is_the_report_and_everything_else_goes_to_standard_error(tmp_path, capsys):
    lab = tiny(tmp_path, "done(R).\n")
    assert main([str(lab), "--json", "--run", str(tmp_path / "run")]) == 0
    out, err = capsys.readouterr()
    report = json.loads(out)
    assert report["finished"] is True
    assert report == json.loads((tmp_path / "run" / "report.json").read_text())
    assert "simulated" in err
    assert str(tmp_path / "run" / "report.json") in err


def test_failed_actions_are_reported_once_each(tmp_path, capsys):
    lab = tiny(
        tmp_path,
        "type action try(R: robot, N: int) -o ok(R) else no(R).\nno(R).\nno(R) -o try(R, 1).\nok(R) -o done(R).\n",
    )
    (tmp_path / "try.py").write_text(
        'from rmr import action\n\n\n@action("try")\nasync def attempt(robot, n):\n'
        "    await robot.sleep(0.1)\n    return 1 / 0\n"
    )
    assert main([str(lab), "--actions", str(tmp_path / "try.py"), "--run", str(tmp_path / "run")]) == 1
    err = capsys.readouterr().err
    assert err.count("robot 1: action try(@1, 1) failed: ZeroDivisionError: division by zero") == 1


def test_run_ends_with_the_command_that_shows_it_if_there_is_a_recording(tmp_path, capsys):
    lab = tiny(tmp_path, "done(R).\n")
    for words, shown in (
        (["--run", str(tmp_path / "a")], tmp_path / "a"),
        (["--run", str(tmp_path / "b"), "--record", str(tmp_path / "b c.mcap")], f"'{tmp_path / 'b c.mcap'}'"),
    ):
        main([str(lab), *words])
        assert capsys.readouterr().err.splitlines()[-1] == f"see it: rmr view {shown}"
    main([str(lab), "--run", str(tmp_path / "d"), "--no-record"])
    assert "see it" not in capsys.readouterr().err


def test_at_most_five_failures_are_reported():
    entries = [
        {"what": "action_ended", "robot": robot, "action": f"go(@{robot})", "failure": "no way there"}
        for robot in range(8)
    ]
    assert failures([*entries, {"what": "action_ended", "robot": 9, "action": "go(@9)", "failure": None}]) == [
        *(f"robot {robot}: action go(@{robot}) failed: no way there" for robot in range(5)),
        "and 3 more failed; --trace FILE holds all",
    ]


ASTRAY = """
import os
from rmr import action

os.chdir({elsewhere!r})

@action("try")
async def attempt(robot):
    os.chdir({elsewhere!r})
    if {interrupts}:
        raise KeyboardInterrupt
"""


@pytest.mark.parametrize("interrupts", [False, True])
def test_files_of_a_run_are_where_they_should_be_whatever_a_handler_does(tmp_path, monkeypatch, capsys, interrupts):
    """A handler that changes the present folder, or raises what Ctrl-C raises."""
    here, elsewhere = tmp_path / "here", tmp_path / "elsewhere"
    here.mkdir()
    elsewhere.mkdir()
    monkeypatch.chdir(here)
    lab = tiny(tmp_path, "type action try(R: robot) -o done(R) else done(R).\nno(R).\nno(R) -o try(R).\n")
    (tmp_path / "astray.py").write_text(ASTRAY.format(elsewhere=str(elsewhere), interrupts=interrupts))
    words = ["--actions", str(tmp_path / "astray.py"), "--run", "run", "--trace", "trace.jsonl"]
    main([str(lab), *words])
    assert "the report is run/report.json" in capsys.readouterr().err
    assert Path.cwd() == here
    assert list(elsewhere.iterdir()) == []
    assert {"report.json", "run.mcap"} <= {path.name for path in (here / "run").iterdir()}
    entries = map(json.loads, (here / "trace.jsonl").read_text().splitlines())
    (failure,) = [entry["failure"] for entry in entries if entry["what"] == "action_ended"]
    assert failure == ("KeyboardInterrupt (astray.py:11)" if interrupts else None)


def test_actions_still_under_way_are_named_when_the_run_is_not_finished(tmp_path, capsys):
    lab = tiny(
        tmp_path,
        "type action hang(R: robot, N: int) -o done(R).\n"
        + "".join(f"a{n}(R).\na{n}(R) -o hang(R, {n}).\n" for n in range(7)),
    )
    (tmp_path / "hang.py").write_text(
        'from rmr import action\n\n\n@action("hang")\n'
        "async def hang(robot, n):\n    await robot.until(lambda: n == 7)\n"
    )
    words = ["--actions", str(tmp_path / "hang.py")]
    assert main([str(lab), *words, "--run", str(tmp_path / "run")]) == 1
    err = capsys.readouterr().err
    assert err.count("is still under way, since 0.") == 5
    assert "robot 1: hang(@1, 0) is still under way, since 0." in err
    assert "more actions under way\n" in err


def test_missing_program_is_reported_at_its_place_in_the_lab_file(tmp_path, capsys):
    lab = tiny(tmp_path, "done(R).\n", LAB.replace("tiny.rmr", "tini.rmr"))
    assert main([str(lab), "--run", str(tmp_path / "run")]) == 3
    err = capsys.readouterr().err
    assert err.endswith(f"lab.yaml:3:10: program: there is no file {tmp_path / 'tini.rmr'}; did you mean 'tiny.rmr'?\n")


def test_a_table_shows_every_robot(tmp_path, capsys):
    assert main([str(LABS / "testbed"), "--robots", "2", "--run", str(tmp_path / "run")]) == 0
    out = capsys.readouterr().out
    assert "@1" in out
    assert "@2" in out
    assert "deadline" in out


def test_a_run_that_does_not_finish_fails_and_still_leaves_its_report(tmp_path, capsys):
    lab = tiny(tmp_path, "idle(R).\nidle(R), done(R) -o 1.\n")
    assert main([str(lab), "--run", str(tmp_path / "run")]) == 1
    assert json.loads((tmp_path / "run" / "report.json").read_text())["finished"] is False


def test_strict_fails_by_exit_code_on_a_missed_deadline(tmp_path, capsys):
    program = """
    type action wait(R: robot, T: float) -o done(R).
    late: watch(go(R), done(R), 0.5, say(R, "late")).
    go(R).
    $go(R) -o wait(R, 1).
    """
    lab = tiny(tmp_path, program)
    assert main([str(lab), "--strict", "--run", str(tmp_path / "a")]) == 4
    assert main([str(lab), "--run", str(tmp_path / "b")]) == 0


@pytest.mark.parametrize(
    ("program", "lab", "said"),
    [
        ("done(R)\n", LAB, "tiny.rmr:1"),
        ("done(R).\n", LAB.replace("size", "sise"), "lab.yaml:4"),
        ("done(R).\n", LAB.replace("tiny.rmr", "absent.rmr"), "absent.rmr"),
        ("type action juggle(robot).\ndone(R).\ndone(R) -o juggle(R).\n", LAB, "juggle"),
        ("type action moveto(robot, area).\ndone(R).\ndone(R) -o moveto(R, nowhere).\n", LAB, "nowhere"),
    ],
)
def test_invalid_program_or_lab_is_reported_with_its_place(tmp_path, capsys, program, lab, said):
    assert main([str(tiny(tmp_path, program, lab)), "--run", str(tmp_path / "run")]) == 3
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("options", [["--robots", "99"], ["--robots", "0"], ["--loss", "2"]])
def test_options_out_of_range_are_refused(tmp_path, capsys, options):
    assert code_of([str(LABS / "testbed"), *options, "--run", str(tmp_path / "run")]) in {2, 3}
    assert options[1] in capsys.readouterr().err


def test_missing_lab_is_reported(tmp_path, capsys):
    assert code_of([str(tmp_path / "nowhere")]) == 2
    assert "nowhere" in capsys.readouterr().err


def test_a_run_folder_that_is_not_empty_is_not_overwritten(tmp_path, capsys):
    lab = tiny(tmp_path, "done(R).\n")
    assert main([str(lab), "--run", str(lab)]) == 2
    assert "not empty" in capsys.readouterr().err


def test_a_lab_without_a_finish_fact_lasts_its_duration_and_is_finished_then(tmp_path, capsys):
    lab = tiny(tmp_path, "done(R).\n", LAB.replace("finish: done(R)\n", ""))
    assert main([str(lab), "--json", "--run", str(tmp_path / "run")]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["finished"] is True
    assert report["time_s"] == 2.0


def test_ctrl_c_ends_the_run_in_order_and_the_report_is_written(tmp_path, capsys):
    lab = tiny(tmp_path, "type action act(R: robot) -o acted(R).\ngo(R).\ngo(R) -o act(R).\n", LAB.replace("2s", "60s"))
    lab.joinpath("lab.yaml").write_text((lab / "lab.yaml").read_text().replace("done(R)", "go(R)"))
    actions = tmp_path / "actions.py"
    actions.write_text(
        "import os, signal\nfrom rmr import action\n\n"
        '@action("act")\nasync def act(robot):\n    await robot.sleep(1.0)\n    os.kill(os.getpid(), signal.SIGINT)\n'
    )
    assert main([str(lab), "--actions", str(actions), "--run", str(tmp_path / "run")]) == 1
    report = json.loads((tmp_path / "run" / "report.json").read_text())
    assert report["finished"] is False
    assert report["time_s"] == pytest.approx(1.0, abs=0.05)
    assert "interrupted" in capsys.readouterr().err
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_unwritable_trace_is_reported_before_the_run(tmp_path, capsys):
    lab = tiny(tmp_path, "done(R).\n")
    assert main([str(lab), "--run", str(tmp_path / "run"), "--trace", str(tmp_path / "nowhere" / "trace")]) == 2
    assert "nowhere" in capsys.readouterr().err
    assert not list((tmp_path / "run").iterdir())


def test_the_trace_begins_at_the_beginning_however_long_the_run(tmp_path, capsys):
    program = "type action wait(R: robot, T: float) -o go(R).\ngo(R).\ngo(R) -o wait(R, 0.02).\n"
    lab = tiny(tmp_path, program, LAB.replace("finish: done(R)\n", "").replace("2s", "40s"))
    trace = tmp_path / "trace.jsonl"
    assert main([str(lab), "--run", str(tmp_path / "run"), "--trace", str(trace)]) == 0
    entries = [json.loads(line) for line in trace.read_text().splitlines()]
    assert entries[0]["t"] == 0.0
    assert sum(entry["what"] == "action" for entry in entries) > 1500


def test_full_disk_is_reported_where_results_are_written(tmp_path, capsys):
    lab = tiny(tmp_path, 'type action say(R: robot, T: string) -o done(R).\ngo(R).\ngo(R) -o say(R, "x").\n')
    assert main([str(lab), "--run", str(tmp_path / "a"), "--trace", "/dev/full"]) == 1
    out, err = capsys.readouterr()
    assert err.splitlines()[0] == "rmr sim: cannot write /dev/full: No space left on device"
    assert "tiny: finished after" in out


def test_a_report_that_cannot_be_written_is_named_and_the_table_comes_out(tmp_path, capsys, monkeypatch):
    lab, ran = tiny(tmp_path, "done(R).\n"), Simulation.run

    def run(simulation):
        (tmp_path / "run" / "report.json").mkdir()
        return ran(simulation)

    monkeypatch.setattr(Simulation, "run", run)
    assert main([str(lab), "--run", str(tmp_path / "run")]) == 1
    out, err = capsys.readouterr()
    assert f"rmr sim: cannot write {tmp_path / 'run' / 'report.json'}: Is a directory\n" in err
    assert err.endswith(f"there is no report\nsee it: rmr view {tmp_path / 'run'}\n")
    assert "tiny: finished after" in out


@pytest.mark.medium
def test_closed_standard_output_pipe_ends_quietly_and_keeps_the_report(tmp_path):
    read, write = os.pipe()
    os.close(read)
    words = [sys.executable, "-u", "-P", "-m", "rmr_sim.main", str(tiny(tmp_path, "done(R).\n"))]
    words += ["--run", str(tmp_path / "run")]
    answer = subprocess.run(words, stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert answer.returncode == 1
    assert "Broken pipe" not in answer.stderr
    assert (tmp_path / "run" / "report.json").exists()


def test_internal_error_before_the_run_is_reported_without_a_traceback(tmp_path, capsys, monkeypatch):
    def broken(*_):
        raise AssertionError("never so")

    monkeypatch.setattr("rmr_sim.run_setup.attach_checkers", broken)
    assert main([str(tiny(tmp_path, "done(R).\n")), "--run", str(tmp_path / "run")]) == 1
    assert "rmr sim: broke down: AssertionError: never so; where is told in " in capsys.readouterr().err
    assert "never so" in (tmp_path / "run" / "breakdown.txt").read_text()
    monkeypatch.setattr("rmr_sim.sim_command.load", broken)
    assert main([str(tmp_path)]) == 1
    assert "broke down: AssertionError: never so; in broken, line " in capsys.readouterr().err
