"""The states of one robot in one group, and the table of their transitions.

A robot has a role (how it stands to the group) and a phase (how far its own job is). The two move
independently, except that a robot without a job asks for nothing. The tables are the whole truth: the code
changes a state only through them, and an entry that is not there is a bug, not a peer's mistake.
"""

from enum import IntEnum
from typing import Final, NamedTuple


class Role(IntEnum):
    """How a robot stands to the group."""

    NONE = 0
    """No job here; frames are heard and remembered."""
    CANDIDATE = 1
    FOLLOWING = 2
    LEADING = 3


class Passage(IntEnum):
    """How far the robot's own job is."""

    WAITING = 0
    CLAIMING = 1
    INSIDE = 2
    OUT = 3
    """No live job."""


class Step(NamedTuple):
    """One allowed change: from, to, on which input."""

    source: IntEnum
    target: IntEnum
    on: str


ROLES: Final[tuple[Step, ...]] = (
    Step(Role.NONE, Role.CANDIDATE, "a job without a fresh schedule"),
    Step(Role.NONE, Role.FOLLOWING, "a job and a fresh schedule"),
    Step(Role.CANDIDATE, Role.FOLLOWING, "a fresh schedule"),
    Step(Role.CANDIDATE, Role.LEADING, "K questions unanswered, or named heir"),
    Step(Role.CANDIDATE, Role.NONE, "the job is over"),
    Step(Role.FOLLOWING, Role.CANDIDATE, "the leader is silent, or does not acknowledge"),
    Step(Role.FOLLOWING, Role.LEADING, "the leader resigned and named this robot heir"),
    Step(Role.FOLLOWING, Role.NONE, "the job is over"),
    Step(Role.LEADING, Role.FOLLOWING, "a better leader, and a job"),
    Step(Role.LEADING, Role.NONE, "a better leader, resigned, or no robot waits; no job"),
    Step(Role.LEADING, Role.CANDIDATE, "nothing issued for a lease, and a job"),
)

PASSAGES: Final[tuple[Step, ...]] = (
    Step(Passage.OUT, Passage.WAITING, "trigger"),
    Step(Passage.WAITING, Passage.CLAIMING, "claim timer, lease valid"),
    Step(Passage.WAITING, Passage.INSIDE, "inside when the job starts"),
    Step(Passage.CLAIMING, Passage.WAITING, "slot lost or moved, window over, or a rival is first"),
    Step(Passage.CLAIMING, Passage.INSIDE, "the fence is open"),
    Step(Passage.INSIDE, Passage.OUT, "left"),
    Step(Passage.WAITING, Passage.OUT, "withdrawn"),
    Step(Passage.CLAIMING, Passage.OUT, "withdrawn"),
)

_ALLOWED: Final = (
    frozenset((step.source, step.target) for step in ROLES),
    frozenset((step.source, step.target) for step in PASSAGES),
)


def check_role(source: Role, target: Role) -> None:
    """Assert that the table of roles has this change."""
    assert (source, target) in _ALLOWED[0], f"no transition from {source.name} to {target.name}"


def check_passage(source: Passage, target: Passage) -> None:
    """Assert that the table of passages has this change."""
    assert (source, target) in _ALLOWED[1], f"no transition from {source.name} to {target.name}"
