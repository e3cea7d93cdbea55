"""Rules of coordination, about leaders and about the schedules that they send.

- No term has two leaders, and without faults an event has at most one leader. A term is identified by its leader and a
  counter, so a term with two leaders is one that a robot begins twice. A restarted robot has lost its counter and is
  excused.
- Robots that forward a schedule do not change it, and no two versions have the same instant of issue.
- A slot within the frozen zone is not moved, unless its owner missed it, was stopped, or it is long over.
- A frame fits the radio.
"""

import heapq
from collections import OrderedDict

from rmr.base.time import NEVER, NS_PER_S, Duration, Instant, in_seconds, milliseconds, seconds
from rmr.bytecode.program import DeriveAction, DeriveFact
from rmr.coord.events import EntryMissed, LeadershipBegan, LeadershipEnded, SlotLost
from rmr.coord.messages import Entry, FrameKind, MessageError, Phase, Sched, decode
from rmr.coord.term import Term
from rmr.node.ports import Spoken
from rmr.vm.job import TimedJob
from rmr.vm.machine_events import ActionDerived, ExpressionFailed, JobFinished, JobMissed, JobStarted, RuleFired
from rmr_sim.checkers.passage_checker import TIMING
from rmr_sim.checkers.run_view import TICK, RecentTable, RunView

EVERY: Duration = NS_PER_S
"""Period of the count of leaders."""
LET_PASS = milliseconds(1200)
"""Greatest age of a slot at the report that its owner gave it up."""

_SCHED = bytes([FrameKind.SCHED])

Promise = tuple[bytes, Term, int, Instant]
"""Event, term, robot, trigger."""


class LeaderChecker:
    """Checks the beginnings and ends of leadership."""

    def __init__(self, view: RunView) -> None:
        self._view = view
        self._leads: dict[bytes, dict[int, tuple[int, Instant]]] = {}
        """By event and robot: the incarnation that leads, and since when."""
        self._terms: RecentTable[tuple[bytes, int, int], None] = RecentTable()
        self._told: RecentTable[tuple[bytes, int, int], None] = RecentTable()
        self._look_at: Instant = 0
        view.subscribe(LeadershipBegan, self._began)
        view.subscribe(LeadershipEnded, self._ended)

    def _began(self, robot: int, now: Instant, began: LeadershipBegan) -> None:
        term = (began.group_id, robot, began.term)
        if term in self._terms and not self._view.forgot(robot, 0):
            self._view.violate(now, "term", (robot,), f"robot {robot} began term {began.term} a second time")
        self._terms[term] = None
        self._leads.setdefault(began.group_id, {})[robot] = (self._view.life(robot), now)

    def _ended(self, robot: int, _now: Instant, ended: LeadershipEnded) -> None:
        self._leads.get(ended.group_id, {}).pop(robot, None)

    def __call__(self, now: Instant) -> None:
        """Count the leaders of each event, once a second."""
        if now < self._look_at:
            return
        self._look_at = now + EVERY
        for event, leads in list(self._leads.items()):
            for robot, (life, _) in list(leads.items()):
                if not self._view.alive(robot) or self._view.life(robot) != life:
                    del leads[robot]
            if len(leads) > 1:
                self._check(now, event, leads)
            elif not leads:
                del self._leads[event]

    def _check(self, now: Instant, event: bytes, leads: dict[int, tuple[int, Instant]]) -> None:
        """Report two robots that have led one event for too long although they are linked."""
        ordered = sorted(leads)
        for index, a in enumerate(ordered):
            for b in ordered[index + 1 :]:
                since = max(leads[a][1], leads[b][1], self._view.healed_at)
                # Time for two leaders in radio range to agree: many repetitions of their schedules.
                if now < since + seconds(5) or (event, a, b) in self._told or not self._view.linked(a, b, since, now):
                    continue
                self._told[event, a, b] = None
                self._view.violate(now, "leaders", (a, b), f"robots {a} and {b} lead one event though all is well")


