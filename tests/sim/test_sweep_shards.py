"""`rmr sim --seeds --shard`: which seeds a shard takes, and what its folder holds."""

import json

import pytest
from test_command import code_of, tiny
from test_sweep import DONE, NEVER, swept
from test_sweep_resume import cut_down, rows_in

from rmr_sim import sweep
from rmr_sim.arguments import Shard

pytestmark = pytest.mark.medium


def octets_of(folder):
    """Return the contents of all files in `folder`."""
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def shards(folder, program, seeds, count, *options):
    """Run all shards of a sweep; return their folders."""
    words = ("--seeds", seeds, "--jobs", "1", *options)
    return [
        swept(folder, program, *words, "--shard", f"{number}/{count}", name=f"shard{number}")[1]
        for number in range(1, count + 1)
    ]


@pytest.mark.parametrize(("count", "whole"), [(1, range(1, 2)), (3, range(1, 11)), (50, range(7, 1007))])
def test_the_shards_of_a_sweep_have_each_of_its_seeds_once_and_differ_by_one_in_number(count, whole):
    parts = [Shard(number, count).seeds(whole) for number in range(1, count + 1)]
    assert sorted(seed for part in parts for seed in part) == list(whole)
    assert max(map(len, parts)) - min(map(len, parts)) <= 1
    assert parts[-1][0] == whole[0] + count - 1


def test_a_shard_runs_each_nth_seed_and_says_which_part_it_is(tmp_path, capsys):
    code, run = swept(tmp_path, DONE, "--seeds", "1-8", "--shard", "2/3", "--jobs", "1")
    assert code == 0
    first, rows = rows_in(run)
    assert [row["seed"] for row in rows] == [2, 5, 8]
    assert (first["seeds"], first["shard"]) == ([1, 8], [2, 3])
    document = json.loads((run / "sweep.json").read_text())
    assert (document["first_seed"], document["last_seed"], document["shard"]) == (1, 8, [2, 3])
    assert "3 of 3 runs in " in capsys.readouterr().err


def test_a_shard_is_resumed_as_a_shard(tmp_path, capsys):
    [_, run] = shards(tmp_path, DONE, "1-8", 2)
    whole = octets_of(run)
    cut_down(run, 1)
    assert code_of([str(tmp_path), "--resume", str(run), "--shard", "1/2"]) == 2
    assert "it has another sweep; shard: [2, 2] there, [1, 2] here" in capsys.readouterr().err
    assert code_of([str(tmp_path), "--resume", str(run), "--jobs", "1"]) == 0
    assert "resuming: 1 of 4 runs are over" in capsys.readouterr().err
    assert octets_of(run) == whole


def test_resume_with_seeds_begins_a_sweep_that_is_not_there_yet(tmp_path, capsys):
    _, run = swept(tmp_path, DONE, "--seeds", "1-4", "--jobs", "1", "--shard", "1/2")
    words = [str(tmp_path), "--seeds", "1-4", "--jobs", "1", "--shard", "1/2", "--resume"]
    assert code_of([*words, str(tmp_path / "anew")]) == 0
    assert octets_of(tmp_path / "anew") == octets_of(run)
    (tmp_path / "killed").mkdir()
    (tmp_path / "killed" / "rows.new").write_text("{")
    assert code_of([*words, str(tmp_path / "killed")]) == 0
    assert octets_of(tmp_path / "killed") == octets_of(run)
    capsys.readouterr()
    assert code_of([str(tmp_path), "--resume", str(tmp_path / "none")]) == 2
    assert f"{tmp_path / 'none'} is no folder of a sweep" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize("shard", ["0/0", "0/5", "51/50", "1/0", "3", "a/b", "1/100001", "-1/5", "1/" + "9" * 5000])
