"""Link sensing: which robots this one hears, and which of them hear it (symmetric links, as in OLSR, RFC 3626, 2.3).

A hello lists the robots whose hellos its sender has heard within `LISTED`. A link to another robot is *symmetric*
while a hello that lists this robot has been heard within `LISTED`. Three statements on silent robots follow:

- *Majority.* A robot that has symmetric links to all others may drive. If not, somebody may take it for dead and drive
  around its last place. So it drives only while it and those with settled symmetric links are a majority of the roster
  (of an even roster half of it with the least id is one, too); else it stands.
- *Last sign of life.* A robot that is not heard but listed by another lives. It was alive when it was last heard, by
  this robot or by one that has listed it since.
- *Presumed death.* A robot without a sign of life for DEAD is taken for a body that stands. Two majorities share a
  robot, which hears both sides and lists each to the other. So of two robots that presume each other dead one stands.

Without a majority a robot stands for `CUT_OFF_MAX` after it had one, then it drives by sight: its fellows may have died
for good. A roster beyond the reach of one radio has no use for majorities and does without (`rmr.node.config`).
"""

from collections.abc import Collection, Mapping
from typing import Final, final

from rmr.base.time import NEVER, Duration, Instant, milliseconds, seconds
from rmr.node.payloads import HELLO_LIST_OCTETS_MAX

LISTED: Final[Duration] = milliseconds(2400)
"""Age of the newest hello of another robot up to which it is listed as heard, and up to which its own list holds: four
hellos of a parked robot, twelve of one that drives."""
LISTED_CROWD: Final[Duration] = seconds(6)
"""The same in a crowd, whose robots speak up to five times more seldom and promise to stay (`rmr.node.peers.hello`).
Twice this is less than the time after which a silent robot is presumed dead: so it stands by then."""
CUT_OFF_MAX: Final[Duration] = seconds(60)
"""A robot without a majority stands for so long. Longer than any fault of the radio that is foreseen."""
WINDOW: Final = 8 * (HELLO_LIST_OCTETS_MAX - 1)
"""Robots in one list, if the roster is too large for a list of all; then the first octet says which."""
ROBOTS_MAX: Final = 2 * WINDOW
"""Larger rosters do without majorities: the parked robots of a crowd, which speak once a second, would tell each window
of the roster too seldom for LISTED_CROWD."""
NEVER_HEARD: Final[Instant] = -(1 << 62)
"""Stands for the instant of what has not happened: earlier than any."""


@final
class _Link:
    """What the lists of one other robot have said."""

    __slots__ = ("at", "bits", "listed_at", "settled_from")

    def __init__(self) -> None:
        self.listed_at: Instant = NEVER_HEARD
        """When a hello last listed this robot."""
        self.settled_from: Instant = NEVER
        """Since when no two such hellos have been farther apart than LISTED, and LISTED later."""
        self.bits: dict[int, int] = {}
        """Its newest lists, by window."""
        self.at: dict[int, Instant] = {}
        """When they were heard."""


