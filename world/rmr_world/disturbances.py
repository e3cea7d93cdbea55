"""The list of a running lab's radio disturbances: those of the lab file, and those added by `rmr fault`.

The world keeps the list and publishes it; each robot applies it to frames by their time stamps. A change takes effect
`LEAD` after it is made, so that all robots have received it by then. A disturbance that is over stays in the list for
`LINGER`, for frames that began before its end and whose reception is not decided everywhere.
"""

from collections.abc import Sequence
from typing import Any

from rmr.base.time import NEVER, Duration, Instant, milliseconds
from rmr.radio.links import DISTURBANCES_MAX, Disturbance
from rmr.radio.network import network_disturbance_problem

LEAD: Duration = milliseconds(50)
"""Delay of a change. A message takes 0.3 to 2 ms on the bus, and 20 ms on a loaded machine."""

LINGER: Duration = milliseconds(1000)
"""How long a disturbance is kept after its end: longer than any decision on a frame, and two periods of publishing."""

HISTORY_MAX = 1000
"""Bound of the disturbances that are over and kept for the report."""


class DisturbanceList:
    """The disturbances of one lab. Methods that change them take `now` in lab time."""

    def __init__(self, lab: str, roster: Sequence[int], given: Sequence[Disturbance], *, network: bool = False) -> None:
        """`network`: the radio is that of mode network."""
        self._lab = lab
        self._network = network
        self._roster = roster
        self.given = tuple(given)
        """Disturbances of the lab file."""
        self.added: tuple[Disturbance, ...] = ()
        """Disturbances added at run time, in the order in which they begin."""
        self._over: list[Disturbance] = []
        """Added disturbances that are no longer kept, the first HISTORY_MAX of them."""
        self.touched = False
        """Whether any has ever been added. From then on the list is published again and again, even if empty: a robot
        that missed the removal of the last one would apply it without end."""

    @property
    def held(self) -> tuple[Disturbance, ...]:
        """All present disturbances, those of the lab file first."""
        return self.given + self.added

    def add(self, wanted: Disturbance, now: Instant) -> str:
        """Add `wanted`, whose `until` counts from its beginning; return the reason of a refusal, empty if accepted."""
        self.forget(now)
        strangers = [str(i) for group in wanted.groups for i in group if i not in self._roster]
        if strangers:
            robots = ", ".join(map(str, self._roster))
            return f"lab {self._lab} has no robot {', '.join(strangers)}; its robots are {robots}"
        if self._network and (problem := network_disturbance_problem(wanted)):
            return problem
        if len(self.held) >= DISTURBANCES_MAX:
            return f"the radio is disturbed in {DISTURBANCES_MAX} ways already; end those added: rmr fault clear"
        self.touched = True
        begin = max(0, now) + LEAD
        self.added += (wanted._replace(since=begin, until=min(NEVER, begin + wanted.until)),)
        return ""

    def kept(self) -> list[Any]:
        """Return what was added as plain data."""
        return [one.to_wire() for one in self.added]

    def bring_back(self, added: Sequence[Disturbance]) -> None:
        """Take over what an interrupted world had added."""
        self.added = tuple(added)
        self.touched = bool(added)

    def clear(self, now: Instant) -> None:
        """End all added disturbances."""
        self.forget(now)
        end = max(0, now) + LEAD
        # A disturbance that has not begun is removed: it is no part of the run.
        self.added = tuple(one._replace(until=min(end, one.until)) for one in self.added if one.since < end)

    def forget(self, now: Instant) -> None:
        """Move added disturbances that have been over for `LINGER` to the history."""
        over = [one for one in self.added if now >= one.until + LINGER]
        if over:
            self._over += over[: HISTORY_MAX - len(self._over)]
            self.added = tuple(one for one in self.added if one not in over)

    @property
    def history(self) -> tuple[Disturbance, ...]:
        """All added disturbances, past ones included."""
        return (*self._over, *self.added)
