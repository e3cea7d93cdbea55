"""The entry gate of a route as one robot drives up to it: when to leave, how fast to come, where to stop.

Two places on the route matter. At the *hold line* a robot waits whose gate stays closed, its front just before the
bottleneck's point. At the *commit line*, farther out, it can still stop for the hold line from full speed. Slots refer
to the commit line: a robot that crosses it at full speed as its slot opens loses nothing. A robot leaves just in time
and adapts its speed, rather than wait before the entrance where others pass.
"""

from collections.abc import Iterable
from typing import Final

from rmr.base.arena import FloorPassage, RobotShape
from rmr.base.geometry import Point, Pose, distance
from rmr.base.motion_scale import PLANNED_BRAKE, scale_of
from rmr.base.time import Instant, in_seconds
from rmr.node.motion.follow import braking_speed
from rmr.node.motion.route import Route

HOLD_MARGIN_M: Final = 0.01
"""Distance of the hull's front from the bottleneck's point when the robot waits at the hold line."""
PASSED_M: Final = 0.02
"""A robot this far beyond the hold line has driven on."""
EARLY_S: Final = 0.25
"""A robot leaves this much earlier than just in time and makes up for it by driving slower, seconds."""
EARLY_SHARE: Final = 0.1
"""A robot leaves earlier by this share of the time that is left, too."""
MOUTH_S: Final = 2.0
"""Patience of a robot that stands without its turn in an entrance by which others come out, or before one that stands
there, seconds; then it clears the entrance."""
MEETS_RADII: Final = 3.0
"""Two robots whose centres are nearer than this stand before each other: there is no room to turn past."""
SLOWEST_MPS: Final = 0.02
"""Least speed towards the commit line when time abounds: a robot under way has to be seen to be under way."""
PUT_OFF_S: Final = 5.0
"""A robot under way whose slot has been deferred by more than this stands where it is: those that go first have to pass
it. With less it drives on slowly."""
AHEAD_S: Final = 3.0
"""A robot that holds for longer than this need not replan: others will move before it leaves."""


