"""All groups of one robot: election, schedules, and the frames for the radio.

The core is timing in, timing out. The host hands it triggers, frames and `now`, calls `wake` at `next_wake`
or a little later, and takes frames and events away with `drain`. Robots that have no job of an event hear its
frames all the same and keep its newest schedule and beacons, so that they know who is inside when they come.
"""

from collections.abc import Callable
from functools import lru_cache
from random import Random
from typing import Final

from rmr.base.direction import DIRECTION_MAX, EXCLUSIVE
from rmr.base.grid_path import GridPath
from rmr.base.time import NEVER, Duration, Instant
from rmr.coord.context import Context, Outbox, OwnJob
from rmr.coord.events import CoordEvent, JobRequest, Send
from rmr.coord.group import Group
from rmr.coord.messages import GROUP_ID_OCTETS, OVER, Beacon, FrameKind, MessageError, decode
from rmr.coord.states import Passage, Role
from rmr.coord.term import NOBODY
from rmr.coord.timing import GROUPS_MAX, IN_FLIGHT_MAX, Timing

__all__ = ["Coordination", "JobRequest"]

_KIND_LAST: Final = 0x0F

_decoded = lru_cache(maxsize=256)(decode)
"""`decode`, remembered: in virtual time many robots hear the same octets."""


