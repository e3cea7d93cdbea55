"""One deadline, a turn at every contended step of the job (paper II.C)."""

import pytest
import steps_campaign as campaign
from steps_campaign import Chain

import rmr

pytestmark = pytest.mark.medium

SEEDS = range(1, 31)


@pytest.mark.parametrize("engine", ["generated", "interpreter"])
@pytest.mark.parametrize("then", [False, True])
def test_ii_c_each_contended_step_has_turns_in_the_order_of_the_deadlines(then: bool, engine: str) -> None:
    chain = Chain(then, (3.0, 3.0), (14.0, 8.0, 11.0))
    met, wrong = campaign.run(chain, 1, engine)
    assert (met, wrong) == (3, [])


def test_ii_c_chains_of_contended_steps_meet_as_many_deadlines_as_the_best_fixed_order() -> None:
    chains = [campaign.drawn(seed) for seed in SEEDS]
    found = [campaign.run(chain, seed) for chain, seed in zip(chains, SEEDS, strict=True)]
    assert [wrong for _, wrong in found if wrong] == []
    assert sum(met for met, _ in found) >= 0.98 * sum(chain.best for chain in chains)


@pytest.mark.parametrize("seed", [40, 50, 81, 98, 141])
def test_robots_are_ordered_by_the_longest_step_ahead_and_by_the_newest_estimates(seed: int) -> None:
    """An earlier step was ordered as if the robots did not have to wait at the longer one behind it (50, 98, 141).

    A leader that had a robot's job from its question was not told the new release for two seconds (40, 81, 141).
    """
    chain = campaign.drawn(seed)
    assert campaign.run(chain, seed) == (chain.best, [])


def test_a_deadline_that_no_split_over_the_steps_meets_is_told_as_the_job_starts() -> None:
    chain = Chain(True, (2.0, 3.0), (4.5, 20.0))
    done = rmr.evaluate(
        chain.program, robots=2, action_times={"step0": 2.0, "step1": 3.0}, until=60, seed=1, trace=True
    )
    [told] = [entry for entry in done.trace if entry["what"] == "cannot_meet"]
    assert (told["t"], told["robot"], told["step"], told["needs_s"], told["left_s"]) == (0, 1, "whole()", 5.0, 4.5)
    assert done.messages == [
        "robot 1: arrived(@1) cannot be in time: it needs 5 s and has 4.5 s; the longest step is whole()"
    ]


SIBLING = """
type begin(robot).
type status(robot, int).
type count(robot, int).
type !served(robot).
count(@1, 400).
count(R, N), N > 0 -o status(@2, N), count(R, N - 1).
count(R, 0) -o begin(R).
begin(R) -o ask(R), wanted(@2, R).
service: watch(ask(A), served(A), 0.01, say(A, "late")).
wanted(B, A) -o served(A).
status(R, _) -o 1.
type action say(robot, string).
"""


def test_what_the_firing_derives_that_starts_a_job_serves_it() -> None:
    """`wanted` waits behind 400 routine facts: it inherits the deadline, and the miss is one of the queue."""
    done = rmr.evaluate(SIBLING, robots=2, until=60)
    assert done.report["robots"]["1"]["assertions"][0]["cause"] == "queue"
