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
from functools import partial
from typing import assert_never

from rmr.base.time import Instant, milliseconds
from rmr.base.values import Robot
from rmr.bytecode.program import Program
from rmr.node.standstill import Motion, MotionState
from rmr.node.trace import fact_text, rule_text
from rmr.vm.job import TimedJob
from rmr.vm.match import pattern_agrees
from rmr.vm.provenance import (
    Cause,
    DeliveredCause,
    EffectCause,
    FiringCause,
    FiringRecord,
    GivenCause,
    HandlerCause,
    HeardCause,
    MissedCause,
    OutsideCause,
    SensedCause,
    StandsCause,
    StepCause,
    UndeliveredCause,
)
from rmr.why.delay import OWNER_OF, Delay, Interval, PathAction, TimeOwner, cut_at, merged, without
from rmr.why.mind_index import MindIndex
from rmr.why.past_items import PastAction, PastDelivery, PastFact, PastSend, TurnGate
from rmr.why.radio_time import Attempts, radio_time
from rmr.why.robot_history import RobotHistory, failure_broadcast, next_supplier, on_its_way, told_of
from rmr.why.turn_order import waits_behind

STEPS_MAX = 100_000
"""Steps of one critical path; each goes back in time, or in the order of what happened at one instant."""
DIED = "its process had ended"
STOPPED = "it was stopped as somebody asked for"

