"""Records of the faults of robots in a simulated run, for the checkers."""

from typing import NamedTuple

from rmr.base.time import Instant


class FaultRecord(NamedTuple):
    """A fault of one robot."""

    at: Instant
    until: Instant
    """End of a fault that lasts; else NEVER."""
    robot: int
    fault: str
    """The trace's word: killed, restarted, stalled, slowed or silenced."""
