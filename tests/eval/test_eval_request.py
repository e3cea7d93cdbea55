"""A request written by hand joins facts of several robots and loses none, whatever the radio loses."""

from collections import Counter

import pytest
from eval_command import facts

SEEDS = range(12)
WAITING, FREE = (1, 2, 3), (4, 5)
BEGINNING = "\n".join(
    [
        "type !edge(robot, robot).",
        *(f"waiting(@{a})." for a in WAITING),
        *(f"free(@{b})." for b in FREE),
        *(f"!edge(@{a}, @{b})." for a in WAITING for b in FREE),
    ]
)
GIVEN_AWAY = """
type !edge(robot, robot).
type !gone(robot, robot).
waiting(@2).
free(@3).
!edge(@3, @1).
!edge(@3, @2).
free(B), edge(B, A) -o is_free(A, B).
waiting(A), is_free(A, B) -o gone(A, B).
"""
"""What is not enough: `B` gives itself to any neighbour."""
RULES = """
$waiting(A), edge(A, B) -o wanted(B, A).
free(B), wanted(B, A) -o given(A, B).
waiting(A), given(A, B) -o go(A, B).
given(A, B), not waiting(A) -o free(B).
type go(robot, robot).
"""


def everywhere(report):
    """Return how often each predicate is held by any robot, `edge` aside."""
    held = [fact.lstrip("!").split("(")[0] for robot in report["robots"] for fact in facts(report, robot)]
    return Counter(held) - Counter({"edge": 10**6})


@pytest.mark.parametrize("loss", [0, 0.2, 0.4])
def test_request_pattern_loses_no_fact_at_any_loss(bench, loss):
    for seed in SEEDS:
        report = bench.run(BEGINNING + RULES, "--robots", "5", "--loss", str(loss), "--seed", str(seed))
        held = everywhere(report)
        assert report["quiescent"], (loss, seed)
        assert (held["go"], held["waiting"], held["free"], held["given"]) == (2, 1, 0, 0), (loss, seed)


@pytest.mark.parametrize("loss", [0, 0.4])
def test_request_pattern_gives_back_what_came_too_late(bench, loss):
    text = BEGINNING.replace("waiting(@2).\n", "").replace("waiting(@3).\n", "")
    for seed in SEEDS:
        report = bench.run(text + RULES, "--robots", "5", "--loss", str(loss), "--seed", str(seed))
        held = everywhere(report)
        assert (held["go"], held["waiting"], held["free"], held["given"]) == (1, 0, 1, 0), (loss, seed)


def test_a_fact_sent_to_any_neighbour_may_be_lost_to_the_one_that_waits(bench):
    runs = [everywhere(bench.run(GIVEN_AWAY, "--robots", "3", "--seed", str(seed))) for seed in SEEDS]
    assert any(held["waiting"] and held["is_free"] for held in runs)
