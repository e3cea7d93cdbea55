"""Drawn sources compile or are refused; `compiler_campaign.py` has more of them."""

import pytest
from compiler_campaign import problem, source

pytestmark = pytest.mark.medium


@pytest.mark.parametrize("first", range(0, 400, 100))
def test_drawn_sources_are_answered_with_a_program_or_with_diagnostics(first):
    assert [(seed, wrong) for seed in range(first, first + 100) if (wrong := problem(source(seed))) is not None] == []
