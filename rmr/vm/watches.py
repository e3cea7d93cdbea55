"""Watches: subscriptions of other robots' jobs to finish facts of this robot (`assert` across robots, paper III.E).

A job is kept by the robot of its start fact. If the finish fact belongs to another robot, that robot is asked to report
it; this module is the side that reports. A watch lasts until the first matching insertion, which is reported with its
time.

A request takes time to arrive, so insertions since the job's start count too. A persistent or sensed fact that holds
counts at once, as of the later of the start and its insertion. Of temporary facts and of sensed facts that no longer
hold, the newest are remembered. A job that restarts asks again, which replaces its watch.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from rmr.base.time import Instant
from rmr.base.values import Robot
from rmr.bytecode.program import Assertion, Kind, Pattern, Program
from rmr.vm.assertions import bind, instantiate, key_of, robot_of
from rmr.vm.bounds import Dropped, remember
from rmr.vm.machine_events import FinishSeen
from rmr.vm.match import pattern_agrees
from rmr.vm.shared import Shared
from rmr.vm.store import Args, Holdings

WATCHES_MAX = 256
"""Jobs of other robots for which a fact is watched; beyond that the oldest watch is dropped."""

RECENT_MAX = 256
"""Past facts remembered for each watched predicate; a request that arrives after more than these misses the oldest."""


class Watch(NamedTuple):
    """The finish fact that one job waits for."""

    watcher: Robot
    assertion: int
    patterns: tuple[Pattern, ...]
    since: Instant
    """When the job started."""


class HeldInterval(NamedTuple):
    """A fact and the interval in which it held; of a temporary fact only the instant of its insertion counts."""

    args: Args
    since: Instant
    until: Instant


class Watches:
    """The watches of one robot on behalf of others."""

    __slots__ = ("_dropped", "_holdings", "_program", "_recent", "_robot", "_shared", "_watches")

    def __init__(self, program: Program, robot: Robot, holdings: Holdings, shared: Shared, dropped: Dropped) -> None:
        self._program = program
        self._robot = robot
        self._holdings = holdings
        self._shared = shared
        self._dropped = dropped
        self._watches: dict[object, Watch] = {}
        self._recent: dict[int, list[HeldInterval]] = {}

    def take_over(self, old: "Watches", assertions: Sequence[int | None], predicates: Sequence[int | None]) -> None:
        """Take over the watches of another program, whose assertions and predicates have these new numbers."""
        for watch in old._watches.values():
            target = assertions[watch.assertion]
            if target is not None:
                key = (watch.watcher, target, key_of(watch.patterns))
                self._watches[key] = watch._replace(assertion=target)
        for predicate, recent in old._recent.items():
            new = predicates[predicate]
            if new is not None:
                self._recent[new] = recent

    def inserted(self, now: Instant, predicate: int, args: Args) -> Iterator[FinishSeen]:
        """Yield the reports of an inserted fact and end the watches that it matches."""
        if self._program.predicates[predicate].kind is Kind.TEMPORARY:
            self._remember(predicate, HeldInterval(args, now, now))
        for key, watch in list(self._watches.items()):
            finish = self._program.assertions[watch.assertion].finish
            if finish.predicate == predicate and pattern_agrees(watch.patterns, args):
                del self._watches[key]
                yield FinishSeen(watch.watcher, watch.assertion, args, now)

    def removed(self, now: Instant, predicate: int, args: Args, since: Instant) -> None:
        """Remember a sensed fact that no longer holds: a request that covers its interval may still arrive."""
        if self._program.predicates[predicate].kind is Kind.SENSED:
            self._remember(predicate, HeldInterval(args, since, now))

    def ask(self, now: Instant, watcher: int, index: int, args: Args, since: Instant) -> FinishSeen | None:
        """Watch for the finish fact of a job that a fact with `args` started at `since`, or return its report at once.

        Raises:
            ValueError: no such job waits for a fact of this robot.
        """
        assertion = self._assertion(index, watcher)
        start = self._shared.gate.fact(assertion.start.predicate, args)
        bindings = bind(assertion.slots, assertion.start.args, start, Robot(watcher))
        if bindings is None or robot_of(assertion.finisher, bindings) != self._robot:
            raise ValueError(f"no job of assertion {assertion.name} waits for a fact of this robot")
        patterns = tuple([instantiate(pattern, bindings) for pattern in assertion.finish.args])
        key = (watcher, index, key_of(patterns))
        known = self._watches.get(key)
        if known is not None and known.since > since:
            return None  # requests may overtake each other: the job has restarted since
        self._watches.pop(key, None)  # the watch of an earlier start of the same job
        seen = self._first(assertion.finish.predicate, patterns, since)
        if seen is not None:
            return FinishSeen(watcher, index, seen.args, max(since, seen.since))
        if len(self._watches) >= WATCHES_MAX:
            del self._watches[next(iter(self._watches))]
            self._dropped.add("watches", WATCHES_MAX, now)
        self._watches[key] = Watch(Robot(watcher), index, patterns, since)
        return None

    def _remember(self, predicate: int, fact: HeldInterval) -> None:
        remember(self._recent.setdefault(predicate, []), fact, RECENT_MAX)

    def _assertion(self, index: int, watcher: int) -> Assertion:
        """Return an assertion of which `watcher` may have a job. Raises ValueError."""
        if not 0 <= index < len(self._program.assertions):
            raise ValueError(f"there is no assertion {index}")
        assertion = self._program.assertions[index]
        if watcher == self._robot or assertion.robot not in (None, watcher):
            raise ValueError(f"robot {watcher} asks this one for no finish of assertion {assertion.name}")
        if assertion.finish.predicate not in self._shared.affairs(self._robot).asked:
            raise ValueError(f"the finish fact of assertion {assertion.name} is no other robot's affair")
        return assertion

    def _first(self, predicate: int, patterns: tuple[Pattern, ...], since: Instant) -> HeldInterval | None:
        """Return the earliest matching fact since `since`, among those that hold and those remembered."""
        linear = self._program.predicates[predicate].kind is Kind.TEMPORARY
        # A fact that holds has no end: `since` serves as one, for it is enough to pass the test below.
        held = [] if linear else [HeldInterval(args, at, since) for args, at in self._holdings.dated(predicate)]
        fits = [
            each
            for each in (*self._recent.get(predicate, ()), *held)
            if each.until >= since and pattern_agrees(patterns, each.args)
        ]
        return min(fits, key=lambda each: max(since, each.since), default=None)
