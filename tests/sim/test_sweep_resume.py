"""Rows of a sweep as they come, `--resume`, run folders that go away, and progress without a terminal."""

import io
import json
import re
import shutil
import sys

import pytest
from test_command import tiny
from test_sweep import DONE, NEVER, row, swept

from rmr_sim import seed_run, sweep
from rmr_sim.main import main
from rmr_sim.simulation import Simulation
from rmr_sim.sweep import ProgressLines
from rmr_sim.sweep_rows import ROWS_FILE


def rows_in(run):
    """Return the first line of a run folder's rows, and the others."""
    first, *rows = [json.loads(line) for line in (run / ROWS_FILE).read_text().splitlines()]
    return first, rows


def cut_down(run, lines, torn=""):
    """Leave of the rows in a run folder the first line and `lines` more, as after a kill."""
    path = run / ROWS_FILE
    path.write_text("".join(path.read_text().splitlines(keepends=True)[: 1 + lines]) + torn)
    (run / "sweep.json").unlink()


def resumed(folder, run, *options):
    return main([str(folder), "--resume", str(run), "--jobs", "1", *options])


def test_each_row_is_in_the_folder_as_soon_as_its_run_is_over(tmp_path, monkeypatch):
    seen, ran = [], Simulation.run

    def run(simulation):
        path = tmp_path / "run" / ROWS_FILE
        seen.append(len(path.read_text().splitlines()) if path.exists() else None)
        return ran(simulation)

    monkeypatch.setattr(Simulation, "run", run)
    _, folder = swept(tmp_path, DONE, "--seeds", "1-3", "--jobs", "1")
    assert seen == [1, 2, 3]
    first, rows = rows_in(folder)
    assert (first["lab"], first["seeds"]) == ("tiny", [1, 3])
    assert rows == json.loads((folder / "sweep.json").read_text())["rows"]


@pytest.mark.parametrize("torn", ["", '{"seed": 3, "fini'])
def test_a_sweep_that_was_killed_is_resumed_and_ends_as_if_it_had_not_been(tmp_path, monkeypatch, capsys, torn):
    code, run = swept(tmp_path, DONE, "--seeds", "1-4", "--jobs", "1")
    whole = (run / "sweep.json").read_bytes()
    cut_down(run, 2, torn)
    ran, seeds = Simulation.run, []
    monkeypatch.setattr(Simulation, "run", lambda simulation: seeds.append(simulation.seed) or ran(simulation))
    assert resumed(tmp_path, run) == code == 0
    assert "resuming: 2 of 4 runs are over" in capsys.readouterr().err
    assert seeds == [3, 4]
    assert (run / "sweep.json").read_bytes() == whole
    assert [each["seed"] for each in rows_in(run)[1]] == [1, 2, 3, 4]
    assert resumed(tmp_path, run) == 0, "of a sweep that is over nothing is left to do"
    assert (run / "sweep.json").read_bytes() == whole


@pytest.mark.parametrize(
    ("change", "options", "said"),
    [
        ("program", [], "contents of the lab, program or Python files differ"),
        (None, ["--chaos"], "options: rmr sim LAB there, rmr sim LAB --chaos here"),
        (None, ["--seeds", "1-9"], "seeds: [1, 3] there, [1, 9] here"),
        ("version", [], "version of rmr: 0.0.0 there"),
        ("rows", [], "does not hold the rows of a sweep"),
        ("no rows", [], "is no folder of a sweep: it has no rows.jsonl"),
    ],
)
def test_another_sweep_is_not_resumed(tmp_path, capsys, change, options, said):
    _, run = swept(tmp_path, DONE, "--seeds", "1-3", "--jobs", "1")
    path = run / ROWS_FILE
    if change == "program":
        (tmp_path / "tiny.rmr").write_text(DONE + "\n// another one\n")
    elif change == "version":
        first, rows = rows_in(run)
        path.write_text("\n".join(map(json.dumps, [first | {"version": "0.0.0"}, *rows, ""])))
    elif change == "rows":
        path.write_text("[1]\n")
    elif change == "no rows":
        path.unlink()
    capsys.readouterr()
    assert resumed(tmp_path, run, *options) == 2
    err = capsys.readouterr().err
    assert said in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize("words", [["--run", "x"], ["--seed", "1"], ["--trace", "t"]])
