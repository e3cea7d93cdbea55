"""Explained delay: the time of one job, divided among what it waited for (temporal provenance: Zeno, NSDI 2019).

The critical path is followed backwards from the end of the job: from the finish fact to what inserted it, from an
action's end over its run and its wait for a turn to the firing that derived it, from a firing to the newest fact that
its rule needed, from a delivery over the radio to the firing of its sender. A cursor goes from the end to the start;
each step gives the time that it passes over to one owner. So the intervals have neither gap nor overlap, and their sum
is the job's time, to the nanosecond. What no step accounts for would be left to `TimeOwner.UNKNOWN`.

A job that never finished is followed from its deadline on: from the action under way for it then, else from what was
on its way to the robot, else from what happened to it last.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from rmr.base.time import Instant, milliseconds
from rmr.bytecode.heads import inner
from rmr.bytecode.program import Atom, Mode, Program
from rmr.node.standstill import Motion, MotionState
from rmr.vm.job import TimedJob
from rmr.vm.match import pattern_agrees
from rmr.why.delay_owner import OWNER_OF, Interval, TimeOwner
from rmr.why.interval_parts import absences, cut_at, merged, without
from rmr.why.pending import failure_broadcast, newest_arrival, next_supplier, on_their_way
from rmr.why.radio_time import Attempts, radio_time
from rmr.why.robot_history import (
    ActionSpan,
    CauseKind,
    Change,
    DeliveryKey,
    EventCause,
    RobotHistory,
    TimedFiring,
    TurnGate,
)
from rmr.why.turn_order import waits_behind

STEPS_MAX = 100_000
"""Steps of one critical path; each goes back in time, or in the order of what happened at one instant."""
WHEELS_GO_ON = milliseconds(100)
"""A robot that drives loses nothing by a call that comes later by no more: its wheels turn on for so long."""
CALLED_LATE = "its host called it late"
OLD_SAMPLE = "its newest sample was old"
DIED = "its process had ended"
STOPPED = "it was stopped as somebody asked for"
LINE_UP = "lineup"
"""The action that drives to a place in a queue."""

Step = Callable[[], "Step | None"]
"""One step back; returns the next one, or None where the path has no more."""


class PathAction(NamedTuple):
    """An action on the path."""

    end: Instant
    """When the path has left it: its end, or the end of the job's time."""
    robot: int
    text: str


class Delay(NamedTuple):
    """The explained time of one job."""

    robot: int
    job: TimedJob
    end: Instant
    """When the path begins: the finish, else the deadline, or the end of the run if that came first."""
    learned: Instant | None
    """When the robot knew of the finish; None: never."""
    intervals: tuple[Interval, ...]
    """From the start to `end`, in the order of time; none reaches across the deadline."""
    actions: tuple[PathAction, ...] = ()
    """The actions on the path, in the order of their ends."""

    @property
    def lateness(self) -> int | None:
        """Nanoseconds from the deadline to the finish, negative if it was early; None: it never finished."""
        return None if self.learned is None else self.end - self.job.deadline


def explained(
    histories: Mapping[int, RobotHistory], program: Program, attempts: Attempts, robot: int, job: TimedJob
) -> Delay:
    """Return where the time of `job`, one of `robot`, has gone; `attempts` are the frames on the air, if known."""
    learned = next((learned for one, learned in histories[robot].jobs if one is job), None)
    end = job.deadline if job.finish is None else job.finish
    if learned is not None and job.remote and job.missed:
        end = learned  # the news was late, not the fact
    if job.finish is None:
        end = min(end, max(history.ends for history in histories.values()))
    path = CriticalPath(histories, program, attempts, job.start, max(end, job.start))
    path.follow(path.of_job(robot, job, learned))
    intervals = cut_at(path.intervals(), job.deadline)
    return Delay(robot, job, max(end, job.start), learned, intervals, path.actions())


