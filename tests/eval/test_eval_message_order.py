"""Message order (FIFO channels) under loss, and messages one at a time: two algorithms that need them.

The minimum spanning tree of Gallager, Humblet and Spira, and the snapshot of Chandy and Lamport.
"""

import re
from pathlib import Path
from random import Random

import pytest

MESSAGE_PROGRAMS = Path(__file__).parents[1] / "programs" / "messages"
GHS = MESSAGE_PROGRAMS / "ghs.rmr"
SNAPSHOT = MESSAGE_PROGRAMS / "snapshot.rmr"
ROBOTS = 8
MESSAGES = ("connect", "initiate", "test", "accept", "reject", "report", "changeroot")

Edge = tuple[int, int, int]
"""(weight, robot, robot)."""


def random_graph(seed: int) -> list[Edge]:
    rng = Random(seed)
    pairs = [(a, b) for a in range(1, ROBOTS + 1) for b in range(a + 1, ROBOTS + 1)]
    weights = rng.sample(range(1, 1000), len(pairs))
    chain = {(a, a + 1) for a in range(1, ROBOTS)}
    return [(w, *pair) for w, pair in zip(weights, pairs, strict=True) if pair in chain or rng.random() < 0.6]


def minimum_spanning_tree(edges: list[Edge]) -> set[Edge]:
    """Kruskal's algorithm."""
    part = list(range(ROBOTS + 1))
    tree = set()
    for edge in sorted(edges):
        _, a, b = edge
        if part[a] != part[b]:
            tree.add(edge)
            part = [part[a] if each == part[b] else each for each in part]
    return tree


def tree_of(report) -> set[Edge]:
    found = re.findall(r"edge\(@(\d+), @(\d+), (\d+), branch\)", str(report["robots"]))
    return {(int(w), *sorted((int(a), int(b)))) for a, b, w in found}


def program(edges: list[Edge], unordered: bool = False) -> str:
    text = re.sub(r"(?m)^edge\(@.*\n", "", GHS.read_text("utf-8"))
    if unordered:
        text = re.sub(rf"(?m)^type (?={'|'.join(MESSAGES)})", "type unordered ", text)
    return text + "".join(f"edge(@{a}, @{b}, {w}, basic). edge(@{b}, @{a}, {w}, basic).\n" for w, a, b in edges)


@pytest.mark.parametrize("seed", range(15))
def test_a_spanning_tree_by_ghs_is_right_at_twenty_percent_loss(bench, seed):
    edges = random_graph(seed)
    report = bench.run(program(edges), "--robots", str(ROBOTS), "--loss", "0.2", "--seed", str(seed))
    assert tree_of(report) == minimum_spanning_tree(edges)


def test_unordered_messages_overtake_and_cost_nothing_without_loss(bench):
    edges = random_graph(1)
    ordered = bench.run(program(edges), "--robots", str(ROBOTS))
    unordered = bench.run(program(edges, unordered=True), "--robots", str(ROBOTS))
    assert ordered["messages"] == unordered["messages"], "order takes no frame and no octet where nothing is lost"


@pytest.mark.parametrize("loss", ["0", "0.2"])
@pytest.mark.parametrize("seed", range(1, 21))
def test_a_snapshot_by_chandy_and_lamport_has_every_coin_once(bench, seed, loss):
    engine = "interpreter" if seed % 4 == 0 else "generated"
    arguments = ("--robots", "4", "--loss", loss, "--seed", str(seed), "--engine", engine)
    report = bench.run(SNAPSHOT.read_text("utf-8"), *arguments)
    facts = [fact for robot in report["robots"].values() for fact in robot["facts"]]
    assert "total(@1, 400, 16)" in facts, "the true total, of 4 robots and 12 channels"
    assert sum(int(coins) for coins in re.findall(r"coins\(@\d, (\d+)\)", str(facts))) == 400


HEARTBEATS = """
// Robot 1 beats each second; who has heard nothing for 3 s suspects it.
type leader(robot, robot).
type beat(robot, robot).
type tick(robot).
type action wait(robot, float).
type action suspect(R: robot, L: robot).
tick(@1).
leader(R, @1).
tick(R) -o {B | peer(R, B) | beat(B, R)}, wait(R, 1.0) then tick(R).
silence: watch(beat(R, L), beat(R, L), 3, suspect(R, L)).
beat(R, L), $leader(R, L) -o 1.
"""


@pytest.mark.parametrize("seed", [2, 3, 7])
def test_a_leader_that_beats_each_second_is_not_suspected_at_twenty_percent_loss(bench, seed):
    arguments = ("--robots", "12", "--loss", "0.2", "--action-time", "1s", "--seed", str(seed))
    report = bench.run(HEARTBEATS, *arguments)
    jobs = [job for robot in report["robots"].values() for job in robot["assertions"]]
    assert len(jobs) > 600
    assert not [job for job in jobs if job["met"] is False]