class Coordination:
    """The coordination core of one robot."""

    def __init__(
        self,
        robot: int,
        rng: Random,
        known_peers: "Callable[[], int] | int",
        timing: Timing | None = None,
        stands_inside: Callable[[bytes, int], bool] = lambda _group_id, _robot: False,
    ) -> None:
        """`known_peers`: number of other robots, as far as known. A robot that has heard questions of so many concludes
        that none of them leads. It also determines waiting times.

        `stands_inside` says of a group and a robot whether that robot stands inside as far as the host knows. Its
        silence then ends nothing that it has announced.
        """
        self.robot = robot
        self.malformed = 0
        """Frames that were no frames of coordination or from a broken clock."""
        self._rng = rng
        self._peers: Callable[[], int] = known_peers if callable(known_peers) else lambda: known_peers
        self._timing = Timing() if timing is None else timing
        self._stands_inside = stands_inside
        self._outbox = Outbox()
        self._groups: dict[bytes, Group] = {}
        self.next_wake: Instant = NEVER

    def trigger(self, now: Instant, request: JobRequest) -> None:
        """A job starts. Raises ValueError for an event that is not six octets or a direction outside 0..15."""
        if len(request.group_id) != GROUP_ID_OCTETS or not 0 <= request.direction <= DIRECTION_MAX:
            raise ValueError("a group id has six octets and a direction is 0..15")
        self._group(request.group_id).trigger(now, request)
        self._settle()

    def revise(
        self,
        now: Instant,
        group_id: bytes,
        *,
        release: Instant | None = None,
        duration: Duration | None = None,
        deadline: Instant | None = None,
        underway: bool | None = None,
    ) -> None:
        """The robot's own estimate has changed; the leader hears of it if it matters and the slot can still move."""
        self._group(group_id).revise(now, release, duration, deadline, underway)
        self._settle()

    def receive(self, now: Instant, payload: bytes, source: int) -> bool:
        """Process a frame's payload; return False if it is no coordination frame (or malformed, which is counted)."""
        if not payload or not 0 < payload[0] <= _KIND_LAST:
            return False
        try:
            message = _decoded(payload, self._timing.payload_max)
        except MessageError:
            self.malformed += 1
            return False
        time = message[1]
        if time > now + self._timing.future:
            self.malformed += 1
            return False
        self._group(message.group_id).receive(now, message, source)
        self._settle()
        return True

    def overhear(self, now: Instant, payload: bytes) -> bool:
        """Take in a frame that changes nothing but what is known of a robot that passes; else return False."""
        if not payload or payload[0] != FrameKind.BEACON:
            return False
        try:
            beacon = _decoded(payload, self._timing.payload_max)
        except MessageError:
            return False
        group = self._groups.get(beacon.group_id)
        if group is None or not isinstance(beacon, Beacon) or beacon.time > now + self._timing.future:
            return False
        return group.overhear(now, beacon)

    def confirmed(self, now: Instant, handle: int, status: str) -> None:
        """The outcome of a unicast: ``ok``, ``no_ack`` or ``access_failure``. Unknown handles are ignored."""
        group_id = self._outbox.owners.pop(handle, None)
        group = None if group_id is None else self._groups.get(group_id)
        if group is not None:
            group.confirmed(now, status)
            self._settle()

    def job(self, group_id: bytes) -> OwnJob | None:
        """Return the robot's live job of `group_id`, read only; None when there is none."""
        group = self._groups.get(group_id)
        return None if group is None else group.context.job

    def passes(self, group_id: bytes) -> bool:
        """Return whether a job of `group_id` that is not over is known to pass in one direction, by a schedule or a
        beacon."""
        group = self._groups.get(group_id)
        if group is None:
            return False
        context = group.context
        listed = (e.direction for e in context.held.entries() if e.robot != NOBODY and e.phase not in OVER)
        heard = (record.beacon.direction for record in context.fence.records.values())
        return any(direction != EXCLUSIVE for direction in (*listed, *heard))

    def contended(self, group_id: bytes) -> bool:
        """Return whether the schedule of `group_id` lists another robot whose turn is not over."""
        group = self._groups.get(group_id)
        if group is None:
            return False
        others = [e for e in group.context.held.entries() if e.robot not in (NOBODY, self.robot)]
        return any(entry.phase not in OVER for entry in others)

    def inside(self, now: Instant, group_id: bytes) -> list[int]:
        """Return the other robots that are to be taken for inside, as far as this one has heard."""
        group = self._groups.get(group_id)
        beacons = () if group is None else group.context.fence.inside(now)
        return sorted(beacon.who for beacon in beacons if beacon.who != self.robot)

    def ready(self, now: Instant, group_id: bytes, ready: bool) -> None:
        """The robot is at its gate, or will be within the entry window: entering is allowed; or no more."""
        if self._group(group_id).ready(now, ready):
            self._settle()

    def inside_until(self, now: Instant, group_id: bytes, end: Instant) -> None:
        """While inside: the end has moved."""
        self._group(group_id).inside_until(now, end)

    def leave(self, now: Instant, group_id: bytes) -> None:
        """Clear of it: the job is done."""
        self._group(group_id).leave(now)
        self._settle()

    def withdraw(self, now: Instant, group_id: bytes) -> None:
        """The job is over without entering."""
        self._group(group_id).withdraw(now)
        self._settle()

    def offer_path(self, now: Instant, group_id: bytes, direction: int, path: GridPath) -> None:
        """The leader's path for one direction, to be sent to the others."""
        self._group(group_id).offer_path(now, direction, path)
        self._settle()

    def wake(self, now: Instant) -> None:
        """Run all timers that are due."""
        if now < self.next_wake:
            return
        for group in self._groups.values():
            if group.next_wake <= now:
                group.wake(now)
        self._settle()

    @property
    def has_news(self) -> bool:
        """Whether there is anything to drain."""
        return bool(self._outbox.items)

    def drain(self) -> "list[Send | CoordEvent]":
        """Return the frames and events since the last call, oldest first."""
        items = self._outbox.items
        if items:
            self._outbox.items = []
        return items

    def _group(self, group_id: bytes) -> Group:
        group = self._groups.get(group_id)
        if group is None:
            if len(self._groups) >= GROUPS_MAX:
                self._forget()
            context = Context(group_id, self.robot, self._rng, self._peers, self._timing, self._outbox)
            context.fence.stands_inside = self._stands_inside
            group = self._groups[group_id] = Group(context)
        return group

    def _forget(self) -> None:
        """Make room: drop the event that has been quiet longest and has no live job here."""
        idle = [
            (group.context.awake, group_id)
            for group_id, group in self._groups.items()
            if group.context.passage is Passage.OUT and group.context.role is Role.NONE
        ]
        if idle:
            del self._groups[min(idle)[1]]

    def _settle(self) -> None:
        self.next_wake = min((group.context.next_wake for group in self._groups.values()), default=NEVER)
        owners = self._outbox.owners
        while len(owners) > IN_FLIGHT_MAX:
            del owners[next(iter(owners))]