class EntryGate:
    """What is known about the gate during one drive."""

    __slots__ = (
        "_in_mouth_since", "_line_m", "_route", "_stop_m", "cleared", "holding", "opened", "opens_at", "passage",
        "passed", "shape", "way",
    )  # fmt: skip

    def __init__(self, shape: RobotShape, *, holding: bool) -> None:
        self.shape = shape
        self.opens_at: Instant | None = None
        self.opened = False
        self.passage: str | None = None
        """The passage for which the two hold, and in which the robot is once it has passed; None: any."""
        self.holding = holding
        """Not yet left: it is too early."""
        self.passed = False
        self.cleared = False
        self.way = 0
        """The direction in which the robot has passed."""
        self._in_mouth_since: Instant | None = None
        self._route: Route | None = None
        """The route that was asked for last."""
        self._stop_m = self._line_m = 0.0

    def hold_line_m(self, route: Route) -> float:
        """Return the arc length at which the robot waits for the gate to open."""
        if route is not self._route:
            self._measure(route)
        return self._stop_m

    def commit_line_m(self, route: Route) -> float:
        """Return the arc length of the commit line."""
        if route is not self._route:
            self._measure(route)
        return self._line_m

    def _measure(self, route: Route) -> None:
        shape = self.shape
        self._route = route
        self._stop_m = max(0.0, (route.gate_m or 0.0) - self.room(route))
        # Braking distance from full speed: v^2 / (2 a).
        self._line_m = max(0.0, self._stop_m - shape.speed * shape.speed / (2.0 * PLANNED_BRAKE))

    def locate(self, route: Route, s: float, arrived: bool) -> None:
        """Take in the robot's progress."""
        if route.gate_m is None:
            return
        if s > self._entry_m(route) + PASSED_M:
            self.way = self.way if self.passed else route.way
            self.passed = True
            self.passage = route.passage
        if self.passed and (arrived or s >= route.clear_m):
            self.cleared = True

    def backed_out(self, passage: FloorPassage | None, pose: Pose) -> bool:
        """Return whether the robot, which is clear of `passage`, stands before the entrance by which it came."""
        if passage is None or passage.one_way:
            return False
        here = (pose.x, pose.y)
        return distance(*here, *passage.entrance(self.way)) < distance(*here, *passage.end(self.way))

    def step_back(self) -> None:
        """Count the robot as before the gate again: it has left by the entrance by which it came."""
        self.passed = self.cleared = False

    def _entry_m(self, route: Route) -> float:
        """Return from where on the robot counts as driving through.

        With its turn that is the hold line. Without it, where room is left before the entrance for others, the hull
        has to be inside, as that of a robot that was pushed in: else a robot that begins in that room, where it may
        not wait, would count as inside for a step to and fro.
        """
        if self.open_to(route) or route.within or route.room_m <= 0.0 or route.gate_m is None:
            return self.hold_line_m(route)
        return route.gate_m + self.shape.radius

    def open_to(self, route: Route) -> bool:
        """Return whether the robot may drive through the gate of `route`: its turn is one at that passage."""
        return self.opened and self._concerns(route)

    def _concerns(self, route: Route) -> bool:
        return self.passage is None or self.passage == route.passage

    def limit(self, now: Instant, route: Route, s: float) -> float:
        """Return the speed that the gate allows at arc length `s`, m/s."""
        speed = self.shape.speed
        if route.gate_m is None or self.passed or self.open_to(route):
            self.holding = False
            return speed
        stop = braking_speed(self.hold_line_m(route) - s)  # so that the robot stops at the hold line
        if self.opens_at is None or not self._concerns(route):
            self.holding = False
            return min(speed, stop)
        left = in_seconds(self.opens_at - now)
        to_line = self.commit_line_m(route) - s
        # Not yet left: hold until it is time. Under way: stand again only if the slot has been deferred by much.
        self.holding = self._too_early(to_line, left) and (self.holding or left > PUT_OFF_S + to_line / speed)
        if self.holding:
            return 0.0
        if to_line <= 0.0 or left <= 0.0:
            return min(speed, stop)
        # The even speed that takes the robot to the commit line as the slot opens.
        return min(speed, stop, max(SLOWEST_MPS, to_line / left))

    def blocks(self, now: Instant, route: Route, s: float, standing: Iterable[Point] = ()) -> bool:
        """Return whether the robot has stood for `MOUTH_S` where others come out, nearer than where it may wait.

        Or right before one of those that are `standing` there: it cannot get out.
        """
        has_turn = self.open_to(route) or self.passed or route.within
        if route.room_m <= 0.0 or has_turn or not self._meets(route, s, standing):
            self._in_mouth_since = None
            return False
        self._in_mouth_since = now if self._in_mouth_since is None else self._in_mouth_since
        return in_seconds(now - self._in_mouth_since) > MOUTH_S

    def _meets(self, route: Route, s: float, standing: Iterable[Point]) -> bool:
        """Return whether the robot is in the entrance without its turn, or before one of those `standing` in it."""
        gate = route.gate_m or 0.0
        room = self.room(route)
        if gate - s <= room - HOLD_MARGIN_M:
            return True
        here = route.point(s)
        mouth = route.point(gate)
        near = MEETS_RADII * self.shape.radius
        return any(distance(*here, *other) < near and distance(*mouth, *other) < room for other in standing)

    def room(self, route: Route) -> float:
        """Return how far from the mouth the centre of a robot that waits is, metres."""
        return route.room_m + self.shape.radius + HOLD_MARGIN_M

    def met_by(self, route: Route | None) -> int | None:
        """Return the robot's way inside a bottleneck in which others may come towards it; None elsewhere."""
        inside = self.passed and not self.cleared
        return route.way if inside and route is not None and route.room_m > 0.0 else None

    def waiting(self, now: Instant, route: Route) -> bool:
        """Return whether standing is in order, because the robot's turn at the gate is still to come."""
        if route.gate_m is None or self.passed or self.open_to(route):
            return False
        return self.opens_at is None or now < self.opens_at

    def holds_for_long(self, now: Instant, route: Route, s: float) -> bool:
        """Return whether the robot would not yet leave were its way longer by what it drives in `AHEAD_S`."""
        if not self.holding or self.opens_at is None:
            return False
        return self._too_early(
            self.commit_line_m(route) - s + AHEAD_S * self.shape.speed, in_seconds(self.opens_at - now)
        )

    def _too_early(self, to_line: float, left: float) -> bool:
        """Return whether leaving now would mean creeping."""
        return (
            left * (1.0 - EARLY_SHARE) > max(0.0, to_line) / self.shape.speed + scale_of(self.shape).start_s + EARLY_S
        )
