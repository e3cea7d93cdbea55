"""What has gone wrong with a robot of a simulated run, for those who judge what came of it."""

from typing import NamedTuple

from rmr.base.time import Instant


class FaultRecord(NamedTuple):
    """A fault of one robot."""

    at: Instant
    until: Instant
    """Of what lasts for a while; else NEVER."""
    robot: int
    fault: str
    """A word of the trace's `fault`: killed, restarted, stalled, slowed, silenced."""
