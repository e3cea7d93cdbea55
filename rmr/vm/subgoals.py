"""What is done for which goal: sub-goals, and actions under way that serve goals.

A firing whose body reads open goals (``?p(...)``) serves these goals. The goals that it opens are sub-goals of them,
and its actions serve them. When a goal is achieved, withdrawn or ended, the sub-goals that serve no other open goal
end, and the actions under way that serve no other open goal are cancelled. A goal that was also opened by anything
else, the program or an operator for example, is no sub-goal and stays open. An action goes on if its declared effect
is the achieved goal and the robot senses it: the robot notices the effect before the action is complete.

Only goals and actions of the robot itself are known here. A cycle of sub-goals does not keep itself alive.
"""

from collections.abc import Iterable, Iterator, Sequence

from rmr.base.time import Instant
from rmr.base.values import Robot, Value
from rmr.bytecode.program import ANY, Constant, Kind, Program
from rmr.vm.evaluate import NoValue, evaluate
from rmr.vm.goals import Goals
from rmr.vm.machine_events import ActionCancelled, ActionDerived, GoalWithdrawn
from rmr.vm.ranks import GoalKey, goal_key
from rmr.vm.store import Args
from rmr.vm.underway import ACTIONS_MAX, UnderWay

Purpose = tuple[GoalKey, ...]
"""The goals that a firing serves."""


def purpose_of(places: Sequence[tuple[int, int]], facts: Sequence[Args]) -> Purpose:
    """Return the goals that a firing serves: the `facts` of its match at `places`, each with the goal's predicate."""
    return tuple([goal_key(base, tuple(map(Constant, facts[place]))) for place, base in places])


class Subgoals:
    """The sub-goals and serving actions of one robot. Bounded by the open goals and the actions under way."""

    __slots__ = ("_actions", "_goals", "_parents", "_program", "_robot", "_under_way")

    def __init__(self, program: Program, robot: Robot, goals: Goals, under_way: UnderWay) -> None:
        self._program = program
        self._robot = robot
        self._goals = goals
        self._under_way = under_way
        self._parents: dict[GoalKey, dict[GoalKey, None]] = {}
        """By open sub-goal, the goals that it serves, in the order in which it was opened for them."""
        self._actions: dict[int, dict[GoalKey, None]] = {}
        """By serial number of an action, the goals that it serves."""

    def still_open(self, purpose: Purpose) -> Purpose:
        """Return those goals of `purpose` that are open."""
        return tuple([key for key in purpose if key in self._goals.open.get(key[0], {})])

    def opened(self, key: GoalKey, purpose: Purpose, was_open: bool) -> None:
        """Note that a goal was opened, or opened again, for `purpose`; an empty one makes it a goal of its own."""
        served = [each for each in self.still_open(purpose) if each != key]
        if not served:
            self._parents.pop(key, None)
        elif not was_open:
            self._parents[key] = dict.fromkeys(served)
        elif key in self._parents:
            self._parents[key].update(dict.fromkeys(served))

    def derived(self, serial: int, purpose: Purpose) -> None:
        """Note that an action is derived for `purpose`."""
        served = self.still_open(purpose)
        if served:
            self._actions[serial] = dict.fromkeys(served)
        if len(self._actions) > ACTIONS_MAX:
            del self._actions[next(iter(self._actions))]  # it is no longer awaited either

    def over(self, serial: int) -> Purpose:
        """Forget an action that has ended; return the open goals that it served."""
        return self.still_open(tuple(self._actions.pop(serial, ())))

    def ended(
        self, now: Instant, predicate: int, gone: Iterable[tuple[object, ...]], *, achieved: bool
    ) -> Iterator[GoalWithdrawn | ActionCancelled]:
        """Close the sub-goals that served only the goals `gone` of a predicate, and cancel what served only these.

        The goals are given with their arguments: values, or ANY.
        """
        for values in gone:
            if ANY in values:
                continue  # no body reads it, so nothing serves it
            root = goal_key(predicate, tuple([Constant(value) for value in values]))  # type: ignore[arg-type]
            below = self._close(root)
            for key in below:
                args = self._goals.end(key)
                if args is not None:
                    yield GoalWithdrawn(key[0], args, now, (predicate, values))
            for serial in self._idle([root, *below]):
                action = self._under_way.awaited(serial)
                brings = achieved and action is not None and self._brings(now, action, predicate, values)
                if action is not None and not brings and self._under_way.cancel(serial):
                    yield ActionCancelled(serial, action.predicate, action.args, (predicate, values), now)

    def _close(self, key: GoalKey) -> list[GoalKey]:
        """Forget a goal that is no longer open, with all sub-goals that served it alone; return these."""
        self._parents.pop(key, None)
        below = [key, *below_of(key, self._parents)]
        # A sub-goal stays open if it serves an open goal outside of those below, or one below that stays open.
        left = dict.fromkeys(below)
        grown = True
        while grown:
            kept = [each for each in left if each != key and any(one not in left for one in self._parents[each])]
            for each in kept:
                del left[each]
            grown = bool(kept)
        ended = [each for each in self._parents if each in left]
        for each in ended:
            del self._parents[each]
        for parents in self._parents.values():
            _leave(parents, left)
        return ended

    def _idle(self, gone: Iterable[GoalKey]) -> Iterator[int]:
        """Yield the actions that served only goals of `gone`, in the order in which they were derived."""
        ended = dict.fromkeys(gone)
        for serial, served in list(self._actions.items()):
            _leave(served, ended)
            if not served:
                del self._actions[serial]
                yield serial

    def _brings(self, now: Instant, action: ActionDerived, predicate: int, values: tuple[object, ...]) -> bool:
        """Return whether a declared effect of an action is this fact, which the robot senses."""
        if self._program.predicates[predicate].kind is not Kind.SENSED:
            return False
        env: list[Value] = [self._robot, *action.args]
        for effect in self._program.predicates[action.predicate].effects:
            if effect.predicate != predicate or action.executor != self._robot:
                continue
            try:
                if tuple([evaluate(code, env, now) for code in effect.args]) == values:
                    return True
            except NoValue:
                continue  # the effect reports its failure when the action ends
        return False


def below_of(key: GoalKey, parents: dict[GoalKey, dict[GoalKey, None]]) -> Iterator[GoalKey]:
    """Yield all sub-goals of a goal, and theirs."""
    found = {key: None}
    rows = [key]
    while rows:
        one = rows.pop()
        for each, served in parents.items():
            if one in served and each not in found:
                found[each] = None
                rows.append(each)
                yield each


def _leave(served: dict[GoalKey, None], gone: dict[GoalKey, None]) -> None:
    for key in [each for each in served if each in gone]:
        del served[key]
