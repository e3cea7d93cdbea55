"""The bodies of a world's robots, wherever they are: those of the physics, and those that a bridge brings from outside.

Bodies from outside are carried through the physics, so that simulated robots see and touch them, and all are seen by
the bridge's robots. The bridge may have a view, by which those outside see the simulated ones.
"""

from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Any

from rmr.base.geometry import Twist
from rmr.base.time import Instant
from rmr.base.values import Value
from rmr.node.ports import Sensed
from rmr_world.physics import World

if TYPE_CHECKING:
    from rmr_ros.ros_bridge import RosBridge


class AllBodies:
    """Commands in, samples out."""

    def __init__(self, physics: World, bridge: "RosBridge | None") -> None:
        self._physics = physics
        self._bridge = bridge
        self._elsewhere = frozenset(() if bridge is None else bridge.robots)

    def act(self, robot: int, twist: Twist, stamp: Instant, now: Instant) -> None:
        """Command the wheels of `robot` to `twist`, which its mind decided at `stamp`."""
        host = self._bridge if self._bridge is not None and robot in self._elsewhere else self._physics
        host.act(robot, twist, stamp, now)

    def perform(self, asked: tuple[int, int, int], name: str | None, args: tuple[Value, ...]) -> None:
        """Begin an action that the world carries out for a robot: id, session and number; None: break it off."""
        if self._bridge is not None:
            self._bridge.perform(asked, name, args)

    def performed(self) -> Iterator[tuple[tuple[int, int, int], str]]:
        """Yield the actions that have ended since, each with why it failed or an empty text."""
        return iter(()) if self._bridge is None else self._bridge.performed()

    def carry(self, now: Instant) -> None:
        """Bring the bodies from outside to where they are at `now`."""
        if self._bridge is None:
            return
        self._bridge.step(now)
        for robot in self._bridge.robots:
            body = self._bridge.body(robot)
            self._physics.carry(robot, body.pose, body.twist, body.travelled_m)

    def sense(self, robot: int, now: Instant) -> Sensed | None:
        """Return a sample of `robot`; None if nothing comes from it."""
        if self._bridge is None:
            return self._physics.sense(robot, now)
        if robot in self._elsewhere:
            sample = self._bridge.sense(robot, now, self._physics.in_view(robot))
        else:
            sample = self._physics.sense(robot, now)
        told = None if sample is None else self._bridge.told(robot)
        return sample if sample is None or told is None else sample.telling(told)

    def show(self, now: Instant, minds: Collection[int]) -> None:
        """Let the view show all bodies as they are at `now`, and drive those that have no mind in `minds`.

        At 0 lab time does not run yet, and nothing drives.
        """
        view = None if self._bridge is None else self._bridge.view
        if view is None:
            return
        for robot, twist in view.commanded(minds) if now else ():
            self._physics.act(robot, twist, now, now)
        view.show(now, {body.id: body.motion for body in self._physics.bodies})

    def report(self) -> dict[str, Any]:
        """Return what has come of the topics of robots from outside, for the world's report."""
        return {} if self._bridge is None else self._bridge.report()
