"""What is told of a robot whose process has ended."""

from types import SimpleNamespace
from typing import Any

import pytest

from rmr_deploy.run_status import ended


@pytest.mark.parametrize(
    ("code", "state"),
    [
        (0, ("stopped", "")),
        (1, ("died", "ended with exit code 1")),
        (-9, ("died", "was killed by SIGKILL")),
    ],
)
def test_a_robot_that_was_asked_to_stop_has_stopped_and_others_have_died(code, state):
    child: Any = SimpleNamespace(exit_code=lambda: code)
    assert ended(child) == state
