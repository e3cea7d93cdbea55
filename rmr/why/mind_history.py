"""The edge to whatever knows what robots have done: a provenance log for each incarnation of each robot.

Logs of a recorded run come from replays of its minds, of robots that are asked for and no others.
"""

from collections.abc import Sequence
from typing import Protocol

from rmr.base.time import Instant
from rmr.bytecode.program import Program
from rmr.vm.provenance import ProvenanceRecord


class MindHistory(Protocol):
    """What one incarnation of a robot has done."""

    @property
    def robot(self) -> int:
        """The robot's id."""

    @property
    def epoch(self) -> int:
        """Number of earlier incarnations."""

    @property
    def records(self) -> Sequence[ProvenanceRecord]:
        """In the order in which things happened."""


class HistorySource(Protocol):
    """The histories of a run."""

    @property
    def program(self) -> Program:
        """The program that the robots run."""

    @property
    def robots(self) -> Sequence[int]:
        """The ids of the robots of the run, ascending."""

    @property
    def known_until(self) -> Instant:
        """The instant up to which the run is known."""

    def histories(self, robot: int) -> Sequence[MindHistory]:
        """Return the incarnations of `robot`, the oldest first; none if nothing of it was recorded."""
