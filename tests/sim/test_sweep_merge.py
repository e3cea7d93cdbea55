"""`rmr sweep merge`: the shards of a sweep are what one machine would have left, or are refused."""

import json
import shutil

import pytest
from test_command import code_of, tiny
from test_sweep import DONE, LATE, NEVER, swept
from test_sweep_resume import cut_down, rows_in
from test_sweep_shards import octets_of, shards

from rmr_sim import sweep
from rmr_sim.main import sweep_main
from rmr_sim.simulation import Simulation

pytestmark = pytest.mark.medium


def merge(*words):
    """Merge; return the exit code, also where the arguments themselves are refused."""
    try:
        return sweep_main(["merge", *map(str, words)])
    except SystemExit as refused:
        return int(refused.code or 0)


@pytest.mark.parametrize("program", [DONE, NEVER])
def test_shards_are_merged_to_what_one_machine_leaves_octet_for_octet(tmp_path, capsys, monkeypatch, program):
    monkeypatch.setattr(sweep, "KEPT_MAX", 3)
    monkeypatch.setattr("rmr_sim.sweep_merge.KEPT_MAX", 3)
    code, alone = swept(tmp_path, program, "--seeds", "3-9", "--jobs", "1", name="alone")
    printed = capsys.readouterr().out
    parts = shards(tmp_path, program, "3-9", 3)
    capsys.readouterr()
    assert merge(*reversed(parts), "-o", tmp_path / "whole") == code
    out, err = capsys.readouterr()
    assert octets_of(tmp_path / "whole") == octets_of(alone)
    assert len(list((alone / "failed").rglob("report.json"))) == (3 if program == NEVER else 0)
    assert [line for line in printed.splitlines() if "simulated at" not in line] == out.splitlines()
    assert err == f"merged 7 runs of 3 shards; all rows are in {tmp_path / 'whole' / 'sweep.json'}\n"


def test_an_internal_error_is_merged_too(tmp_path, monkeypatch):
    ran = Simulation.run

    def run(simulation):
        assert simulation.seed != 2, "a bug"
        return ran(simulation)

    monkeypatch.setattr(Simulation, "run", run)
    _, alone = swept(tmp_path, DONE, "--seeds", "1-4", "--jobs", "1", name="alone")
    assert merge(*shards(tmp_path, DONE, "1-4", 2), "-o", tmp_path / "whole") == 1
    [report] = (tmp_path / "whole").rglob("breakdown.txt")
    assert "AssertionError: a bug" in report.read_text()
    assert octets_of(tmp_path / "whole").keys() == octets_of(alone).keys()


def test_json_and_strict(tmp_path, capsys):
    parts = shards(tmp_path, LATE, "1-4", 2)
    capsys.readouterr()
    assert merge(*parts, "-o", tmp_path / "a", "--json") == 0
    assert json.loads(capsys.readouterr().out) == json.loads((tmp_path / "a" / "sweep.json").read_text())
    assert merge(*parts, "-o", tmp_path / "b", "--strict") == 4


def rewritten(part, **others):
    """Change entries of the first line of a shard."""
    first, rows = rows_in(part)
    (part / "rows.jsonl").write_text("".join(json.dumps(line) + "\n" for line in [first | others, *rows]))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"version": "0.0.0"}, "shard2 has another sweep than {}/shard1; version of rmr: 0.0.0 there, "),
        ({"sources": "abc"}, "shard2 has another sweep than {}/shard1; sources of rmr: abc there, "),
        ({"platform": "Linux, Python 2"}, "shard2 has another sweep than {}/shard1; what it runs on: Linux, Python 2"),
        ({"lab": "other"}, "shard2 has another sweep than {}/shard1; lab: other there, tiny here"),
        ({"options": "rmr sim LAB --chaos"}, "options: rmr sim LAB --chaos there, rmr sim LAB here"),
        ({"seeds": [1, 9]}, "seeds: [1, 9] there, [1, 6] here"),
        ({"files": "abc"}, "contents of the lab, program or Python files differ"),
        ({"shard": [2, 4]}, "shard2 has another sweep than {}/shard1; shards: 4 there, 3 here"),
    ],
)
def test_shards_of_another_sweep_are_refused(tmp_path, capsys, change, said):
    parts = shards(tmp_path, DONE, "1-6", 3)
    rewritten(parts[1], **change)
    capsys.readouterr()
    assert merge(*parts, "-o", tmp_path / "whole") == 2
    err = capsys.readouterr().err
    assert said.format(tmp_path) in err
    assert err.count("\n") == 1
    assert not (tmp_path / "whole").exists()


