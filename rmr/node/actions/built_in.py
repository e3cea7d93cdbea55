"""The actions that every robot provides.

A handler of a user is an `async def`. A provided action does the same, with its state in attributes (`ActionSteps`): so
a robot can be saved while it drives. Like `rmr.node.actions.handle` this module is never compiled.
"""

import math
from typing import Final, cast

from rmr.base.time import milliseconds
from rmr.base.values import Symbol
from rmr.bytecode.provided import ACTIONS
from rmr.node.actions.dispatcher import Handler
from rmr.node.actions.drives import GoTo, LineUp, MoveTo, Navigate, ReachDrive
from rmr.node.actions.handle import ActionFailed, Pause, RobotHandle, pause_of
from rmr.node.actions.node_handle import ActionSteps, LocatedSteps, NodeHandle

FAILURE_REPEATS: Final = 3
"""Copies of a failure broadcast, which is not acknowledged: at 20 % loss one of three arrives in 99 of 100 cases."""


class FaceSteps(LocatedSteps):
    """A turn on the spot."""

    __slots__ = ("_degrees",)

    def __init__(self, robot: NodeHandle, degrees: float) -> None:
        super().__init__(robot)
        self._degrees = degrees

    def prepare(self) -> bool:
        """Raise ActionFailed without a body."""
        return self._robot.node.motion is not None

    def begin(self) -> Pause | None:
        """Begin to turn."""
        self._robot.node.motion.face(math.radians(math.fmod(self._degrees, 360.0)))
        self._drives = True
        return Pause(condition=self._has_arrived)

    def _has_arrived(self) -> bool:
        return self._robot.node.motion.status == "arrived"

    def go_on(self) -> Pause | None:
        """Return None: the turn is over."""
        return None


def face(robot: NodeHandle, degrees: float) -> FaceSteps:
    """Turn to a heading, degrees counter-clockwise from the x axis."""
    return FaceSteps(robot, degrees)


def moveto(robot: NodeHandle, area_name: str) -> MoveTo:
    """Drive to an area: the robot's own place of a slotted one, a free spot of a box, the point otherwise."""
    return MoveTo(robot, area_name)


def navigate(robot: NodeHandle, area_name: str) -> Navigate:
    """Drive to an area as `moveto` does, by the driver of the body itself if it has one (Nav2)."""
    return Navigate(robot, area_name)


def lineup(robot: NodeHandle, area_name: str, place: int) -> LineUp:
    """Drive to the `place`-th place (from 1) of an area's queue and face the way it moves.

    A later `lineup` takes over from this one at once: the robot's turn has changed while it was on its way. It is over
    as soon as the robot has its turn, or has let one pass for it could not get there: then it no longer lines up.
    """
    return LineUp(robot, area_name, place)


def goto(robot: NodeHandle, x: float, y: float) -> GoTo:
    """Drive to a point of the floor, metres.

    The places of an area are assigned; a point is not, so another robot may stand there permanently. Then a robot that
    is near gives up.
    """
    return GoTo(robot, x, y)


def reach(robot: NodeHandle, x: float, y: float, begins_s: float, ends_s: float) -> ReachDrive:
    """Drive straight to a point of the floor, metres, leaving and arriving at instants of lab time, seconds.

    It turns before it leaves. Several robots that do so keep apart on certain conditions
    (`rmr.node.motion.straight_drive`).
    """
    return ReachDrive(robot, x, y, begins_s, ends_s)


async def stop(_robot: NodeHandle) -> None:
    """Stop the wheels; the dispatcher has done so already."""


class BroadcastSteps(ActionSteps):
    """Copies of a failure broadcast."""

    __slots__ = ("_left",)

    def __init__(self, robot: NodeHandle) -> None:
        super().__init__(robot)
        self._left = FAILURE_REPEATS

    def resume(self) -> Pause | None:
        """Send the next copy."""
        if self._left == 0:
            return None
        self._left -= 1
        node = self._robot.node
        node.broadcast_failure(self._robot.missed)
        return Pause(node.now + milliseconds(100))


def broadcast(robot: NodeHandle) -> BroadcastSteps:
    """Tell every robot in range that a deadline was missed (paper III.E)."""
    return BroadcastSteps(robot)


class WaitSteps(ActionSteps):
    """Time that passes."""

    __slots__ = ("_begun", "_duration_s")

    def __init__(self, robot: RobotHandle, duration_s: float) -> None:
        super().__init__(cast(NodeHandle, robot))
        self._duration_s = duration_s
        self._begun = False

    def resume(self) -> Pause | None:
        """Wait once. Raises ActionFailed for what is no duration."""
        if self._begun:
            return None
        self._begun = True
        try:
            return pause_of(self._robot._now(), self._duration_s)
        except ValueError as error:
            raise ActionFailed(str(error)) from None


def wait(robot: RobotHandle, duration_s: float) -> WaitSteps:
    """Let time pass, seconds. Raises ActionFailed below 0 and for what is not finite."""
    return WaitSteps(robot, duration_s)


async def say(robot: NodeHandle, text: str) -> None:
    """Write `text` into the trace."""
    robot.say(text)


async def light(robot: NodeHandle, colour: Symbol) -> None:
    """Show a colour."""
    robot.node.trace(robot.node.now, "light", colour=str(colour))


HANDLERS: Final[dict[str, Handler]] = {
    handler.run.__name__: handler
    for handler in (
        Handler("moveto", moveto, wheels=True, to_area=True),
        Handler("navigate", navigate, wheels=True, to_area=True),
        Handler("lineup", lineup, wheels=True, takes_over=True),
        Handler("goto", goto, wheels=True),
        Handler("reach", reach, wheels=True),
        Handler("face", face, wheels=True),
        Handler("stop", stop, at_once=True),
        Handler("wait", wait),
        Handler("broadcast", broadcast),
        Handler("say", say),
        Handler("light", light),
    )
}
"""By the names that the rows of `rmr.bytecode.provided.ACTIONS` give to handlers."""

PROVIDED: Final[dict[str, Handler]] = {name: HANDLERS[action.handler] for name, action in ACTIONS.items()}
"""By action."""