class LinkSensing:
    """The links of one robot. All instants are those from which hellos count (`rmr.node.peers.presence.dated`)."""

    def __init__(self, robot: int, roster: Collection[int], *, crowd: bool = False, begins_late: bool = False) -> None:
        """`begins_late`: this is not the robot's first life, so others may presume it dead at its beginning."""
        self._robot = robot
        self._roster = sorted(roster)
        self._places = {other: place for place, other in enumerate(self._roster)}
        self._links: dict[int, _Link] = {}
        self._listed_before: dict[int, Instant] = {}
        """When robots that are listed no more were listed last, by their place in the roster."""
        self._window = 0
        self._windows = 1 if len(self._roster) <= 8 * HELLO_LIST_OCTETS_MAX else -(-len(self._roster) // WINDOW)
        self._late = begins_late
        self._first_at: Instant = NEVER
        """The first instant of its life that it knows of."""
        self.lasts: Final[Duration] = LISTED_CROWD if crowd else LISTED
        """Age up to which a hello, and the list in it, count."""

    # -- lists on the air ---------------------------------------------------------------------------------------

    def list_of(self, heard: Mapping[int, Instant], now: Instant) -> bytes:
        """Return the list for a hello said `now`; `heard`: when the last hello of each robot was heard."""
        self._window = (self._window + 1) % self._windows
        first, count = self._span(self._window)
        bits = 0
        for place, other in enumerate(self._roster[first : first + count]):
            if now - heard.get(other, NEVER_HEARD) <= self.lasts:
                bits |= 1 << place
        octets = bits.to_bytes(-(-count // 8), "big")
        return octets if self._windows == 1 else bytes((self._window,)) + octets

    def _span(self, window: int) -> tuple[int, int]:
        """Return the first place in the roster and the number of places of a window."""
        return (0, len(self._roster)) if self._windows == 1 else (window * WINDOW, WINDOW)

    def note(self, at: Instant, source: int, listed: bytes) -> None:
        """Take in the list of a hello of `source` that counts from `at`; one of another form is no list."""
        window = 0
        octets = listed
        if self._windows > 1 and listed:
            window = listed[0]
            octets = listed[1:]
        if window >= self._windows or len(octets) != -(-self._span(window)[1] // 8):
            return
        link = self._links.get(source)
        if link is None:
            link = self._links[source] = _Link()
        bits = int.from_bytes(octets, "big")
        gone = link.bits.get(window, 0) & ~bits
        while gone:  # rarely: a robot that was listed is so no more
            place = gone.bit_length() - 1
            gone ^= 1 << place
            place += self._span(window)[0]
            self._listed_before[place] = max(self._listed_before.get(place, NEVER_HEARD), link.at[window])
        link.bits[window] = bits
        link.at[window] = at
        place = self._places.get(self._robot, -1) - self._span(window)[0]
        if 0 <= place < self._span(window)[1] and bits >> place & 1:
            if at - link.listed_at > self.lasts:
                link.settled_from = at if self._begins(at) else at + self.lasts
            link.listed_at = max(link.listed_at, at)

    # -- what follows -------------------------------------------------------------------------------------------

    def cut_off(self, now: Instant) -> bool:
        """Return whether the robot has to stand, since others may presume it dead."""
        began = self._begins(now)
        needed = len(self._roster) - 1
        if self._held_until(now, settled=False, needed=needed) >= now:
            return False
        if began:
            return False  # nobody presumes it dead yet
        if self._majority_until(now, settled=True) >= now:
            return False
        had_one = self._majority_until(now, settled=False)
        return now < max(self._first_at, had_one) + CUT_OFF_MAX

    def _begins(self, now: Instant) -> bool:
        """Return whether the robots of the lab have just begun, so that nobody presumes anybody dead."""
        first_at = self.first_at(now)
        return not self._late and now - first_at <= self.lasts

    def first_at(self, now: Instant) -> Instant:
        """Return the first instant of the robot's life that is known, `now` at the latest."""
        self._first_at = min(self._first_at, now)
        return self._first_at

    def _majority_until(self, now: Instant, *, settled: bool) -> Instant:
        """Return until when the symmetric links, as they are known now, are those of a majority."""
        half = len(self._roster) // 2
        until = self._held_until(now, settled=settled, needed=half)
        if len(self._roster) % 2 == 0:
            least = self._roster[0]
            tie = self._held_until(now, settled=settled, needed=half - 1)
            if least != self._robot:
                tie = min(tie, self._until(now, least, settled=settled))
            until = max(until, tie)
        return until

    def _held_until(self, now: Instant, *, settled: bool, needed: int) -> Instant:
        """Return until when this robot has symmetric links to `needed` others."""
        if needed <= 0:
            return NEVER
        ends = sorted((self._until(now, other, settled=settled) for other in self._links), reverse=True)
        return ends[needed - 1] if len(ends) >= needed else NEVER_HEARD

    def _until(self, now: Instant, other: int, *, settled: bool) -> Instant:
        """Return until when the link to `other` is symmetric."""
        link = self._links.get(other)
        if link is None or link.listed_at == NEVER_HEARD or (settled and now < link.settled_from):
            return NEVER_HEARD
        return link.listed_at + self.lasts

    def listed(self, robot: int) -> Instant:
        """Return when another robot last listed `robot` as heard; NEVER_HEARD if none has."""
        place = self._places.get(robot)
        if place is None:
            return NEVER_HEARD
        window = 0 if self._windows == 1 else place // WINDOW
        last = self._listed_before.get(place, NEVER_HEARD)
        bit = place - self._span(window)[0]
        for link in self._links.values():
            if link.bits.get(window, 0) >> bit & 1:
                last = max(last, link.at[window])
        return last
