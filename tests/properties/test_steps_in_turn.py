"""One deadline, a turn at every contended step of the job (paper II.C)."""

import pytest
import steps_campaign as campaign
from steps_campaign import Chain

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
