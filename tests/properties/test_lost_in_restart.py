"""What restarts without durable state lose is counted: no parcel is missing that the report does not account for."""

import random

import pytest

import rmr

HOPS = """
    type !next(robot, robot).
    type parcel(robot, int).
    parcel(R, K), !next(R, S) -o parcel(S, K).
"""
PARCELS = 20
RELAYS = (2, 3, 4)


def carried(folder, seed):
    """Return the evaluation of 20 parcels that go over three relays, which are killed and restarted at random."""
    rng = random.Random(f"parcels/{seed}")
    kill, restart = [], []
    for relay in RELAYS:
        at = 0.0
        for _ in range(rng.randint(0, 3)):
            at += rng.uniform(0.05, 2.5)
            back = at + rng.uniform(0.05, 1.5)
            kill.append(f"{at:.3f}s: @{relay}")
            restart.append(f"{back:.3f}s: @{relay}")
            at = back
    facts = [*(f"!next(@{i}, @{i + 1})." for i in range(1, 5)), *(f"parcel(@1, {k})." for k in range(PARCELS))]
    (folder / "hops.rmr").write_text(HOPS)
    (folder / "facts.rmr").write_text("\n".join(facts))
    return rmr.evaluate(
        folder / "hops.rmr", robots=5, facts=folder / "facts.rmr", kill=kill, restart=restart,
        loss=0.3, latency="20ms", seed=seed,
    )  # fmt: skip


def held(report):
    """Return the parcels that the robots have at the end."""
    facts = [fact for part in report["robots"].values() for fact in part["facts"]]
    return [fact.split(", ")[1] for fact in facts if fact.startswith("parcel")]


def missing(report):
    """Return how many parcels no robot has at the end."""
    return PARCELS - len(set(held(report)))


@pytest.mark.medium
def test_parcels_that_relays_lose_in_restarts_are_counted_and_told(tmp_path):
    losses = 0
    for seed in range(1, 16):
        result = carried(tmp_path, seed)
        parts = result.report["robots"]
        lost = missing(result.report)
        assert len(held(result.report)) == len(set(held(result.report))), "no parcel is doubled"
        counted = sum(part.get("lost_in_restart", 0) for part in parts.values())
        undelivered = sum(part["undelivered"] for part in parts.values())
        assert lost <= counted + undelivered
        warned = [text for text in result.messages if ": lost in restarts" in text]
        assert len(warned) == sum(part.get("lost_in_restart", 0) > 0 for part in parts.values())
        losses += lost
    assert losses > 0


def test_a_restart_of_a_robot_that_holds_its_initial_facts_only_loses_nothing(tmp_path):
    (tmp_path / "still.rmr").write_text("type seen(robot, int).\ntype !base(robot).\nseen(@1, 4). !base(@1).\n")
    result = rmr.evaluate(tmp_path / "still.rmr", robots=2, kill=["1s: @1"], restart=["2s: @1"])
    assert result.report["robots"]["1"]["lost_in_restart"] == 0
    assert not [text for text in result.messages if "lost in restarts" in text]


def test_a_fact_from_outside_is_lost_in_a_restart(tmp_path):
    (tmp_path / "still.rmr").write_text("type seen(robot, int).\nseen(@1, 4).\n")
    result = rmr.evaluate(
        tmp_path / "still.rmr", robots=2, insert=["0.5s: seen(@1, 5)"], kill=["1s: @1"], restart=["2s: @1"]
    )
    assert result.report["robots"]["1"]["lost_in_restart"] == 1
    assert "robot 1: lost in restarts (facts, actions, deliveries): 1" in result.messages
