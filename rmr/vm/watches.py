"""Finish facts for which jobs of other robots wait (`assert` across robots, paper III.E).

A job lives with the robot of its start fact. If the finish fact belongs to another robot, that robot is asked for
it, and this is its side: a watch stands until the first matching insertion, which is reported with its time. The
request takes a while to arrive, so what was inserted since the job's start counts too: a persistent or sensed
fact that holds counts at once, as of the later of the start and its insertion, and of facts that come and go the
newest are remembered. A job that starts anew asks again, and its older watch goes.
"""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from rmr.base.time import Instant
from rmr.base.values import Robot
from rmr.bytecode.program import SELF_SLOT, Assertion, Constant, Kind, Pattern, Program, Slot
from rmr.vm.bounds import Dropped
from rmr.vm.events import FinishSeen
from rmr.vm.match import pattern_agrees
from rmr.vm.outside import Gate
from rmr.vm.patterns import bind, instantiate, key_of, robot_of
from rmr.vm.store import Args, Holdings

WATCHES_MAX = 256
"""Jobs of other robots for which a fact is watched; beyond that the oldest watch is dropped."""

RECENT_MAX = 256
"""Facts of each watched predicate that are remembered; a request that is so late that more came misses the oldest."""


class Watch(NamedTuple):
    """What one job waits for."""

    watcher: Robot
    assertion: int
    patterns: tuple[Pattern, ...]


class Held(NamedTuple):
    """A fact, and from when until when it held; a temporary one counts at its insertion alone."""

    args: Args
    since: Instant
    until: Instant


class Watches:
    """What one robot watches for others."""

    def __init__(self, program: Program, robot: Robot, holdings: Holdings, gate: Gate, dropped: Dropped) -> None:
        self._program = program
        self._robot = robot
        self._holdings = holdings
        self._gate = gate
        self._dropped = dropped
        self._watches: dict[object, Watch] = {}
        self._recent: dict[int, deque[Held]] = {
            assertion.finish.predicate: deque(maxlen=RECENT_MAX)
            for assertion in program.assertions
            if _may_be_asked(assertion, robot)
        }

    def concerns(self, predicate: int) -> bool:
        """Tell whether another robot's job may wait for a fact of `predicate`."""
        return predicate in self._recent

    def inserted(self, now: Instant, predicate: int, args: Args) -> Iterator[FinishSeen]:
        """Yield the news of a fact for those who wait for it; each watch is over with the first."""
        if self._program.predicates[predicate].kind is Kind.TEMPORARY:
            self._recent[predicate].append(Held(args, now, now))
        for key, watch in list(self._watches.items()):
            finish = self._program.assertions[watch.assertion].finish
            if finish.predicate == predicate and pattern_agrees(watch.patterns, args):
                del self._watches[key]
                yield FinishSeen(watch.watcher, watch.assertion, args, now)

    def removed(self, now: Instant, predicate: int, args: Args, since: Instant) -> None:
        """Remember a sensed fact that holds no longer: a request for the time when it did may be under way."""
        if self._program.predicates[predicate].kind is Kind.SENSED:
            self._recent[predicate].append(Held(args, since, now))

    def ask(self, now: Instant, watcher: int, index: int, args: Args, since: Instant) -> FinishSeen | None:
        """Watch for the finish fact of a job that a fact with `args` started at `since`, or return that it is there.

        Raises:
            ValueError: no such job waits for a fact of this robot.
        """
        assertion = self._assertion(index, watcher)
        start = assertion.start
        bindings = bind(assertion.slots, start.args, self._gate.fact(start.predicate, args), Robot(watcher))
        if bindings is None or robot_of(assertion.finisher, bindings) != self._robot:
            raise ValueError(f"no job of assertion {assertion.name} waits for a fact of this robot")
        patterns = tuple([instantiate(pattern, bindings) for pattern in assertion.finish.args])
        key = (watcher, index, key_of(patterns))
        self._watches.pop(key, None)
        seen = self._first(assertion.finish.predicate, patterns, since)
        if seen is not None:
            return FinishSeen(watcher, index, seen.args, max(since, seen.since))
        if len(self._watches) >= WATCHES_MAX:
            del self._watches[next(iter(self._watches))]
            self._dropped.add("watches", WATCHES_MAX, now)
        self._watches[key] = Watch(Robot(watcher), index, patterns)
        return None

    def _assertion(self, index: int, watcher: int) -> Assertion:
        """Return an assertion of which `watcher` may have a job. Raises ValueError."""
        if not 0 <= index < len(self._program.assertions):
            raise ValueError(f"there is no assertion {index}")
        assertion = self._program.assertions[index]
        if watcher == self._robot or assertion.robot not in (None, watcher):
            raise ValueError(f"robot {watcher} asks this one for no finish of assertion {assertion.name}")
        if not self.concerns(assertion.finish.predicate):
            raise ValueError(f"the finish fact of assertion {assertion.name} is no other robot's affair")
        return assertion

    def _first(self, predicate: int, patterns: tuple[Pattern, ...], since: Instant) -> Held | None:
        """Return the fact that counted first, of those that hold or are remembered and match."""
        linear = self._program.predicates[predicate].kind is Kind.TEMPORARY
        held = [] if linear else [Held(args, at, since) for args, at in self._holdings.dated(predicate)]
        fits = [
            each
            for each in (*self._recent[predicate], *held)
            if each.until >= since and pattern_agrees(patterns, each.args)
        ]
        return min(fits, key=lambda each: max(since, each.since), default=None)


def _may_be_asked(assertion: Assertion, robot: Robot) -> bool:
    """Tell whether the finish fact may be `robot`'s while the job is another's."""
    finisher = assertion.finisher
    if isinstance(finisher, Constant):
        return finisher.value == robot and assertion.robot != robot
    return isinstance(finisher, Slot) and finisher.index != SELF_SLOT