class ScheduleChecker:
    """Checks every schedule that is sent."""

    def __init__(self, view: RunView) -> None:
        self._view = view
        self._room = view.simulation.robots[0].payload_max
        self._said: RecentTable[tuple[bytes, Term, Instant, int], bytes] = RecentTable()
        self._promised: RecentTable[Promise, tuple[Instant, Instant]] = RecentTable()
        """The fixed slot, and the issue of the schedule that fixed it: frames may overtake one another."""
        self._given_up: RecentTable[tuple[int, bytes], Instant] = RecentTable()
        view.subscribe(Spoken, self._spoken)
        view.subscribe(SlotLost, self._gave_up)
        view.subscribe(EntryMissed, self._gave_up)

    def __call__(self, _now: Instant) -> None:
        """Do nothing: all checks are made on events."""

    def _gave_up(self, robot: int, now: Instant, lost: SlotLost | EntryMissed) -> None:
        self._given_up[robot, lost.group_id] = now

    def _spoken(self, robot: int, now: Instant, spoken: Spoken) -> None:
        payload = spoken.payload
        if len(payload) > self._room:
            words = f"robot {robot} sent {len(payload)} octets where {self._room} fit"
            self._view.violate(now, "frame", (robot,), words)
        if payload[:1] != _SCHED:
            return
        try:
            sched = decode(payload, self._room)
        except MessageError as error:
            self._view.violate(now, "frame", (robot,), f"robot {robot} sent a schedule that is none: {error}")
            return
        assert isinstance(sched, Sched)
        key = (sched.group_id, sched.term, sched.issued, sched.part)
        if self._said.get(key, payload) != payload:
            words = f"robot {robot} sent another version of the schedule that leader {sched.term.leader} issued"
            self._view.violate(now, "schedule", (robot, sched.term.leader), words)
        else:
            self._said[key] = payload
        if sched.term.leader == robot:
            for entry in sched.entries:
                self._check(now, sched, entry)

    def _check(self, now: Instant, sched: Sched, entry: Entry) -> None:
        """Report a fixed slot that has moved; record the slots that are fixed now."""
        key = (sched.group_id, sched.term, entry.robot, entry.trigger)
        promised, issued = self._promised.get(key, (None, -1))
        if sched.issued <= issued:
            return
        if promised is not None and entry.phase is Phase.WAITING and entry.start != promised:
            del self._promised[key]
            over = sched.issued > promised + entry.duration + TIMING.schedule.window
            if not over and not self._excused(entry.robot, sched, promised, now):
                words = f"leader {sched.term.leader} moved the slot of robot {entry.robot}, which stood already"
                self._view.violate(now, "frozen slot", (sched.term.leader, entry.robot), words)
        if entry.start is not None and entry.start <= sched.issued + TIMING.schedule.frozen:
            self._promised[key] = entry.start, sched.issued

    def _excused(self, robot: int, sched: Sched, promised: Instant, now: Instant) -> bool:
        """Return whether the owner of a slot gave it up or could not use it."""
        if robot not in self._view.robots:
            return True
        gave_up = self._given_up.get((robot, sched.group_id), -LET_PASS)
        since = promised - TIMING.liveness.gone
        return (
            gave_up >= promised - LET_PASS
            or bool(self._view.held_up(robot, since, now))
            or self._view.forgot(robot, since)
        )


# ---- rule: a deadline that passes without the finish fact derives its violation action, once and on time (paper III.E)
#
# On time is within the tick of the deadline. A robot that was stopped or slow then has until the first tick after.
# Jobs that were lost with a robot's process are excused. A durable robot loses none.

CHECK = "deadline"
MISSED_MAX = 10_000
"""Bound of the missed jobs that are kept to detect a second miss; the oldest are dropped."""


