"""Messages of any content from a holder of the secret: nothing ends, and of robots that live the truth is told."""

import pytest
from forged_campaign import problems


@pytest.mark.parametrize("seed", [1, 2])
def test_forged_messages_end_no_process_and_no_report_lies_about_robots_that_live(seed):
    assert problems(seed, 3000) == []
