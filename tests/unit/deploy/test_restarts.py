"""The restart policy: which exits it is for, how often, and after what pause."""

import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from rmr_deploy.process_group import Child
from rmr_deploy.restarts import (
    FIRST_PAUSE_S,
    PAUSE_S_MAX,
    STEADY_S,
    RestartPolicy,
    Restarts,
    next_name,
    restart_policy,
    world_policy,
)


@pytest.mark.parametrize(
    ("text", "policy"),
    [
        ("no", None),
        ("on-failure", RestartPolicy(None)),
        ("on-failure:1", RestartPolicy(1)),
        ("on-failure:120", RestartPolicy(120)),
    ],
)
def test_policy_is_read(text, policy):
    assert restart_policy(text) == policy


@pytest.mark.parametrize("text", ["", "always", "on-failure:", "on-failure:0", "on-failure:-1", "on-failure:x", "No"])
def test_wrong_policy_is_refused_with_what_to_write(text):
    with pytest.raises(ValueError, match="should be no, on-failure, or on-failure:N"):
        restart_policy(text)


def test_only_failures_are_tried_again_and_the_pause_doubles_until_a_process_is_steady():
    policy = RestartPolicy(2)
    assert policy.pause_s(0, 0, 1.0, None) is None
    assert policy.pause_s(3, 0, 1.0, None) is None, "the program is invalid"
    assert policy.pause_s(-9, 0, 1.0, None) == FIRST_PAUSE_S
    assert policy.pause_s(1, 1, 1.0, FIRST_PAUSE_S) == 2 * FIRST_PAUSE_S
    assert policy.pause_s(1, 1, STEADY_S, 5.0) == FIRST_PAUSE_S
    assert policy.pause_s(1, 1, 1.0, PAUSE_S_MAX) == PAUSE_S_MAX
    assert policy.pause_s(1, 2, 1.0, FIRST_PAUSE_S) is None


def child(name):
    return Child(name, SimpleNamespace(pid=0), Path("x"), time.monotonic())


def test_process_that_failed_is_followed_by_the_next_until_somebody_else_starts_it():
    started = []
    restarts = Restarts(RestartPolicy(), lambda robots, name: started.append((robots, name)))
    assert restarts.failed(child("robot-3"), 1, [3]) == FIRST_PAUSE_S
    assert restarts.waits(3)
    assert restarts.start_due() == []
    assert started == [], "its pause is not over"
    restarts.forget(3)
    assert not restarts.waits(3)
    assert next_name("robot-3") == "robot-3.1"
    assert next_name("robot-1-20.9") == "robot-1-20.10"


def test_process_that_cannot_be_started_is_told(monkeypatch):
    def start(_robots, _name):
        raise OSError(12, "Cannot allocate memory")

    restarts = Restarts(RestartPolicy(), start)
    restarts.failed(child("robot-3"), -6, [3])
    later = time.monotonic() + 1.0
    monkeypatch.setattr(time, "monotonic", lambda: later)
    assert restarts.start_due() == ["robot-3.1 cannot be started: Cannot allocate memory"]
    assert not restarts.waits(3)


def test_without_a_policy_nothing_is_started_again():
    restarts = Restarts(None, lambda *_: pytest.fail("started"))
    assert restarts.failed(child("robot-3"), 1, [3]) is None
    assert not restarts.waits(3)


def test_a_world_is_given_up_after_five_restarts_in_a_row_unless_the_policy_of_robots_has_a_number():
    policy = world_policy(RestartPolicy())
    assert (policy, world_policy(RestartPolicy(2))) == (world_policy(None), RestartPolicy(2))
    assert policy.pause_s(-9, 4, 1.0, 1.0) == 2.0
    assert policy.pause_s(-9, 5, 1.0, 1.0) is None
    assert policy.pause_s(-9, 5, STEADY_S, 1.0) == FIRST_PAUSE_S
