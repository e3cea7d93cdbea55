"""The escapes: one ordered table of the ways out of a situation in which a robot gets nowhere.

An escape `applies` to a situation or not, and to `act` is to return a manoeuvre for the navigator, or None where there
is no room for it; then the next escape of the table is tried (`policy`). docs/motion.md shows the table.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

from rmr.base.arena import Arena
from rmr.base.direction import ends_of
from rmr.base.geometry import Point
from rmr.base.motion_scale import scale_of
from rmr.base.streams import uniform
from rmr.base.time import Duration, Instant, seconds
from rmr.node.motion.gate import EntryGate
from rmr.node.motion.priority import Heard
from rmr.node.motion.route import Route
from rmr.node.motion.standoff.refuge import Side, clearing_route, paths_of, retreat_route, side_of

CLEAR_S: Final[Duration] = seconds(4)
"""How long clearing an entrance takes at most, the way there included."""
RETREAT_S: Final = 6.0
"""How long a retreat takes at least until the robot comes back, the way there included."""
RETREAT_SPREAD_S: Final = 6.0
"""How much longer a retreat takes at most, by chance."""
REVERSE_S: Final = 0.4
"""Length of the reverse manoeuvre that makes room for a detour; twice as long where there is no detour."""
GIVE_WAY_TRIES_MAX: Final = 5
"""Number of tries after which giving way in the bottleneck gets no longer."""


class DeadlockCause(Enum):
    """What has been noticed."""

    ENTRANCE = "stands in an entrance"
    """The robot stands without its turn where others come out, or before one that stands there."""
    DEADLOCK = "deadlock"
    """Others keep the robot standing, and its patience is over."""
    NO_WAY_BACK = "no way back"
    """After an excursion there is no route to the goal."""
    ON_A_GOAL = "stands on another one's goal"
    """The robot has no route, or waits for its turn, and stands where another one wants to go that gets nowhere."""


@dataclass(frozen=True, slots=True)
class Excursion:
    """A drive to another place than the goal."""

    route: Route
    until: Instant
    """When the robot comes back at the latest."""
    stays: bool
    """Whether it waits at the end of the route until then."""


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """What an escape has the navigator do."""

    excursion: Excursion | None = None
    reverse: Duration = 0
    """For so long the robot drives straight back."""


@dataclass(frozen=True, slots=True)
class Impasse:
    """The situation of a robot that gets nowhere. It is made only when there is a symptom."""

    symptom: DeadlockCause
    now: Instant
    robot: int
    arena: Arena
    at: Point
    goal: Point
    parked: tuple[Point, ...]
    others: Sequence[Point]
    """Where bodies are, seen or heard."""
    driving: Sequence[Heard]
    """What robots that drive have reported."""
    route: Route | None
    gate: EntryGate
    tries: int
    """The number of the present escape from a deadlock, from 1."""
    endured: int
    """How often deadlocks of this drive have endured; 0 if the present one does not."""
    replan: Callable[[], bool]
    """Plans a route to the goal around the others, follows it, and returns whether there is one."""


class Escape:
    """One way out."""

    def __init__(self, name: str, situation: str, way_out: str) -> None:
        """`situation` and `way_out` are the columns of docs/motion.md."""
        self.name: Final = name
        self.situation: Final = situation
        self.way_out: Final = way_out

    def applies(self, impasse: Impasse) -> bool:
        """Return whether the escape is meant for the situation."""
        raise NotImplementedError

    def act(self, impasse: Impasse) -> Manoeuvre | None:
        """Return the manoeuvre; None where there is no room for it."""
        raise NotImplementedError


class ClearEntrance(Escape):
    """Makes room for robots that come out of the bottleneck."""

    def applies(self, impasse: Impasse) -> bool:
        """Return whether the robot stands in an entrance."""
        return impasse.symptom is DeadlockCause.ENTRANCE

    def act(self, impasse: Impasse) -> Manoeuvre | None:
        """Return a drive to a spot before the entrance, outside the room that is left for others."""
        route = impasse.route
        assert route is not None, "an entrance is one of a route"
        room = impasse.gate.room(route)
        end = route.points[-1]
        out = clearing_route(impasse.arena, impasse.at, end, impasse.parked, impasse.others, route.mouth, room)
        if out is None:
            return None
        until = impasse.now + round(CLEAR_S * scale_of(impasse.arena.shape).tempo)
        return Manoeuvre(Excursion(out, until, stays=False))


class Retreat(Escape):
    """Leaves a jam for free floor, at random."""

    def applies(self, impasse: Impasse) -> bool:
        """Return whether the deadlock endures, or the robot stands on a goal, outside of the bottleneck."""
        if impasse.symptom is not DeadlockCause.ON_A_GOAL and not impasse.endured:
            return False
        return side_of(impasse.arena, impasse.at, impasse.goal) is not Side.WITHIN

    def act(self, impasse: Impasse) -> Manoeuvre | None:
        """Return a drive to free floor; the robot gives back its turn, if it has one and is not beyond."""
        arena = impasse.arena
        at = impasse.at
        goal = impasse.goal
        tries = max(1, impasse.endured)
        paths = paths_of(arena, at, impasse.driving, impasse.parked)
        obstacles = (*impasse.parked, *impasse.others)
        route = retreat_route(arena, at, goal, obstacles, impasse.robot, tries, paths)
        if route is None:
            return None
        # Before the bottleneck a robot counts as not having entered: others wait for a turn that is not used.
        if side_of(arena, at, goal) is not Side.BEYOND:
            impasse.gate.step_back()
        return Manoeuvre(Excursion(route, retreat_until(impasse.now, impasse.robot, tries), stays=True))


class Detour(Escape):
    """Drives around the others."""

    def applies(self, impasse: Impasse) -> bool:
        """Return whether there is a deadlock."""
        return impasse.symptom is DeadlockCause.DEADLOCK

    def act(self, impasse: Impasse) -> Manoeuvre | None:
        """Return a short reverse manoeuvre, which makes room to turn; the way around is planned again at its end."""
        if not impasse.replan():
            return None
        return Manoeuvre(reverse=_reverse(impasse.arena, 1.0 if impasse.tries % 3 else 2.0))


class GiveWay(Escape):
    """Drives back out of a bottleneck in which robots meet head-on.

    If both went back, both would come back. So all but those that entered by the first entrance give way, ever farther,
    until they are out; the others stay and follow up. Where corridors meet, those of a later entrance go back longer.
    """

    def applies(self, impasse: Impasse) -> bool:
        """Return whether the robot is in a bottleneck that is entered from several sides."""
        return impasse.symptom is DeadlockCause.DEADLOCK and impasse.gate.met_by(impasse.route) is not None

    def act(self, impasse: Impasse) -> Manoeuvre | None:
        """Return a reverse manoeuvre, none by the first entrance."""
        entrance, _ = ends_of(impasse.gate.met_by(impasse.route) or 0)
        return Manoeuvre(reverse=_reverse(impasse.arena, 2.0 * entrance * min(impasse.tries, GIVE_WAY_TRIES_MAX)))


class Reverse(Escape):
    """Drives back a little."""

    def applies(self, impasse: Impasse) -> bool:
        """Return whether there is a deadlock."""
        return impasse.symptom is DeadlockCause.DEADLOCK

    def act(self, impasse: Impasse) -> Manoeuvre | None:
        """Return a reverse manoeuvre, twice as long as that before a detour."""
        assert impasse.symptom is DeadlockCause.DEADLOCK
        return Manoeuvre(reverse=_reverse(impasse.arena, 2.0))


def retreat_until(now: Instant, robot: int, tries: int) -> Instant:
    """Return when a robot comes back from its `tries`-th retreat that begins `now`."""
    return now + seconds(RETREAT_S + RETREAT_SPREAD_S * uniform("stay", robot, tries))


def _reverse(arena: Arena, times: float) -> Duration:
    """Return how long a reverse manoeuvre takes: the larger the robots, the farther it leads."""
    return seconds(times * REVERSE_S * scale_of(arena.shape).size)


ESCAPES: Final[tuple[Escape, ...]] = (
    ClearEntrance(
        "clear_entrance",
        "a robot has waited for 2 s in an entrance by which others come out; or right before it (7 cm from hull to "
        "hull) is one that has come out and has no room to turn past it",
        "it drives out of the way, by 0.28 m to 0.84 m, for 4 s at most, and comes back",
    ),
    Retreat(
        "retreat",
        "a jam outside of the bottleneck: no escape has led 10 cm away and nearer to the goal for 8 s, or a robot "
        "that has made room finds no route back for so long. Or the robot has no route, since its goal is taken, or "
        "waits for its turn, and stands where another one wants to go that gets nowhere",
        "the robot drives to free floor, by 0.28 m at first and up to 0.84 m, in a direction drawn by its id and the "
        "number of tries; among free places to one that blocks fewest of the robots near it. It comes back after 6 to "
        "12 s, drawn too. It gives back a turn that it has",
    ),
    Detour(
        "detour",
        "deadlock, and there is another route",
        "the robot reverses for 0.4 s (0.8 s at every third try), then drives around the others, which are taken to be "
        "5 cm farther to the left, so that both pass on the right",
    ),
    GiveWay(
        "give_way",
        "deadlock, head-on in a bottleneck that is entered from several sides",
        "robots that entered by the second entrance reverse, for 0.8 s to 4 s, farther each time; by the third or "
        "fourth twice or three times as long; those of the first stay",
    ),
    Reverse(
        "reverse",
        "deadlock, and there is no other route",
        "the robot reverses for 0.8 s, then tries again",
    ),
)
"""All escapes, in the order in which they are tried."""