def test_a_shard_that_there_is_not_is_an_error(tmp_path, capsys, shard):
    assert code_of([str(tiny(tmp_path, DONE)), "--seeds", "1-100", f"--shard={shard}"]) == 2
    assert "a shard such as 3/50, from 1/50 to 50/50, not '" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--shard", "1/2"], "--shard is a part of a sweep: name its --seeds"),
        (["--seeds", "1-3", "--shard", "1/4"], "--shard 1/4: 3 seeds cannot be shared by 4"),
        (["--hunt", "--shard", "1/4"], "leave out --shard"),
    ],
)
def test_a_shard_of_what_cannot_be_shared_is_an_error(tmp_path, capsys, words, said):
    assert code_of([str(tiny(tmp_path, DONE)), *words]) == 2
    assert said in capsys.readouterr().err


def test_the_least_of_the_seeds_that_fail_are_kept_in_whichever_order_they_come(tmp_path, monkeypatch):
    monkeypatch.setattr(sweep, "KEPT_MAX", 2)
    _, run = swept(tmp_path, NEVER, "--seeds", "1-4", "--jobs", "1")
    kept = octets_of(run)
    assert sorted(each.name for each in (run / "failed").iterdir()) == ["seed-1", "seed-2"]
    backwards = tmp_path / "backwards"
    monkeypatch.setattr(sweep.SweepRuns, "_results", _backwards(sweep.SweepRuns._results))
    assert code_of([str(tmp_path), "--seeds", "1-4", "--jobs", "1", "--run", str(backwards)]) == 1
    assert octets_of(backwards) == kept


def _backwards(results):
    return lambda *given: reversed(list(results(*given)))


def test_more_than_lab_and_program_make_a_sweep_another_one(tmp_path, capsys):
    """A program that is included, and the lab's own actions."""
    (tmp_path / "part.rmr").write_text("go(R).\n")
    program = 'include "part.rmr".\ntype action wave(R: robot) -o done(R).\ngo(R) -o wave(R).\n'
    (tmp_path / "acts.py").write_text('from rmr import action\n\n@action("wave")\nasync def wave(robot):\n    pass\n')
    lab = "lab: tiny\nprogram: tiny.rmr\nactions: acts.py\narena: {size: [1.0, 1.0]}\n"
    lab += "robots: [{id: 1, pose: [0.5, 0.5, 0deg]}]\nfinish: done(R)\nduration: 2s\n"
    code, run = swept(tmp_path, program, "--seeds", "1-2", "--jobs", "1", lab=lab)
    assert code == 0
    for name in ("part.rmr", "acts.py"):
        before = (tmp_path / name).read_text()
        changed = before.replace("go(R).", "go(R). more(R).").replace("pass", "await robot.sleep(1)")
        (tmp_path / name).write_text(changed)
        assert code_of([str(tmp_path), "--resume", str(run)]) == 2, name
        assert "contents of the lab, program or Python files differ" in capsys.readouterr().err
        (tmp_path / name).write_text(before)
    assert code_of([str(tmp_path), "--resume", str(run)]) == 0


def test_another_floor_in_the_image_of_the_map_makes_a_sweep_another_one(tmp_path, capsys):
    def floor(blocked):
        pixels = bytearray(b"\xff" * 400)
        pixels[:blocked] = bytes(blocked)
        (tmp_path / "floor.pgm").write_bytes(b"P5\n20 20\n255\n" + pixels)

    lab = "lab: tiny\nprogram: tiny.rmr\nmap: floor.pgm\narena: {size: [1.0, 1.0]}\n"
    lab += "robots: [{id: 1, pose: [0.5, 0.5, 0deg]}]\nfinish: done(R)\nduration: 2s\n"
    floor(20)
    code, run = swept(tmp_path, "done(R).\n", "--seeds", "1-2", "--jobs", "1", lab=lab)
    assert code == 0
    floor(40)
    assert code_of([str(tmp_path), "--resume", str(run)]) == 2
    assert "contents of the lab, program or Python files differ" in capsys.readouterr().err
