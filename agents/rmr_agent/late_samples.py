"""Samples of its body that reach a robot too late: it drives on none that old, and says here why it stands."""

import logging

from rmr.base.time import Instant, in_seconds
from rmr.bus.late_messages import LIMIT, LateMessages

log = logging.getLogger("rmr")


class LateSamples(LateMessages):
    """The late samples of one robot."""

    def __init__(self, robot: int) -> None:
        super().__init__()
        self._robot = robot

    def note(self, stamp: Instant, now: Instant) -> bool:
        """Take note of a sample of the instant `stamp` that has arrived `now`; warn, and return whether it did."""
        due = super().note(stamp, now)
        if due:
            log.warning(
                "robot %d stands: its samples arrive %.0f ms late, and it drives on none older than %.0f ms; "
                "the bus is delayed or the machine is too slow",
                self._robot,
                in_seconds(now - stamp) * 1000,
                in_seconds(LIMIT) * 1000,
            )
        return due
