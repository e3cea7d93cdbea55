"""Where a robot is going while its rank, or what others claim, changes.

Another place behind the entrance is taken, and announced to the others, at once. Before the entrance the route there is
planned when the slot nears, once a second at most: in a crowd one robot that is late changes the ranks of all behind
it, and a plan costs milliseconds. A route that leads to no entrance is not kept: on it the robot would get no nearer to
its slot, which would be put off for ever. Nor is one kept where the new place lies behind no entrance: the robot gives
its turn back. Else it would line up for nothing, and nobody would enter until the first of the line had found that out.
"""

from typing import Final

from rmr.base.geometry import Point
from rmr.base.time import Duration, Instant, seconds
from rmr.base.values import Symbol
from rmr.node.crossing.crossing import Crossing
from rmr.node.crossing.phases import Inside
from rmr.node.parts import CrossingHost

REPLAN_EVERY: Final[Duration] = seconds(1)
"""A route that leads to another place costs nothing for so long: a slot stands for longer before it begins, and with
it the rank."""


class Destinations:
    """Where one robot is going by its crossings."""

    def __init__(self, robot: CrossingHost) -> None:
        self._robot = robot

    def current(self) -> Point | None:
        """Return where the robot is going, or the slot on which it stands."""
        driver = self._robot.driver
        running = self._robot.driving
        if driver is None:
            return None
        if running is None:
            return driver.place
        crossing = running.permit
        if isinstance(crossing, Crossing) and crossing.course.destination is not None:
            return crossing.course.destination
        return driver.navigator.goal or driver.place  # an action that has the wheels may stand or turn there

    def rank_changed(self, now: Instant, crossing: Crossing) -> None:
        """Handle a new place in the schedule: tell the program, and take another slot while still outside."""
        robot = self._robot
        name = Symbol(crossing.name)
        goal = crossing.goal
        running = crossing.action
        others = [args for args in robot.senses.of("turn") if args[0] != name]
        robot.senses.replace(now, "turn", [*others, (name, crossing.rank)])
        if goal is None or running is None or running.started is None or isinstance(crossing.phase, Inside):
            return
        if robot.driver is None or robot.driver.place is None:
            return  # the action has not taken a place yet
        if goal.slotted and running.handler.to_area:
            self.redirect(now, robot.take_place(goal, crossing), crossing)

    def change_place(self, now: Instant, place: Point) -> None:
        """Have the driving action go to another place: by a crossing the route is planned in time, else at once."""
        robot = self._robot
        crossing = None if robot.driving is None else robot.driving.permit
        if isinstance(crossing, Crossing):
            self.redirect(now, place, crossing)
        else:
            robot.depart(place, final_heading=None, permit=None)

    def redirect(self, now: Instant, goal: Point, crossing: Crossing) -> None:
        """Go to `goal` instead of the place for which the robot is under way by `crossing`."""
        driver = self._robot.driver
        robot = self._robot
        assert driver is not None
        if goal == self.current() and driver.navigator.status == "moving":
            return
        crossing.course.send(goal)
        robot.announce(now)
        self.follow(now, crossing)

    def follow(self, now: Instant, crossing: Crossing) -> None:
        """Plan the route to the place that the robot was sent to, once it has entered or may plan again."""
        running = self._robot.driving
        course = crossing.course
        if course.destination is None or running is None or running.permit is not crossing:
            course.send(None)
        elif not crossing.waits or now >= max(course.planned_at + REPLAN_EVERY, self._replans_from(crossing)):
            self._robot.depart(course.destination, final_heading=None, permit=crossing)

    def goes_on(self) -> bool:
        """Set out from a place that was given up on the way there, for the one taken instead; False: it was not."""
        crossing = None if self._robot.driving is None else self._robot.driving.permit
        if not isinstance(crossing, Crossing) or crossing.course.destination is None:
            return False
        self._robot.depart(crossing.course.destination, final_heading=None, permit=crossing)
        return True

    def _replans_from(self, crossing: Crossing) -> Instant:
        """Return when the robot may plan: at any time where the route it has, or is to have, leads to no entrance."""
        driver = self._robot.driver
        route = None if driver is None else driver.navigator.route
        if driver is None or route is None or route.gate_m is None:
            return 0
        is_near = crossing.goal is not None and crossing.course.destination in driver.near_side(crossing.goal)
        return 0 if is_near else crossing.course.replan_from
