"""Nobody stands still for ever: when all faults are over, whoever has something to do gets on with it.

A robot gets on when it moves away by its own width (to and fro is no progress), when its machine has anything to
report but a missed deadline, while one of its actions sleeps for a second or longer, or when others use the event for
which it waits: by entering, or by getting on inside.
A robot that drives, or waits for its turn, and has not got on for `STILL` stands still; so do all robots together when
none of them has got on for so long, and none waits for a time to come. A lab without a finish fact has nothing to do.
"""

import math

from rmr.base.time import NEVER, NS_PER_S, Duration, Instant, in_seconds, seconds
from rmr.coord.events import Entered
from rmr.node.crossing.turn import Phase
from rmr.node.motion.obstruction import closest_solid, robots_named
from rmr.vm.events import FactSent, GoalAchieved, JobFinished, RuleFired
from rmr_sim.checkers.newest import Newest
from rmr_sim.checkers.scene import Scene

STILL: Duration = seconds(30)
"""Longer than a drive that finds no way takes to fail (20 s), and than a silent robot is taken for inside (10 s)."""
CLOSE_M = 0.05
"""Between two hulls: a robot stops so near to one that stands before it."""
TOUCHES_M = 0.005
"""Between a hull and an obstacle that it presses against."""
EVERY: Duration = NS_PER_S
"""How often robots are looked at; an action that sleeps for less may be one that polls, and counts as standing."""


class StandsStill:
    """Looks once a second who has got on."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._look_at: Instant = 0
        world = scene.simulation.world
        self._where = {robot: (pose.x, pose.y) for robot in scene.robots for pose in [world.pose(robot)]}
        self._got_on: dict[int, Instant] = dict.fromkeys(scene.robots, 0)
        self._used: Newest[bytes, Instant] = Newest()
        """When each event was entered last, or when the robot inside got on last."""
        for kind in (RuleFired, FactSent, GoalAchieved, JobFinished):
            scene.hear(kind, self._reported)
        scene.hear(Entered, self._entered)

    def _reported(self, robot: int, now: Instant, _event: object) -> None:
        self._got_on[robot] = now

    def _entered(self, robot: int, now: Instant, entered: Entered) -> None:
        self._got_on[robot] = self._used[entered.event] = now

    def __call__(self, now: Instant) -> None:
        """Look at all robots, once a second."""
        if now < self._look_at:
            return
        self._look_at = now + EVERY
        scene = self._scene
        busy = [robot for robot in scene.robots if scene.alive(robot) and not scene.finished(robot)]
        for robot in busy:
            self._look(robot, now)
            self._note_use(robot)
        if not busy or not scene.simulation.lab.finish or now < scene.healed_at + STILL:
            return
        long = [robot for robot in busy if now - self._got_on_at(robot) > STILL]
        still = [robot for robot in long if self._has_to(robot)]
        for robot in still:
            words = f"robot {robot} has stood still for {in_seconds(STILL):g} s"
            self._tell(now, (robot,), "; ".join([words, *self._reasons(robot)]))
        if not still and long == busy and not any(self._waits(robot) for robot in busy):
            words = f"no robot has got on for {in_seconds(STILL):g} s; not finished: {', '.join(map(str, busy))}"
            self._tell(now, tuple(busy), words)

    def _tell(self, now: Instant, robots: tuple[int, ...], words: str) -> None:
        """Complain, and again only when they have stood still for as long once more."""
        self._scene.violate(now, "stands still", robots, words)
        for robot in robots:
            self._got_on[robot] = now

    def _reasons(self, robot: int) -> list[str]:
        """Return what keeps the robot, as the world sees it: who has the turn, and what its hull stands close to."""
        scene, reasons = self._scene, []
        world, arena = scene.simulation.world, scene.simulation.lab.arena
        turn = scene.node(robot).turns.current
        if turn is not None and turn.waits:
            inside = [other for other in scene.robots if other != robot and self._inside(other, turn.event)]
            holders = f", held by robot {', '.join(map(str, inside))}" if inside else ""
            reasons.append(f"it waits for its turn of {turn.job.name}{holders}")
        x, y, _ = world.pose(robot)
        radius = arena.shape.radius
        others = {other: world.pose(other) for other in scene.robots if other != robot}
        near = [other for other, at in others.items() if math.hypot(x - at.x, y - at.y) < 2.0 * radius + CLOSE_M]
        if near:
            reasons.append(f"{robots_named(near)} in its way")
        if arena.clearance(x, y) < radius + TOUCHES_M:
            reasons.append(f"it touches {closest_solid(arena, x, y)}")
        return reasons

    def _inside(self, robot: int, event: bytes) -> bool:
        """Return whether `robot` has the turn of `event`."""
        turn = self._scene.node(robot).turns.current if self._scene.alive(robot) else None
        return turn is not None and turn.event == event and not turn.waits

    def _look(self, robot: int, now: Instant) -> None:
        x, y, _ = self._scene.simulation.world.pose(robot)
        was_x, was_y = self._where[robot]
        if math.hypot(x - was_x, y - was_y) > 2.0 * self._scene.simulation.lab.arena.shape.radius:
            self._where[robot] = (x, y)
            self._got_on[robot] = now

        if any(now + EVERY < running.pause.until < NEVER for running in self._scene.node(robot).actions.running):
            self._got_on[robot] = now

    def _note_use(self, robot: int) -> None:
        """Count the progress of a robot inside its event as use of the event, for those that wait for their turn."""
        turn = self._scene.node(robot).turns.current
        if turn is not None and turn.phase is Phase.INSIDE:
            self._used[turn.event] = max(self._used.get(turn.event, 0), self._got_on[robot])

    def _got_on_at(self, robot: int) -> Instant:
        """Return when the robot got on last, by itself or by others' use of the event for which it waits."""
        turn = self._scene.node(robot).turns.current
        return max(self._got_on[robot], 0 if turn is None else self._used.get(turn.event, 0))

    def _has_to(self, robot: int) -> bool:
        """Return whether the robot drives, or waits for a turn."""
        node = self._scene.node(robot)
        return node.turns.current is not None or node.actions.driving is not None

    def _waits(self, robot: int) -> bool:
        """Return whether an action lets time pass: it ends by itself."""
        return any(not running.handler.wheels for running in self._scene.node(robot).actions.running)
