"""When others keep a robot standing: the detector of deadlocks, with a patience and two counters.

A robot that wants to drive and may hardly do so for longer than its patience is in a deadlock. Robots differ in
patience, so that not all of them act at once. A deadlock that has lasted for `ENDURED` although escapes were tried, and
in which the robot has got nowhere, or only back, *endures*: nothing but the last resort is left. The times are
multiplied by the tempo of the robots, the lengths by their size.
"""

from collections.abc import Iterable, Sequence
from typing import Final

from rmr.base.arena import REFERENCE, RobotShape
from rmr.base.geometry import Point, Pose, Twist, distance, hypot
from rmr.base.motion_scale import scale_of
from rmr.base.time import Duration, Instant, seconds

DRIVES_MPS: Final = 0.02
"""A robot no faster than this does not drive."""
KEPT_SHARE: Final = 0.25
"""A robot that may drive at no more than this share of the speed it wants, or of that of the reference robot, is kept
standing."""
PATIENCE_S: Final = 0.7
"""A robot kept standing for longer than this is in a deadlock."""
PATIENCE_STEP_S: Final = 0.2
"""Patience differs by multiples of this, by the robot's id."""
EARLY_PATIENCE: Final[Duration] = seconds(3)
"""Additional patience before the robot's own slot: standing is in order then, but a robot that gets no nearer to the
gate never gets a slot in time."""
SETTLING: Final[Duration] = seconds(15)
"""Additional patience before a wall that nothing but the error of the estimate keeps the robot off: in 8 s of standing
it falls to half."""
AROUND_RADII: Final = 8.0
"""Bodies farther away than this have no part in a deadlock."""
BIAS_M: Final = 0.05
"""A detour takes each of the others to be this far to the left of where it is, too: both then pass on the right."""
GHOST_S: Final = 2.5
"""How long a detour keeps off the places where the others were."""
ENDURED: Final[Duration] = seconds(8)
"""A deadlock that lasts for so long endures, if the robot has got nowhere."""
ENDURED_M: Final = 0.1
"""A robot no farther than this from where the deadlock began has got nowhere; nor has one that is farther from its goal
than there, since it has backed up before another one that follows."""


class DeadlockDetector:
    """What one robot knows of the deadlock it is in."""

    __slots__ = (
        "_at", "_at_since", "_patience", "_scale", "_since", "early", "ghosts", "ghosts_until", "settling", "tries",
        "walks",
    )  # fmt: skip

    def __init__(self, robot: int, shape: RobotShape) -> None:
        self._scale: Final = scale_of(shape)
        self._patience = seconds((PATIENCE_S + PATIENCE_STEP_S * (robot % 4)) * self._scale.tempo)
        self.early: Final[Duration] = round(EARLY_PATIENCE * self._scale.tempo)
        """Additional patience before the robot's own slot."""
        self.settling: Final[Duration] = round(SETTLING * self._scale.tempo)
        """Additional patience before a wall that the error of the estimate alone keeps it off."""
        self._since: Instant | None = None
        """Since when the robot has been kept standing."""
        self._at: Point | None = None
        self._at_since: Instant = 0
        """Where the present deadlock began, and when."""
        self.ghosts: tuple[Point, ...] = ()
        """Obstacles of a detour: where the others were, and to the left of that."""
        self.ghosts_until: Instant = 0
        self.tries = 0
        """How often patience was over during this drive."""
        self.walks = 0
        """How often the deadlock has endured during this drive."""

    def reset(self) -> None:
        """Forget everything: a new drive begins."""
        self._since = None
        self._at = None
        self.ghosts = ()
        self.tries = 0
        self.walks = 0

    def blocked(self, now: Instant, wish: Twist, allowed: Twist, more: Duration = 0) -> bool:
        """Take in this tick; return whether the patience, and `more`, is over (once per patience)."""
        if wish.v <= DRIVES_MPS or allowed.v > KEPT_SHARE * min(wish.v, REFERENCE.speed):
            if allowed.v > DRIVES_MPS:
                self._since = None
            return False
        if self._since is None:
            self._since = now
        if now - self._since < self._patience + more:
            return False
        self._since = None  # turning to the way out does not count as being kept standing
        self.tries += 1
        return True

    def mark(self, now: Instant, pose: Pose, places: Sequence[Point], radius: float) -> None:
        """Remember `places` of others as obstacles of a detour, made wider on the left of the way to each."""
        ghosts = []
        for x, y in places:
            away = hypot(x - pose.x, y - pose.y)
            if away > AROUND_RADII * radius or away < 1e-6:
                continue
            # The direction to the other, rotated by 90 degrees to the left, is (-(y - pose.y), x - pose.x) / away.
            shift = BIAS_M * self._scale.size / away
            ghosts += [Point(x, y), Point(x - (y - pose.y) * shift, y + (x - pose.x) * shift)]
        self.ghosts = tuple(ghosts)
        self.ghosts_until = now + seconds(GHOST_S * self._scale.tempo)

    def around(self, now: Instant, standing: Iterable[Point]) -> Iterable[Point]:
        """Return what a new route leads around: the ghosts, later in the deadlock the others that are `standing`."""
        if now < self.ghosts_until:
            return self.ghosts
        return standing if self.tries else ()

    def endures(self, now: Instant, pose: Pose, goal: Point, *, walks: bool) -> bool:
        """Note where an escape is sought; return whether the deadlock endures.

        For a robot that `walks` away from one already, and gets stuck again elsewhere, it does at once.
        """
        at = self._at
        if at is None or (
            hypot(at.x - pose.x, at.y - pose.y) > ENDURED_M * self._scale.size
            and distance(*goal, pose.x, pose.y) < distance(*goal, *at)
        ):
            self._at = Point(pose.x, pose.y)
            self._at_since = now
        if now - self._at_since < round(ENDURED * self._scale.tempo) and not (walks and self.walks):
            return False
        self.walks += 1
        return True