Step = Callable[[], "Step | None"]
"""One step back; returns the next one, or None where the path has no more."""


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
            # A robot that drives loses nothing by a call that comes later by no more: its wheels turn on for so long.
            coasts = milliseconds(100) if owner in (TimeOwner.DRIVE, TimeOwner.QUEUE) else 0
            late = [(due, called) for due, called in history.late if called - due > coasts]
            parts = without(parts, late, TimeOwner.LATE_TICK, robot, "its host called it late")
            parts = without(parts, history.absences(stopped=False), TimeOwner.DEAD, robot, DIED)
            parts = without(parts, history.absences(stopped=True), TimeOwner.STOPPED, robot, STOPPED)
        self._found.extend(reversed(parts))
        self._cursor = since

    def _cover_turn(self, since: Instant, robot: int, gates: Sequence[TurnGate]) -> None:
        """Give the time to those who are ahead of the robot, one after the other."""
        since = max(since, self._begin)
        if since >= self._cursor:
            return
        for wait in reversed(waits_behind(self._histories, robot, gates, since, self._cursor)):
            self._cover(wait.begin, TimeOwner.TURN, robot, wait.whom, wait.detail)

    def _cover_drive(self, since: Instant, robot: int, drive: PastAction) -> None:
        """Give the time of a drive to what the wheels did."""
        history = self._histories[robot]
        for begin, _, state in reversed(history.motion_between(max(since, self._begin), self._cursor)):
            self._cover_motion(begin, robot, drive, state)

    def _cover_motion(self, begin: Instant, robot: int, drive: PastAction, state: MotionState) -> None:
        why = state.why
        text = self._text(robot, drive)
        if state.motion is Motion.GATED:
            self._cover_turn(begin, robot, drive.gates)
        elif state.motion is Motion.STANDS and why.rule == "queue":
            self._cover(begin, TimeOwner.QUEUE, robot, why.robots, f"{why.rule}: {text}")
        elif state.motion is Motion.STANDS:
            detail = f"{why.rule}: {why.place}" if why.place else why.rule
            self._cover(begin, TimeOwner.STANDING, robot, why.robots, detail)
        else:
            # The action that drives to a place in a queue.
            lines_up = self._program.predicates[drive.predicate].name == "lineup"
            owner = TimeOwner.QUEUE if lines_up and state.motion is Motion.DRIVES else OWNER_OF[state.motion]
            detail = "its newest sample was old" if state.motion is Motion.UNWATCHED else text
            if state.motion is Motion.LOCATES and why.place:
                detail = f"{text}: {why.place}"
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
        cause = history.newest_arrival(source, learned)
        if cause is None:
            return lambda: self._outside(robot, f"{job.text} of robot {source}", (source,))
        return lambda: self._delivery(robot, cause)

    def _finish_fact(self, history: RobotHistory, job: TimedJob, finish: Instant) -> Step:
        pattern = self._program.assertions[job.assertion].finish
        for mind in history.minds:
            for fact in mind.by_predicate[pattern.predicate]:
                if fact.at == finish and pattern_agrees(pattern.args, fact.args, job.bindings):
                    return partial(self._change, mind, fact)
        return lambda: self._outside(history.robot, job.text)

    def _text(self, robot: int, item: PastFact | PastAction) -> str:
        return fact_text(self._program, item.predicate, robot, item.args)

    def _change(self, mind: MindIndex, fact: PastFact, *, gone: bool = False) -> Step | None:
        """From a fact to what inserted it, or from its removal to what removed it."""
        robot = mind.robot
        text = self._text(robot, fact)
        at, place, cause = fact.at, fact.place, fact.cause
        if gone and fact.removal is not None:
            at, place, cause = fact.until, fact.removed_place, fact.removal
        self._cover(at, TimeOwner.RULE, robot, (), f"after {text}")
        if isinstance(cause, SensedCause):
            return self._sensed(mind, fact, at, place)
        if isinstance(cause, HeardCause) and (told := told_of(self._histories.get(cause.source), fact, gone=gone)):
            self._cover(told[1].until if gone else told[1].at, TimeOwner.OUTSIDE, robot, (cause.source,), text)
            return partial(self._change, *told, gone=gone)
        return self._because(mind, cause, place, text)

    def _because(self, mind: MindIndex, cause: Cause, place: int, what: str) -> Step | None:
        """From something that happened at a place among the records to its cause."""
        match cause:
            case FiringCause(number):
                return partial(self._firing, mind, mind.firings[number])
            case DeliveredCause():
                return partial(self._delivery, mind.robot, cause)
            case EffectCause(action=serial) | StepCause(action=serial) | HandlerCause(action=serial):
                action = mind.actions.get(serial)
                if action is not None and action.executor == mind.robot:
                    return partial(self._action, mind, action)
                news = OutsideCause() if isinstance(cause, HandlerCause) else cause.news
                return self._because(mind, news, place, what)
            case StandsCause(sent):
                return partial(self._settled, mind, mind.deliveries[sent])
            case UndeliveredCause():
                lost = mind.undelivered(cause, self._cursor)
                if lost is None:
                    return self._outside(mind.robot, what)
                if isinstance(lost, PastSend) and lost.key is None:
                    return self._because(mind, lost.cause, lost.place, what)
                return partial(self._settled, mind, lost)
            case MissedCause(job):
                start = mind.start_of(job, place)
                since = self._begin if start is None else start.at
                self._cover(since, TimeOwner.RULE, mind.robot, (), f"until a deadline had passed, for {what}")
                return self._outside(mind.robot, what) if start is None else partial(self._change, mind, start)
            case SensedCause() | GivenCause() | OutsideCause() | HeardCause():
                return self._outside(mind.robot, what)
            case _:
                assert_never(cause)

    def _outside(self, robot: int, what: str, whom: tuple[int, ...] = ()) -> Step | None:
        """Nobody has derived it: from the beginning of the process's life on; before that, what its last life did."""
        minds = self._histories[robot].minds
        lives = [number for number, mind in enumerate(minds) if number and mind.begins <= self._cursor]
        if lives and minds[lives[-1]].begins > self._begin:
            last = minds[lives[-1] - 1]
            self._cover(minds[lives[-1]].begins, TimeOwner.OUTSIDE, robot, whom, f"until {what} came")
            owner, detail = (TimeOwner.STOPPED, STOPPED) if last.stopped else (TimeOwner.DEAD, DIED)
            self._cover(last.died, owner, robot, (), detail)
            return lambda: self._stuck(robot)
        self._cover(self._begin, TimeOwner.OUTSIDE, robot, whom, f"until {what} came")
        return None

    def _sensed(self, mind: MindIndex, fact: PastFact, at: Instant, place: int) -> Step | None:
        """From a sensed fact to the drive that brought it about."""
        name = self._program.predicates[fact.predicate].name
        if name == "turn":
            return self._turn(mind, fact)
        known = self._histories.get(fact.args[0]) if name == "failed" and isinstance(fact.args[0], Robot) else None
        if known is not None and (broadcast := failure_broadcast(known.minds, fact)) is not None:
            return partial(self._action, *broadcast)
        for action in reversed(mind.own_actions):
            begun = action.begun if action.predicate in mind.wheels and action.place < place else None
            if begun is not None and begun <= at <= mind.ended(action):
                return partial(self._action, mind, action)
        return self._outside(mind.robot, self._text(mind.robot, fact))

    def _turn(self, mind: MindIndex, turn: PastFact) -> Step | None:
        """From a fact ``turn`` to what started the job that has asked for it."""
        start = mind.asked_for(turn)
        self._cover_turn(self._begin if start is None else start.at, mind.robot, ())
        return None if start is None else partial(self._change, mind, start)

    def _firing(self, mind: MindIndex, firing: FiringRecord) -> Step | None:
        """From a firing to the newest fact that its rule needed."""
        robot = mind.robot
        rule = rule_text(self._program, firing.rule)
        self._cover(firing.at, TimeOwner.RULE, robot, (), f"after the rule at {rule}")
        premise = mind.newest_premise(firing)
        if premise is None:
            self._cover(self._begin, TimeOwner.RULE, robot, (), f"until the rule at {rule} fired")
            return None
        fact, gone = premise
        words = f"until the rule at {rule} fired, after {self._text(robot, fact)}"
        self._cover(fact.until if gone else fact.at, TimeOwner.RULE, robot, (), words)
        return partial(self._change, mind, fact, gone=gone)

    def _action(self, mind: MindIndex, action: PastAction) -> Step | None:
        """From an action's end over its run and its waits to what derived it."""
        robot = mind.robot
        text = self._text(robot, action)
        self._actions.append(PathAction(self._cursor, robot, text, action))
        if action.begun is not None:
            if action.predicate in mind.wheels:
                self._cover_drive(action.begun, robot, action)
            self._cover(action.begun, TimeOwner.ACTION, robot, (), text)
        for since, what in reversed(action.waits):
            if what == "held":
                self._cover_turn(since, robot, action.gates)
            else:
                self._wheels_taken(since, robot, action)
        self._cover(action.at, TimeOwner.ACTION, robot, (), text)
        return self._because(mind, action.cause, action.place, text)

    def _wheels_taken(self, since: Instant, robot: int, action: PastAction) -> None:
        """Give the time in which an action waited for the wheels to those that had them."""
        for mind, other in self._histories[robot].actions():
            begun = other.begun if other is not action and other.predicate in mind.wheels else None
            if begun is not None and begun < self._cursor <= mind.ended(other):
                self._cover_drive(max(since, begun), robot, other)
        self._cover(since, TimeOwner.ACTION, robot, (), f"{self._text(robot, action)} waited for the wheels")

    def _delivery(self, robot: int, cause: DeliveredCause) -> Step | None:
        """From the arrival of a delivery over the radio to what its sender did."""
        history = self._histories.get(cause.source)
        sent = None if history is None else history.sent(cause, robot)
        arrival = self._histories[robot].arrival(cause)
        if arrival is not None:
            self._cover(arrival.at, TimeOwner.RULE, robot, (), "after a delivery")
        if sent is None:
            return self._outside(robot, f"what robot {cause.source} had sent", (cause.source,))
        return self._on_its_way(robot, *sent)

    def _on_its_way(self, robot: int, mind: MindIndex, sent: PastDelivery) -> Step | None:
        """From a delivery on its way to a robot to what its sender did."""
        source = mind.robot
        for part in reversed(radio_time(source, sent, self._cursor, self._attempts)):
            who = robot if part.owner is TimeOwner.LATE_TICK else source
            self._cover(part.begin, part.owner, who, (robot + source - who,), sent.text)
        return self._sent_for(mind, sent)

    def _settled(self, mind: MindIndex, sent: PastDelivery) -> Step | None:
        """From the news that a delivery of the robot's own was acknowledged or given up to what it was sent for."""
        assert sent.key is not None
        for part in reversed(radio_time(mind.robot, sent, self._cursor, self._attempts)):
            # After its last frame the robot waited for the acknowledgement.
            owner = TimeOwner.REPEATS if part.owner is TimeOwner.LATE_TICK else part.owner
            self._cover(part.begin, owner, mind.robot, (sent.key.destination,), sent.text)
        return self._sent_for(mind, sent)

    def _sent_for(self, mind: MindIndex, sent: PastDelivery) -> Step | None:
        """From the beginning of a delivery to the cause of the item that was sent, or to that of which it is news."""
        if isinstance(sent, PastSend):
            return self._because(mind, sent.cause, sent.place, sent.text)
        match sent.news:
            case PastFact():
                return partial(self._change, mind, sent.news)
            case PastAction():
                return partial(self._action, mind, sent.news)
            case None:
                return self._outside(mind.robot, sent.text)
            case _:
                assert_never(sent.news)

    # -- jobs that have not finished ----------------------------------------------------------------------------

    def _stuck(self, robot: int) -> Step | None:
        """Return the step back from a robot that waits at the cursor: what is under way, or was last."""
        history = self._histories[robot]
        at = self._cursor
        # What a deadline that has just passed brought about is no reason for it.
        active = [
            (mind, action)
            for mind, action in history.actions()
            if action.at <= at < mind.ended(action) and not (isinstance(action.cause, MissedCause) and action.at == at)
        ]
        if active:
            drives = [(mind, action) for mind, action in active if action.predicate in mind.wheels or action.gates]
            return partial(self._action, *(drives or active)[0])
        under_way = on_its_way(self._histories, robot, at)
        if under_way is not None:
            return partial(self._on_its_way, robot, *under_way)
        supplier = next_supplier(self._histories, robot, at, self._asked)
        if supplier is not None:
            self._asked.add(robot)
            return self._stuck(supplier)
        return self._last(history)

    def _last(self, history: RobotHistory) -> Step | None:
        """Return the step back to what happened last at a robot that has nothing under way."""
        at = self._cursor
        robot = history.robot
        actions = [(mind.ended(each), each.place, mind, each) for mind, each in history.actions() if each.at < at]
        over = max((each for each in actions if each[0] <= at), key=lambda each: each[:2], default=None)
        firings = ((mind, firing) for mind in reversed(history.minds) for firing in reversed(mind.firings.values()))
        fired = next(((mind, firing) for mind, firing in firings if firing.at <= at), None)
        # Of one instant: a firing behind an action's end follows from it.
        if over is not None and (fired is None or over[:2] > (fired[1].at, fired[0].firing_places[fired[1].number])):
            ended, _, mind, action = over
            end = "had ended" if action.failure is None else f"had failed: {action.failure}"
            words = f"no rule fired after {self._text(robot, action)} {end}"
            self._cover(ended, TimeOwner.RULE, robot, (), words)
            return partial(self._action, mind, action)
        if fired is not None:
            mind, firing = fired
            nothing = ", which found nothing" if mind.found_nothing(firing) else ""
            words = f"no rule fired after the one at {rule_text(self._program, firing.rule)}{nothing}"
            self._cover(firing.at, TimeOwner.RULE, robot, (), words)
            return partial(self._firing, mind, firing)
        self._cover(self._begin, TimeOwner.RULE, robot, (), "no rule fired")
        return None