def test_shards_of_another_rmr_than_merges_are_refused(tmp_path, capsys):
    parts = shards(tmp_path, DONE, "1-4", 2)
    for part in parts:
        rewritten(part, sources="abc")
    capsys.readouterr()
    assert merge(*parts, "-o", tmp_path / "whole") == 2
    assert f"{parts[0]} is of another rmr than this one; sources of rmr: abc there, " in capsys.readouterr().err


def test_a_shard_that_is_twice_and_one_that_is_missing_are_named(tmp_path, capsys):
    parts = shards(tmp_path, DONE, "1-9", 4)
    shutil.copytree(parts[0], tmp_path / "copy")
    capsys.readouterr()
    assert merge(parts[0], tmp_path / "copy", parts[2], "-o", tmp_path / "whole") == 2
    assert capsys.readouterr().err.splitlines() == [
        f"rmr sweep merge: {tmp_path / 'copy'} has shard 1/4, which {parts[0]} has, too: leave one of them out",
        "rmr sweep merge: no folder has shards 2, 4 of 4",
    ]


def test_a_shard_that_was_ended_early_is_named_with_the_command_that_completes_it(tmp_path, capsys):
    parts = shards(tmp_path, DONE, "1-40", 2)
    cut_down(parts[1], 2)
    capsys.readouterr()
    assert merge(*parts, "-o", tmp_path / "whole") == 2
    err = capsys.readouterr().err
    assert f"{parts[1]}, shard 2/2, has no row of seeds 6, 8, 10, 12, 14 and 13 more; to go on: " in err
    command = err.rpartition("to go on: ")[2].split()
    assert code_of(command[2:]) == 0
    assert merge(*parts, "-o", tmp_path / "whole") == 0


def test_a_shard_that_two_processes_have_written_and_one_with_other_rows_are_refused(tmp_path, capsys):
    parts = shards(tmp_path, DONE, "1-4", 2)
    first, rows = rows_in(parts[0])
    (parts[0] / "rows.jsonl").write_text("".join(json.dumps(each) + "\n" for each in [first, *rows, rows[0]]))
    (parts[1] / "rows.jsonl").write_text(
        "".join(json.dumps(each) + "\n" for each in [first | {"shard": [2, 2]}, *rows])
    )
    capsys.readouterr()
    assert merge(*parts, "-o", tmp_path / "whole") == 2
    assert [line.partition(str(tmp_path))[2] for line in capsys.readouterr().err.splitlines()] == [
        "/shard1 has seed 1 more than once: did two processes write there?",
        "/shard2 has seeds 1, 3, not of its shard 2/2",
        f"/shard2, shard 2/2, has no row of seeds 2, 4; to go on: rmr sim {tmp_path} --resume {parts[1]}",
    ]


def test_what_is_no_shard_and_where_it_cannot_be_written_is_said(tmp_path, capsys):
    parts = shards(tmp_path, DONE, "1-4", 2)
    capsys.readouterr()
    assert merge(parts[0], tmp_path / "nothing", tmp_path, "-o", tmp_path / "whole") == 2
    assert [line.partition(" is no ")[2] for line in capsys.readouterr().err.splitlines()] == [
        "folder of a sweep: it has no rows.jsonl that can be read"
    ] * 2
    assert merge(*parts, "-o", parts[0]) == 2
    assert "the run folder is not empty; name a new one" in capsys.readouterr().err
    assert merge(*parts) == 2
    assert "missing: -o/--output" in capsys.readouterr().err
    assert merge("-o", tmp_path / "whole") == 2
    assert "missing: DIR" in capsys.readouterr().err


def test_a_failed_seed_whose_files_are_gone_is_named(tmp_path, capsys):
    parts = shards(tmp_path, NEVER, "1-3", 2)
    shutil.rmtree(parts[1] / "failed")
    capsys.readouterr()
    assert merge(*parts, "-o", tmp_path / "whole") == 1
    assert "rmr sweep merge: no report and trace is left of seed 2\n" in capsys.readouterr().err
    assert sorted(each.name for each in (tmp_path / "whole" / "failed").iterdir()) == ["seed-1", "seed-3"]


def test_a_sweep_on_one_machine_merges_to_itself(tmp_path):
    _, run = swept(tmp_path, DONE, "--seeds", "1-2", "--jobs", "1")
    assert merge(run, "-o", tmp_path / "whole") == 0
    assert octets_of(tmp_path / "whole") == octets_of(run)
    assert tiny(tmp_path, DONE)