def test_resume_goes_with_a_sweep_alone(tmp_path, words):
    assert main([str(tiny(tmp_path, DONE)), "--resume", str(tmp_path), *words]) == 2


def vanish(monkeypatch, folder, leave):
    """Let the run folder go when the run of seed 2 begins."""
    ran = Simulation.run

    def run(simulation):
        if simulation.seed == 2:
            shutil.rmtree(folder)
            leave()
        return ran(simulation)

    monkeypatch.setattr(Simulation, "run", run)


def test_removed_run_folder_is_reported_once_and_recreated_for_the_rows(tmp_path, capsys, monkeypatch):
    vanish(monkeypatch, tmp_path / "run", lambda: None)
    code, run = swept(tmp_path, NEVER, "--seeds", "1-4", "--jobs", "1")
    out, err = capsys.readouterr()
    assert (
        err.count(f"rmr sim: cannot write {run / ROWS_FILE} any more: No such file or directory; the sweep goes") == 1
    )
    assert "Traceback" not in err
    assert len(json.loads((run / "sweep.json").read_text())["rows"]) == 4
    assert code == 1
    assert "runs" in out


def test_rows_that_no_folder_takes_are_printed(tmp_path, capsys, monkeypatch):
    vanish(monkeypatch, tmp_path / "run", (tmp_path / "run").touch)
    code, run = swept(tmp_path, DONE, "--seeds", "1-3", "--jobs", "1")
    out, err = capsys.readouterr()
    assert code == 1
    assert f"rmr sim: cannot write {run / 'sweep.json'}: File exists" in err
    rows = [json.loads(line) for line in out.split("rows:\n")[1].splitlines()]
    assert [row["seed"] for row in rows] == [1, 2, 3]


def test_a_sweep_with_a_contact_ends_with_exit_code_1(tmp_path, monkeypatch):
    monkeypatch.setattr(seed_run, "row_of", lambda report: row(report["seed"], collisions=report["seed"] == 2))
    assert swept(tmp_path, DONE, "--seeds", "1-3", "--jobs", "1")[0] == 1
    assert swept(tmp_path, DONE, "--seeds", "1-3", "--jobs", "1", "--strict", name="strict")[0] == 1


def test_progress_on_a_terminal_is_a_line_that_is_taken_away_and_what_is_printed_goes_above(tmp_path, monkeypatch):
    def kept(_, folder):
        raise OSError(28, "No space left on device", str(folder))

    shown = io.StringIO()
    shown.isatty = lambda: True
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setattr(sweep, "keep", kept)
    swept(tmp_path, NEVER, "--seeds", "1-2", "--jobs", "1")
    begin, message, first, second, end = re.sub(r"\d+ s\b", "N s", shown.getvalue()).split("\r\x1b[J")
    assert begin.endswith(f"\x1b[?25l0/2 runs, N s [{' ' * 40}]")
    assert message.startswith("rmr sim: cannot write ")
    assert message.endswith(f"no further seed that fails is kept\n\x1b[?25l0/2 runs, N s [{' ' * 40}]")
    assert re.fullmatch(r"\x1b\[\?25l1/2 runs, 1 failed, N s, about N s left \[#{17,19} {17,19}\]", first)
    assert re.fullmatch(r"\x1b\[\?25l2/2 runs, 2 failed, N s, about N s left \[#{34,38}\]", second)
    assert end.startswith("\x1b[?25h2 of 2 runs in ")
    assert sys.stderr is shown


def test_progress_without_a_terminal_is_printed_at_growing_intervals():
    now, lines = 0.0, []
    spoken = ProgressLines(1000, lambda: now, lines.append)
    for n in range(1000):
        now += 4.0
        spoken.tell(n == 1)
    assert lines[0] == "3 of 1000 runs, 1 failed, after 12 s; about 66 min to go"
    assert [line.split(" of ")[0] for line in lines] == [
        "3",
        "6",
        "12",
        "24",
        "48",
        "96",
        "192",
        "342",
        "492",
        "642",
        "792",
        "942",
    ]