class DeadlineChecker:
    """Checks deadlines against a queue of its own."""

    def __init__(self, view: RunView) -> None:
        self._view = view
        self._due: list[tuple[Instant, int, int, int, TimedJob]] = []
        """Heap of jobs: instant at which a miss must be known, sequence number, robot, incarnation, job."""
        self._number = 0
        self._missed: OrderedDict[int, TimedJob] = OrderedDict()
        """Missed jobs by identity, which is unique as long as the job is kept here."""
        self._owed: dict[int, TimedJob] = {}
        """By robot, the missed job whose violation action must come next."""
        self._paid: dict[int, ActionDerived] = {}
        """By robot, the violation action just derived, if nothing has happened since."""
        view.subscribe(JobStarted, self._started)
        view.subscribe(JobFinished, self._other_event)
        view.subscribe(RuleFired, self._other_event)
        view.subscribe(ExpressionFailed, self._other_event)
        view.subscribe(JobMissed, self._miss)
        view.subscribe(ActionDerived, self._derived)

    def _started(self, robot: int, _now: Instant, started: JobStarted) -> None:
        self._other_event(robot, 0, started)
        if started.job.deadline < NEVER - TICK:
            self._await(started.job.deadline + TICK, robot, self._view.life(robot), started.job)

    def _await(self, at: Instant, robot: int, life: int, job: TimedJob) -> None:
        self._number += 1
        heapq.heappush(self._due, (at, self._number, robot, life, job))

    def _other_event(self, robot: int, _now: Instant, event: object) -> None:
        self._paid.pop(robot, None)
        if isinstance(event, ExpressionFailed):  # the arguments have no value: the action is left out, and reported
            self._owed.pop(robot, None)

    def _miss(self, robot: int, now: Instant, missed: JobMissed) -> None:
        job = missed.job
        violate = self._view.violate
        if id(job) in self._missed:
            violate(now, CHECK, (robot,), f"robot {robot} missed the deadline of {job.text} a second time")
        if now < job.deadline:
            violate(now, CHECK, (robot,), f"robot {robot} missed the deadline of {job.text} before it was due")
        held_up = self._view.held_up(robot, job.deadline, job.deadline)
        if now > max(job.deadline, held_up) + TICK:
            late_s = in_seconds(now - job.deadline)
            violate(now, CHECK, (robot,), f"robot {robot} noticed {late_s:.3f} s late that {job.text} was overdue")
        self._missed[id(job)] = job
        if len(self._missed) > MISSED_MAX:
            self._missed.popitem(last=False)
        if isinstance(self._violation(robot, job), DeriveAction):  # of a fact there is no event where it is inserted
            self._owed[robot] = job
        self._paid.pop(robot, None)

    def _violation(self, robot: int, job: TimedJob) -> DeriveAction | DeriveFact:
        return self._view.node(robot).program.assertions[job.assertion].violation

    def _derived(self, robot: int, now: Instant, action: ActionDerived) -> None:
        job = self._owed.pop(robot, None)
        paid = self._paid.pop(robot, None)
        if job is not None:
            if action.predicate == self._violation(robot, job).predicate:
                self._paid[robot] = action
                return
            self._view.violate(now, CHECK, (robot,), f"robot {robot} derived another action than that of {job.text}")
        elif paid is not None and (paid.predicate, paid.args) == (action.predicate, action.args):
            self._view.violate(now, CHECK, (robot,), f"robot {robot} derived the action of a missed deadline twice")

    def __call__(self, now: Instant) -> None:
        """Check the deadlines that have passed, and the misses of this tick."""
        if self._owed:
            for robot, job in self._owed.items():
                self._view.violate(now, CHECK, (robot,), f"robot {robot} derived no action when {job.text} was overdue")
            self._owed.clear()
        self._paid.clear()
        while self._due and self._due[0][0] < now:
            _, _, robot, life, job = heapq.heappop(self._due)
            self._check(now, robot, life, job)

    def _check(self, now: Instant, robot: int, life: int, job: TimedJob) -> None:
        """Report a violation if `job` is overdue and its robot, though called, has not noticed."""
        view = self._view
        present = view.present(robot, job)
        if present is None:
            return
        job = present
        if job.ended or job.missed or job.finish is not None or job.deadline + TICK >= now:
            return  # noticed, done, or started again with a later deadline, which has its own entry
        if not view.alive(robot) or view.life(robot) != life:
            return
        held_up = view.held_up(robot, job.deadline, now)
        if held_up + TICK >= now:
            self._await(max(held_up, now) + TICK, robot, life, job)
            return
        view.violate(now, CHECK, (robot,), f"robot {robot} has not noticed that {job.text} is overdue")