class CriticalPath:
    """One walk back in time."""

    def __init__(
        self,
        histories: Mapping[int, RobotHistory],
        program: Program,
        attempts: Attempts,
        begin: Instant,
        end: Instant,
    ) -> None:
        self._histories = histories
        self._program = program
        self._attempts = attempts
        self._begin = begin
        self._cursor = end
        self._found: list[Interval] = []
        self._actions: list[PathAction] = []
        self._asked: set[int] = set()
        """Robots that were found without anything under way; asked again they would lead in a circle."""

    def intervals(self) -> tuple[Interval, ...]:
        """Return what has been found, in the order of time; neighbours with the same owner are one."""
        return merged(reversed(self._found))

    def actions(self) -> tuple[PathAction, ...]:
        """Return the actions that the path has gone through, in the order of their ends."""
        return tuple(reversed(self._actions))

    def follow(self, step: Step | None) -> None:
        """Go back step by step until the start is reached."""
        for _ in range(STEPS_MAX):
            if step is None or self._cursor <= self._begin:
                break
            step = step()
        self._cover(self._begin, TimeOwner.UNKNOWN, 0)

    # -- giving time to owners ------------------------------------------------------------------------------

    def _cover(
        self, since: Instant, owner: TimeOwner, robot: int, whom: tuple[int, ...] = (), detail: str = ""
    ) -> None:
        """Give the time from `since` to the cursor to `owner`, but that in which the robot was dead or called late."""
        since = max(since, self._begin)
        if since >= self._cursor:
            return
        parts = [Interval(since, self._cursor, owner, robot, whom, detail)]
        history = self._histories.get(robot)
        if history is not None and owner is not TimeOwner.UNKNOWN:
            coasts = WHEELS_GO_ON if owner in (TimeOwner.DRIVE, TimeOwner.QUEUE) else 0
            late = [(due, called) for due, called in history.late if called - due > coasts]
            parts = without(parts, late, TimeOwner.LATE_TICK, robot, CALLED_LATE)
            parts = without(parts, absences(history, stopped=False), TimeOwner.DEAD, robot, DIED)
            parts = without(parts, absences(history, stopped=True), TimeOwner.STOPPED, robot, STOPPED)
        self._found.extend(reversed(parts))
        self._cursor = since

    def _cover_turn(self, since: Instant, robot: int, gates: Sequence[TurnGate]) -> None:
        """Give the time to those who are ahead of the robot, one after the other."""
        since = max(since, self._begin)
        if since >= self._cursor:
            return
        for wait in reversed(waits_behind(self._histories, robot, gates, since, self._cursor)):
            self._cover(wait.begin, TimeOwner.TURN, robot, wait.whom, wait.detail)

    def _cover_drive(self, since: Instant, robot: int, span: ActionSpan) -> None:
        """Give the time of a drive to what the wheels did."""
        history = self._histories[robot]
        for begin, _, state in reversed(history.motion_between(max(since, self._begin), self._cursor)):
            self._cover_motion(begin, robot, span, state)

    def _cover_motion(self, begin: Instant, robot: int, span: ActionSpan, state: MotionState) -> None:
        why = state.why
        if state.motion is Motion.GATED:
            self._cover_turn(begin, robot, span.gates)
        elif state.motion is Motion.STANDS and why.rule == "queue":
            self._cover(begin, TimeOwner.QUEUE, robot, why.robots, f"{why.rule}: {span.text}")
        elif state.motion is Motion.STANDS:
            detail = f"{why.rule}: {why.place}" if why.place else why.rule
            self._cover(begin, TimeOwner.STANDING, robot, why.robots, detail)
        else:
            owner = (
                TimeOwner.QUEUE if span.name == LINE_UP and state.motion is Motion.DRIVES else OWNER_OF[state.motion]
            )
            detail = OLD_SAMPLE if state.motion is Motion.UNWATCHED else span.text
            if state.motion is Motion.LOCATES and why.place:
                detail = f"{span.text}: {why.place}"
            self._cover(begin, owner, robot, (), detail)

    # -- the steps --------------------------------------------------------------------------------------------

    def of_job(self, robot: int, job: TimedJob, learned: Instant | None) -> Step | None:
        """Return the first step back from the end of a job."""
        history = self._histories[robot]
        if learned is None or job.finish is None:
            return self._stuck(robot)
        if not job.remote:
            return self._finish_fact(history, job, job.finish)
        source = int(job.finisher)
        key = newest_arrival(history, source, learned)
        if key is None:
            return lambda: self._outside(robot, f"{job.text} of robot {source}", (source,))
        return lambda: self._delivery(robot, key)

    def _finish_fact(self, history: RobotHistory, job: TimedJob, finish: Instant) -> Step:
        robot = history.robot
        finishing = [c for c in history.changes if c.came and c.at == finish and self._ends(job, c)]
        if finishing:
            return lambda: self._change(robot, finishing[0])
        return lambda: self._outside(robot, job.text)

    def _ends(self, job: TimedJob, change: Change) -> bool:
        """Return whether a fact is the finish fact of a job, in which `_` may stand."""
        if job.assertion < 0:
            return change.text.lstrip("!") == job.text
        pattern = self._program.assertions[job.assertion].finish
        return change.predicate == pattern.predicate and pattern_agrees(pattern.args, change.args, job.bindings)

    def _change(self, robot: int, change: Change) -> Step | None:
        """From a fact to what inserted it."""
        self._cover(change.at, TimeOwner.RULE, robot, (), f"after {change.text}")
        cause = change.cause
        if cause.kind == CauseKind.SENSED:
            return self._sensed(robot, change)
        return self._because(robot, cause, change.text)

    def _because(self, robot: int, cause: EventCause, what: str) -> Step | None:
        history = self._histories[robot]
        if cause.kind == CauseKind.FIRING:
            return lambda: self._firing(robot, history.firings[cause.number])
        if cause.kind == CauseKind.ACTION:
            return lambda: self._action(robot, history.actions[cause.number])
        if cause.kind == CauseKind.DELIVERY and cause.key is not None:
            key = cause.key
            return lambda: self._delivery(robot, key)
        if cause.kind == CauseKind.SENT and cause.key is not None:
            key = cause.key
            return lambda: self._settled(robot, key)
        if cause.kind == CauseKind.MISSED:
            start = history.changes[cause.number].at if cause.number >= 0 else self._begin
            self._cover(start, TimeOwner.RULE, robot, (), f"until a deadline had passed, for {what}")
        if cause.number >= 0:
            return lambda: self._change(robot, history.changes[cause.number])
        return self._outside(robot, what)

    def _outside(self, robot: int, what: str, whom: tuple[int, ...] = ()) -> Step | None:
        """Nobody has derived it: from the beginning of the process's life on; before that, what its last life did."""
        history = self._histories[robot]
        lives = [number for number, (begin, _) in enumerate(history.lives) if number and begin <= self._cursor]
        if lives and history.lives[lives[-1]][0] > self._begin:
            born = history.lives[lives[-1]][0]
            died = history.lives[lives[-1] - 1][1]
            self._cover(born, TimeOwner.OUTSIDE, robot, whom, f"until {what} came")
            owner, detail = (TimeOwner.STOPPED, STOPPED) if died in history.stops else (TimeOwner.DEAD, DIED)
            self._cover(died, owner, robot, (), detail)
            return lambda: self._stuck(robot)
        self._cover(self._begin, TimeOwner.OUTSIDE, robot, whom, f"until {what} came")
        return None

    def _sensed(self, robot: int, change: Change) -> Step | None:
        """From a sensed fact to the drive that brought it about."""
        history = self._histories[robot]
        name = self._program.predicates[change.predicate].name
        if name == "turn":
            return self._turn(robot, change)
        if name == "failed" and (broadcast := failure_broadcast(self._histories, change)) is not None:
            return lambda: self._action(*broadcast)
        for span in reversed(history.actions):
            started = span.started
            if span.wheels and started is not None and span.order < change.order and started <= change.at <= span.ended:
                return lambda: self._action(robot, span)
        return self._outside(robot, change.text)

    def _turn(self, robot: int, change: Change) -> Step | None:
        """From a fact ``turn`` to what started the job that has asked for it."""
        changes = self._histories[robot].changes
        asked = [changes[start] for name, start in self._histories[robot].starts if name == change.args[0]]
        start = next((each for each in reversed(asked) if each.at <= change.at), None)
        self._cover_turn(self._begin if start is None else start.at, robot, ())
        return None if start is None else lambda: self._change(robot, start)

    def _firing(self, robot: int, firing: TimedFiring) -> Step | None:
        """From a firing to the newest fact that its rule needed."""
        self._cover(firing.at, TimeOwner.RULE, robot, (), f"after the rule at {firing.text}")
        premise = self._newest_premise(self._histories[robot], firing)
        if premise is None:
            self._cover(self._begin, TimeOwner.RULE, robot, (), f"until the rule at {firing.text} fired")
            return None
        self._cover(
            premise.at, TimeOwner.RULE, robot, (), f"until the rule at {firing.text} fired, after {premise.text}"
        )
        return lambda: self._change(robot, premise)

    def _newest_premise(self, history: RobotHistory, firing: TimedFiring) -> Change | None:
        """Return the newest fact that the rule has matched, or the newest removal of one that must not hold."""
        matched = [history.changes[index] for index in firing.premises]
        body = self._program.rules[firing.rule].body
        absent = frozenset(each.predicate for each in body if isinstance(each, Atom) and each.mode is Mode.ABSENT)
        gone = history.newest(firing.at, firing.order, lambda c: not c.came and c.predicate in absent)
        return max([*matched, *([] if gone is None else [gone])], key=lambda c: (c.at, c.order), default=None)

    def _action(self, robot: int, span: ActionSpan) -> Step | None:
        """From an action's end over its run and its waits to what derived it."""
        self._actions.append(PathAction(self._cursor, robot, span.text))
        if span.started is not None:
            if span.wheels:
                self._cover_drive(span.started, robot, span)
            self._cover(span.started, TimeOwner.ACTION, robot, (), span.text)
        for since, what in reversed(span.waits):
            if what == "held":
                self._cover_turn(since, robot, span.gates)
            else:
                self._wheels_taken(since, robot, span)
        self._cover(span.derived, TimeOwner.ACTION, robot, (), span.text)
        return self._because(robot, span.cause, span.text)

    def _wheels_taken(self, since: Instant, robot: int, span: ActionSpan) -> None:
        """Give the time in which an action waited for the wheels to those that had them."""
        for other in reversed(self._histories[robot].actions):
            started = other.started
            if other is not span and other.wheels and started is not None and started < self._cursor <= other.ended:
                self._cover_drive(max(since, started), robot, other)
        self._cover(since, TimeOwner.ACTION, robot, (), f"{span.text} waited for the wheels")

    def _delivery(self, robot: int, key: DeliveryKey) -> Step | None:
        """From the arrival of a delivery over the radio to what its sender did."""
        source = key[0]
        history = self._histories.get(source)
        span = None if history is None else history.sent.get(key)
        arrival = self._histories[robot].received.get(key)
        if arrival is not None:
            self._cover(arrival[0], TimeOwner.RULE, robot, (), "after a delivery")
        if span is None:
            return self._outside(robot, f"what robot {source} had sent", (source,))
        for part in reversed(radio_time(span, self._cursor, self._attempts)):
            who = robot if part.owner is TimeOwner.LATE_TICK else source
            self._cover(part.begin, part.owner, who, (robot + source - who,), span.text)
        return self._because(source, span.cause, span.text)

    def _settled(self, robot: int, key: DeliveryKey) -> Step | None:
        """From the news that a delivery of the robot's own was acknowledged or given up to what it was sent for."""
        span = self._histories[robot].sent[key]
        for part in reversed(radio_time(span, self._cursor, self._attempts)):
            # After its last frame the robot waited for the acknowledgement.
            owner = TimeOwner.REPEATS if part.owner is TimeOwner.LATE_TICK else part.owner
            self._cover(part.begin, owner, robot, (key[1],), span.text)
        return self._because(robot, span.cause, span.text)

    # -- jobs that have not finished ----------------------------------------------------------------------------

    def _stuck(self, robot: int) -> Step | None:
        """Return the step back from a robot that waits at the cursor: what is under way, or was last."""
        history = self._histories[robot]
        at = self._cursor
        # What a deadline that has just passed brought about is no reason for it.
        before = [span for span in history.actions if span.cause.kind != CauseKind.MISSED or span.derived < at]
        active = [span for span in before if span.derived <= at < span.ended]
        if active:
            drives = [span for span in active if span.wheels or span.gates]
            chosen = (drives or active)[-1]
            return lambda: self._action(robot, chosen)
        under_way = on_their_way(self._histories, robot, at)
        if under_way:
            return lambda: self._delivery(robot, under_way[0])
        supplier = next_supplier(self._histories, robot, at, self._asked)
        if supplier is not None:
            self._asked.add(robot)
            return self._stuck(supplier)
        return self._last(history)

    def _last(self, history: RobotHistory) -> Step | None:
        """Return the step back to what happened last at a robot that has nothing under way."""
        at = self._cursor
        robot = history.robot
        over = [span for span in history.actions if span.ended <= at and span.derived < at]
        newest = max(over, key=lambda span: (span.ended, span.order), default=None)
        fired = [firing for firing in history.firings if firing.at <= at]
        # Of one instant: a firing behind an action's end follows from it.
        if newest is not None and (not fired or (newest.ended, newest.order) > (fired[-1].at, fired[-1].order)):
            end = "had ended" if newest.failure is None else f"had failed: {newest.failure}"
            self._cover(newest.ended, TimeOwner.RULE, robot, (), f"no rule fired after {newest.text} {end}")
            return lambda: self._action(robot, newest)
        if fired:
            firing = fired[-1]
            nothing = ", which found nothing" if self._found_nothing(history, len(fired) - 1) else ""
            self._cover(firing.at, TimeOwner.RULE, robot, (), f"no rule fired after the one at {firing.text}{nothing}")
            return lambda: self._firing(robot, firing)
        self._cover(self._begin, TimeOwner.RULE, robot, (), "no rule fired")
        return None

    def _found_nothing(self, history: RobotHistory, number: int) -> bool:
        """Return whether a firing has derived nothing, by a rule whose head looks for facts."""
        if not any(inner(self._program.rules[history.firings[number].rule].head)):
            return False
        causes = [change.cause for change in history.changes if change.came]
        causes += [span.cause for span in history.actions] + [span.cause for span in history.sent.values()]
        return EventCause(CauseKind.FIRING, number) not in causes
