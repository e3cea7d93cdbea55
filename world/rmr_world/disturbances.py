"""What disturbs the radio of a lab that runs: what the lab file says, and what people add by `rmr fault`.

The world only keeps the list and hands it to the robots; each of them applies it to frames by their time stamps.
So that all have heard of a change before it holds, whatever is added or ended begins or ends `LEAD` from now, and
what is over is kept for `LINGER`: a frame that began before may not have been decided everywhere.
"""

from collections.abc import Sequence

from rmr.base.time import NEVER, Duration, Instant, milliseconds
from rmr.radio.links import DISTURBANCES_MAX, Disturbance

LEAD: Duration = milliseconds(50)
"""Between a person's wish and its effect; a message crosses the bus in 0.3 to 2 ms, on a loaded machine in 20."""

LINGER: Duration = milliseconds(1000)
"""How long what is over is kept: more than anybody takes to decide a frame, and twice the time between two tellings."""

HISTORY_MAX = 1000
"""Disturbances that are over and stay known, for the report."""


class DisturbanceList:
    """The disturbances of one lab. Changes are handed `now`, lab time."""

    def __init__(self, lab: str, roster: Sequence[int], given: Sequence[Disturbance]) -> None:
        self._lab = lab
        self._roster = roster
        self.given = tuple(given)
        """By the lab file."""
        self.added: tuple[Disturbance, ...] = ()
        """By people, in the order in which they begin."""
        self._over: list[Disturbance] = []
        """Of what was added, what has been forgotten since: HISTORY_MAX of them, the first."""
        self.touched = False
        """Whether people have ever added any. From then on the list bears being told again, empty or not: who has
        missed that the last one was cleared before it began would hold it for ever."""

    @property
    def held(self) -> tuple[Disturbance, ...]:
        """All of them, the lab file's first."""
        return self.given + self.added

    def add(self, wanted: Disturbance, now: Instant) -> str:
        """Let `wanted` begin, and last until its `until`, counted from then; return why not, or nothing."""
        self.forget(now)
        strangers = [str(i) for group in wanted.groups for i in group if i not in self._roster]
        if strangers:
            robots = ", ".join(map(str, self._roster))
            return f"lab {self._lab} has no robot {', '.join(strangers)}; its robots are {robots}"
        if len(self.held) >= DISTURBANCES_MAX:
            return f"the radio is disturbed in {DISTURBANCES_MAX} ways already; end those added: rmr fault clear"
        self.touched = True
        begin = max(0, now) + LEAD
        self.added += (wanted._replace(since=begin, until=min(NEVER, begin + wanted.until)),)
        return ""

    def clear(self, now: Instant) -> None:
        """End all that has been added."""
        self.forget(now)
        end = max(0, now) + LEAD
        # What has not begun yet is no part of the run.
        self.added = tuple(one._replace(until=min(end, one.until)) for one in self.added if one.since < end)

    def forget(self, now: Instant) -> None:
        """Forget what has been added and is long over."""
        over = [one for one in self.added if now >= one.until + LINGER]
        if over:
            self._over += over[: HISTORY_MAX - len(self._over)]
            self.added = tuple(one for one in self.added if one not in over)

    @property
    def history(self) -> tuple[Disturbance, ...]:
        """All that people have added and that has begun, or will, also what is over."""
        return (*self._over, *self.added)
