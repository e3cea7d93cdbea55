"""Faults at random: what is drawn, and that a run with them is repeatable."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from lab_maker import small_lab

from rmr.base.time import seconds
from rmr.radio.links import Disturbance
from rmr_sim.chaos import HEAL_MS, with_chaos
from rmr_world.faults import fault_entries, fault_lines
from rmr_world.lab import Kill, Outage, Restart, Slow, Stall
from rmr_world.lab_file import load_lab

pytestmark = pytest.mark.medium

LABS = Path(__file__).parents[2] / "deploy" / "labs"
SEEDS = range(150)
DRIVE = """
type action moveto(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
go(R).
go(R) -o moveto(R, box).
"""


@cache
def calm():
    """Return the test-bed's lab."""
    return load_lab(LABS / "testbed")


@cache
def chaotic(seed):
    """Return the test-bed's lab with the faults of `seed`."""
    return with_chaos(calm(), seed)


def drawn(seed):
    """Return all that was drawn for `seed`."""
    lab = chaotic(seed)
    return [*lab.faults, *lab.disturbances]


def over(fault):
    """Return when a fault is over."""
    match fault:
        case Kill(at=at) | Restart(at=at):
            return at
        case Disturbance(until=until):
            return until
        case _:
            return fault.end


def test_the_same_seed_draws_the_same_faults_and_another_seed_others():
    assert with_chaos(calm(), 3) == chaotic(3)
    assert chaotic(3) != chaotic(4)


def test_all_faults_are_over_when_the_run_heals_and_the_lab_s_duration_is_left_for_the_rest():
    for seed in SEEDS:
        heal = chaotic(seed).duration - calm().duration
        assert seconds(HEAL_MS[0] / 1000) <= heal <= seconds(HEAL_MS[1] / 1000)
        assert max(over(fault) for fault in drawn(seed)) <= heal


def test_every_robot_that_dies_is_started_again_and_no_fault_is_impossible():
    for seed in SEEDS:
        lab = chaotic(seed)
        for robot in lab.roster:
            turns = sorted(
                (f.at, isinstance(f, Restart)) for f in lab.faults if isinstance(f, Kill | Restart) and f.robot == robot
            )
            assert [is_restart for _, is_restart in turns] == [False, True] * (len(turns) // 2)
        assert [disturbance.check() for disturbance in lab.disturbances] == list(lab.disturbances)


def kinds(seed):
    """Return the kinds of faults that `seed` uses."""
    found = {type(fault).__name__ for fault in drawn(seed)}
    for one in chaotic(seed).disturbances:
        parts = "all" if not one.groups else "parts" if len(one.groups[0] + one.groups[1]) > 2 else "link"
        found.add(f"{parts} {'one way' if one.one_way else 'lossy' if one.loss else 'cut'}")
    return found


def test_every_kind_occurs_and_none_in_every_run():
    counts = {}
    for seed in SEEDS:
        for kind in kinds(seed) - {"Disturbance"}:
            counts[kind] = counts.get(kind, 0) + 1
    assert set(counts) == {
        *(kind.__name__ for kind in (Kill, Restart, Stall, Slow, Outage)),
        *("all lossy", "link lossy", "link one way", "parts cut"),
    }
    assert all(20 < count < len(SEEDS) - 20 for count in counts.values())


@pytest.mark.parametrize("seed", range(8))
def test_drawn_faults_can_be_written_into_a_lab_file(tmp_path, seed):
    text = (LABS / "testbed" / "lab.yaml").read_text()
    (tmp_path / "lab.yaml").write_text(
        text + "faults:\n" + "".join(f"  {line}\n" for line in fault_lines(chaotic(seed)))
    )
    written = load_lab(tmp_path)
    assert fault_lines(written) == fault_lines(chaotic(seed))
    assert set(written.faults) == set(chaotic(seed).faults)
    # A partition of two robots is a link that is cut: the same to all who hear.
    assert len(written.disturbances) == len(chaotic(seed).disturbances)


def test_a_lone_robot_has_no_links_to_lose():
    for seed in range(30):
        lab = with_chaos(calm().with_robots(1), seed)
        assert all(not disturbance.groups for disturbance in lab.disturbances)


def test_robots_killed_by_the_lab_file_are_not_killed_at_random():
    fated = replace(calm(), faults=(Kill(seconds(1), 2), Restart(seconds(2), 2)))
    for seed in range(40):
        assert sum(isinstance(fault, Kill) and fault.robot == 2 for fault in with_chaos(fated, seed).faults) == 1


@cache
def harder(seed):
    """Return the test-bed's lab with the faults of hard chaos of `seed`."""
    return with_chaos(calm(), seed, hard=True)


def test_hard_chaos_adds_faults_to_those_that_the_same_seed_draws_without_it():
    for seed in SEEDS:
        assert set(chaotic(seed).faults) <= set(harder(seed).faults)
        assert set(chaotic(seed).disturbances) <= set(harder(seed).disturbances)
        added = len(harder(seed).faults) + len(harder(seed).disturbances) - len(drawn(seed))
        assert 1 <= added <= 12


def test_hard_chaos_draws_long_stalls_and_partitions_and_robots_mute_and_deaf():
    stalls = [fault for seed in SEEDS for fault in harder(seed).faults if isinstance(fault, Stall)]
    lengths = [fault.end - fault.start for fault in stalls]
    assert seconds(30) < max(lengths) <= seconds(60)
    entries = [entry for seed in SEEDS for entry in fault_entries(harder(seed))]
    for kind in ("mute", "deaf", "partition"):
        spans = [entry["to"] - entry["from"] for entry in entries if kind in entry]
        assert 20.0 < max(spans) <= 30.0


def test_the_second_phase_begins_when_all_faults_of_hard_chaos_are_over():
    for seed in SEEDS:
        lab = harder(seed)
        heal = lab.duration - calm().duration
        assert max(over(fault) for fault in [*lab.faults, *lab.disturbances]) <= heal
        assert [disturbance.check() for disturbance in lab.disturbances] == list(lab.disturbances)


def test_drawn_faults_of_hard_chaos_can_be_written_into_a_lab_file(tmp_path):
    text = (LABS / "testbed" / "lab.yaml").read_text()
    (tmp_path / "lab.yaml").write_text(text + "faults:\n" + "".join(f"  {line}\n" for line in fault_lines(harder(5))))
    assert fault_lines(load_lab(tmp_path)) == fault_lines(harder(5))


def test_a_run_with_faults_at_random_is_the_same_under_another_hash_seed(tmp_path):
    small_lab(tmp_path, DRIVE, robots=2, finish="at(R, box)", duration="20s")
    texts = []
    for hash_seed in ("1", "2"):
        folder = tmp_path / hash_seed
        command = [sys.executable, "-m", "rmr_sim.main", str(tmp_path), "--chaos", "--seed", "11", "--run", str(folder)]
        answer = subprocess.run(
            command, env={**os.environ, "PYTHONHASHSEED": hash_seed}, capture_output=True, text=True, check=False
        )
        assert "faults drawn from the seed:\n- {" in answer.stderr
        texts.append((folder / "report.json").read_text())
    assert texts[0] == texts[1]
    assert len(json.loads(texts[0])["faults"]) > 0
