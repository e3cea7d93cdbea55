"""What robots know of each other's shared facts, over a network with every fault."""

import pytest
from shared_campaign import History, campaign_program


@pytest.mark.parametrize("part", range(10))
def test_what_is_known_was_true_and_all_is_known_when_the_faults_end(part):
    program = campaign_program()
    for seed in range(part * 4, part * 4 + 4):
        assert History(seed, program).run() == []
