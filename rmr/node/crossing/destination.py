"""Where a robot is bound that is under way while its rank, or what others claim, changes.

Another place behind the bottleneck's gate is taken, and told to the others, at once. Before the gate the way there is
planned when the slot nears, once a second at most: in a crowd one robot that is late changes the ranks of all behind
it, and a plan costs milliseconds.
"""

from typing import Final

from rmr.base.geometry import Point
from rmr.base.time import Duration, Instant, seconds
from rmr.base.values import Symbol
from rmr.node.crossing.turn import Phase, Turn
from rmr.node.parts import CrossingHost

REPLAN_EVERY: Final[Duration] = seconds(1)
"""Nothing is lost by a way that leads to another place for so long: a slot stands for longer before it begins, and with
it the rank."""
NEARS: Final[Duration] = seconds(3)
"""Earlier before its slot the robot keeps the way that it has: to the gate it is the same, and ranks change still."""


def bound_for(node: CrossingHost) -> Point | None:
    """Return where the robot is going, or the slot on which it stands."""
    if node.driver is None:
        return None
    running = node.driving
    if running is None:
        return node.driver.place
    turn = running.permit
    if isinstance(turn, Turn) and turn.bound is not None:
        return turn.bound
    return node.driver.navigator.goal or node.driver.place  # an action that has the wheels may stand or turn there


def rank_changed(node: CrossingHost, now: Instant, turn: Turn) -> None:
    """Handle a new place in the schedule: tell the program, and take another slot while still outside."""
    name = Symbol(turn.job.name)
    others = [args for args in node.senses.of("turn") if args[0] != name]
    node.senses.replace(now, "turn", [*others, (name, turn.rank)])
    running = turn.action
    if turn.goal is None or running is None or running.started is None or turn.phase is Phase.INSIDE:
        return
    if node.driver is None or node.driver.place is None:
        return  # the action has not taken a place yet
    if turn.goal.slotted and running.handler.to_area:
        redirect(node, now, node.take_place(turn.goal, turn), turn)


def redirect(node: CrossingHost, now: Instant, goal: Point, turn: Turn) -> None:
    """Go to `goal` instead of the place for which the robot is under way by `turn`."""
    assert node.driver is not None
    if goal == bound_for(node) and node.driver.navigator.status == "moving":
        return
    turn.bound = goal
    node.announce(now)
    keep_course(node, now, turn)


def keep_course(node: CrossingHost, now: Instant, turn: Turn) -> None:
    """Plan the way to the place that the robot has taken while under way, once it passes the gate or may plan again."""
    running = node.driving
    if turn.bound is None or running is None or running.permit is not turn:
        turn.bound = None
    elif turn.phase in (Phase.INSIDE, Phase.LEFT) or now >= max(turn.planned_at + REPLAN_EVERY, turn.start - NEARS):
        node.depart(turn.bound, final_heading=None, permit=turn)
