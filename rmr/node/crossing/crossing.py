"""One crossing: a job's use of a shared resource, as a state machine (phases and transitions: `phases`).

Values in, values out. `step` is given the situation of this tick, `handle` an event of the coordination core; both
return commands, which `rmr.node.crossing.crossings` carries out. A crossing knows one resource, that of its group: a
robot may have any number of them at a time. To the action that serves the job it is the permit to begin.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from rmr.base.arena import Area
from rmr.base.geometry import Point
from rmr.base.time import NEVER, Duration, Instant, in_seconds, milliseconds, seconds
from rmr.coord.events import Entered, EntryMissed, JobRequest, SlotAssigned, SlotLost
from rmr.coord.timing import LivenessTiming
from rmr.node.actions.dispatcher import RunningAction
from rmr.node.config import STUCK, UNKNOWN_INSIDE
from rmr.node.crossing.lateness import NEAR_ENTRANCE, POLICIES, REVISE_FROM, Lateness, Symptom
from rmr.node.crossing.phases import (
    IGNORED,
    TRANSITIONS,
    Asking,
    Inside,
    Left,
    OwnEvent,
    Phase,
    Preparing,
    SlotEvent,
    Slotted,
    phase_name,
)
from rmr.node.crossing.situation import (
    EXTEND_BEFORE,
    ChangeRank,
    Command,
    CrossingPlan,
    InsideUntil,
    Leave,
    OpenHoldLine,
    Revise,
    SetReady,
    Situation,
    TraceEntry,
    Unforeseen,
    Withdraw,
    held_until,
)
from rmr.vm.job import TimedJob

POLL_EVERY: Final[Duration] = milliseconds(500)
"""How often a robot that waits compares its own estimate with its slot."""
LEAVE_EARLY: Final[Duration] = milliseconds(300)
"""An action is released this much before it must be under way to reach the commit line on time."""
REPLAN_BEFORE: Final[Duration] = seconds(3)
"""Earlier before its slot a robot keeps its route: to the entrance any is the same, and ranks still change."""
PRESUMED_GONE: Final[Duration] = LivenessTiming().gone
"""A robot that was stopped for longer than this while inside may have been presumed gone."""
TRIGGERS_APART: Final[Duration] = milliseconds(10)
"""Two triggers of one robot differ by this at least: the grid of instants in frames."""


@dataclass(slots=True)
class Course:
    """The course of a crossing: where the robot is sent while it is under way."""

    destination: Point | None = None
    """The place that the robot has taken, until its route there is planned."""
    planned_at: Instant = 0
    """When a route was planned last."""
    replan_from: Instant = 0
    """Before the entrance a route is planned from then on, since the newest slot is near."""

    def send(self, destination: Point | None) -> None:
        """Send the robot to `destination`; None: no longer anywhere else."""
        self.destination = destination

    def planned(self, now: Instant) -> None:
        """Note that a route has been planned."""
        self.destination = None
        self.planned_at = now


@dataclass(slots=True)
class Crossing:
    """A job's use of one shared resource."""

    job: TimedJob
    group_id: bytes
    """Six octets that name the group of those that contend for the resource."""
    event_id: bytes
    """Those of the job's event: the group, unless the resource is one of robots of several events."""
    trigger: Instant
    """With the robot the identity of the request."""
    goal: Area | None
    """Where the serving action leads; None when it does not move the robot to an area."""
    phase: Phase = field(default_factory=Preparing)
    plan: CrossingPlan = field(default_factory=CrossingPlan)
    release: Instant = 0
    """The robot cannot be at its commit line before, as the leader has heard."""
    late: Lateness = field(default_factory=Lateness)
    course: Course = field(default_factory=Course)
    beyond: bool = False
    """Whether the robot had the resource behind it when it asked."""
    barred: bool = False
    """Whether the dead bar every way, as of the last poll; all places of a station, for `STUCK`."""
    free_at: Instant = 0
    """When a place of the station was last free of the dead, or the robot began to ask."""
    rank: int = 0
    place: int = 0
    """The robot is the place-th of those that go its direction; 0: not known."""
    entered_at: Instant = 0
    """When the robot entered last; 0: never."""
    serving: list[RunningAction] = field(default_factory=list)
    """The actions that wait for this crossing, or are under way by it; rarely more than one."""
    later: Duration = 0
    """The least time that later steps of the job take behind the drive."""
    of_drive: bool = False
    """Whether it is that of one drive alone, which needs a turn at passages only."""
    station: bool = False
    """Whether the resource is a station, the goal: held until the robot has left it."""
    capacity: int = 1
    """How many robots may be in the resource at a time."""
    of_step: str = ""
    """What robots contend for in an earlier step of the job; empty: the job's event, or another resource."""
    steps_later: int = 0
    """How many steps with turns follow in the job."""
    takes: Duration = 0
    """How long its action takes, as far as is known; 0: the job has no earlier steps, and nobody asks."""
    pace: Duration = 0
    """How long the longest later step takes: a robot that goes sooner after another one only waits there."""
    ready_from: Instant = 0
    """When the steps before will be over, as far as is known."""

    # -- what others ask ------------------------------------------------------------------------------------

    @property
    def action(self) -> RunningAction | None:
        """The action that serves the job, the one under way before those that wait."""
        for running in self.serving:
            if running.started is not None:
                return running
        return self.serving[0] if self.serving else None

    @property
    def waits(self) -> bool:
        """Whether the robot may not enter yet."""
        return not isinstance(self.phase, (Inside, Left))

    @property
    def over(self) -> bool:
        """Whether the robot has left, or needs no crossing."""
        return isinstance(self.phase, Left)

    @property
    def passage(self) -> str | None:
        """The passage of robots of all events at which it asks or is; None: its resource is that of its event."""
        return self.plan.passage if self.group_id != self.event_id else None

    @property
    def told(self) -> str:
        """What the robot contends for, as the trace tells it: a passage, a station or an event."""
        return self.passage or self.of_step or self.job.event

    @property
    def name(self) -> str:
        """What the facts `turn` and `leads` call it."""
        return self.passage or self.of_step.partition("(")[0] or self.job.name

    @property
    def deadline(self) -> Instant:
        """By when the robot wants to be clear of the resource, as the leader hears it."""
        demoted_at = self.late.demoted_at
        if demoted_at is not None:
            return demoted_at
        return self.due - self.plan.after + self.reserved - self.plan.inside

    @property
    def due(self) -> Instant:
        """By when the actions that go by it have to end: later steps of the job have the time until its deadline."""
        return self.job.deadline - self.later

    @property
    def reserved(self) -> Duration:
        """How long the slot is: as long as the step, or the longest later one."""
        return self.plan.inside if self.plan.gated else max(self.plan.inside, self.pace)

    def released(self, now: Instant) -> bool:
        """Return whether the action that serves the job may begin."""
        if not self.waits or (self.job.finish is not None and not self.station):
            return True
        if self.barred:  # it finds no way, and fails with a reason, instead of waiting for slots of no use
            return self.plan.gated or self.station
        in_time = self.plan.obstructs_exit or now >= self._sets_out_at
        return self.plan.gated and isinstance(self.phase, Slotted) and in_time

    def leaves_after(self, instant: Instant) -> bool:
        """Return whether the robot, which stands, has a slot for which it need not set out before `instant`."""
        running = self.action
        stands = running is None or running.started is None
        return self.plan.gated and stands and not self.plan.obstructs_exit and instant < self._sets_out_at < NEVER

    @property
    def _sets_out_at(self) -> Instant:
        """When the action has to begin for the slot; NEVER without one."""
        phase = self.phase
        return phase.start - self.plan.approach - LEAVE_EARLY if isinstance(phase, Slotted) else NEVER

    @property
    def next_wake(self) -> Instant:
        """When `step` has something to do even if nothing happens."""
        phase = self.phase
        if isinstance(phase, Left):
            return NEVER
        if isinstance(phase, Inside):
            return phase.end - self.plan.notice
        sets_out_at = self._sets_out_at
        poll_at = phase.polled_at + POLL_EVERY
        return min(poll_at, sets_out_at) if sets_out_at > phase.polled_at else poll_at

    def poll_is_due(self, now: Instant) -> bool:
        """Return whether `step` compares a new estimate with what the leader has heard."""
        phase = self.phase
        return isinstance(phase, (Asking, Slotted)) and self.plan.gated and now - phase.polled_at >= POLL_EVERY

    def release_may_be_old(self) -> bool:
        """Return whether a new leader must hear another release: without a slot a robot is no nearer than it was."""
        return isinstance(self.phase, Asking) and self.plan.gated

    def hold_line(self) -> OpenHoldLine:
        """Return what the phase allows at the hold line."""
        start = self.phase.start if isinstance(self.phase, Slotted) else None
        return OpenHoldLine(start, opened=isinstance(self.phase, Inside), passage=self.plan.passage)

    # -- the machine ----------------------------------------------------------------------------------------

    def _enter(self, event: type | OwnEvent, phase: Phase) -> None:
        """Enter `phase` by `event`: nothing else writes the phase."""
        assert TRANSITIONS[type(self.phase), event] is type(phase), (self.phase, event, phase)
        self.phase = phase

    def step(self, now: Instant, situation: Situation) -> list[Command]:
        """Go on by what the robot finds in this tick."""
        phase = self.phase
        if isinstance(phase, Left):
            return []
        if isinstance(phase, Inside):
            return self._pass(now, phase, situation)
        if isinstance(phase, Preparing):
            return self._request(now, phase, situation)
        if situation.excused:
            self._enter(OwnEvent.EXCUSED, Left())
            return self._withdraw()
        commands = self._poll(now, phase, situation)
        return commands if isinstance(self.phase, Preparing) else [*commands, SetReady(situation.ready)]

    def handle(self, now: Instant, event: SlotEvent, situation: Situation) -> list[Command]:
        """Take in what the coordination core tells."""
        transition = type(self.phase), type(event)
        if transition not in TRANSITIONS:
            name = phase_name(self.phase), type(event).__name__
            return [] if transition in IGNORED else [Unforeseen(*name)]
        match event:
            case SlotAssigned():
                return self._take_slot(event)
            case Entered(end=end, cautious=cautious):
                self._enter(Entered, Inside(end, situation.route))
                self.entered_at = now
                entry = TraceEntry("entered", {"event": self.told, "cautious": cautious})
                return [self.hold_line(), entry]
            case SlotLost() | EntryMissed():
                return self._lose_slot(now, event, situation)

    def renew(self, now: Instant, job: TimedJob, goal: Area | None) -> list[Command]:
        """Give up what was requested, so that a new request follows."""
        given_up = [] if isinstance(self.phase, (Preparing, Left)) else self._withdraw()
        self._enter(OwnEvent.RENEWED, Preparing())
        self.job = job
        self.goal = goal
        self.late.committed = False
        self.trigger = max(now, self.trigger + TRIGGERS_APART)
        return [*given_up, self.hold_line()]

    def restart(self, now: Instant, job: TimedJob, goal: Area | None) -> list[Command]:
        """Take over a job that was restarted before it had ended; a robot that is inside continues."""
        if isinstance(self.phase, Inside):
            self.job = job
            return []
        self._begin_anew()
        return self.renew(now, job, goal)

    def _begin_anew(self) -> None:
        """Forget what has been missed: of another job, or at another resource."""
        self.late.forget()
        self.release = 0

    def lead_to(self, now: Instant, goal: Area | None) -> list[Command]:
        """Take the goal from the action if the job does not define it: the route may differ from the reported one."""
        if self.goal == goal or isinstance(self.phase, Inside):
            return []
        if not isinstance(self.phase, Preparing):
            return self.renew(now, self.job, goal)
        self.goal = goal
        return []

    def retry(self, now: Instant, plan: CrossingPlan | None) -> list[Command]:
        """Request again for another try of a job that has not ended: not if the route, anew, passes no entrance.

        Then the robot has the resource behind it. That the crossing was gated stays so, for the try after that.
        """
        passes = plan is None or plan.gated or not self.plan.gated
        if plan is not None and self.plan.gated:
            self.plan = replace(plan, gated=True, passage=plan.passage or self.plan.passage)
        return self.renew(now, self.job, self.goal) if passes else []

    def foresee(self, now: Instant, ready_from: Instant, later: Sequence[Duration]) -> list[Command]:
        """Take over when the steps before will be over, and how long those after it take: the leader hears of it."""
        old = self.deadline
        self.ready_from, self.later, self.pace = ready_from, sum(later), max(later, default=0)
        if not isinstance(self.phase, (Asking, Slotted)):
            return []
        release = max(now + self.plan.approach, ready_from)
        earlier = self.release - release
        # A robot that waits for nothing but its slot tells no later release: it is as near as it was.
        changed = earlier > REVISE_FROM or (ready_from > now and -earlier > REVISE_FROM)
        if not changed and self.deadline == old:
            return []
        self.release = release
        return [Revise(release, self.deadline)]

    def ends(self, now: Instant) -> Instant:
        """Return when the action that serves the job in this step will be over, as far as is known."""
        plan = self.plan
        if isinstance(self.phase, Inside):
            end = self.entered_at + plan.inside
            while end < now:  # it takes longer than it was thought to: a guess that seldom changes
                end += milliseconds(200) + (end - self.entered_at) // 4
            return end + plan.after
        start = self.phase.start if isinstance(self.phase, Slotted) else max(now + plan.approach, self.ready_from)
        return start + self.length

    @property
    def length(self) -> Duration:
        """How long the step takes once it has begun, as far as is known."""
        return self.takes if isinstance(self.phase, Preparing) else self.plan.inside + self.plan.after

    def polled(self, now: Instant) -> None:
        """Note that a request cannot be made yet."""
        if isinstance(self.phase, Preparing):
            self.phase.polled_at = now

    def move(self, group_id: bytes, trigger: Instant = 0) -> None:
        """Go to another resource, that of a group in which the robot's last trigger was before `trigger`."""
        assert isinstance(self.phase, Preparing), self.phase
        self.group_id = group_id
        self.trigger = max(self.trigger, trigger)
        self._begin_anew()

    def finish(self) -> list[Command]:
        """Handle the end of the job before the robot has entered."""
        return self._give_up(OwnEvent.JOB_OVER)

    def fail(self) -> list[Command]:
        """Handle the failure of the last action that serves the job: its turn goes to others.

        Another try asks anew (`retry`). A robot inside keeps its turn until it is clear.
        """
        return self._give_up(OwnEvent.ACTION_FAILED) if self.waits else []

    def _give_up(self, event: OwnEvent) -> list[Command]:
        requested = not isinstance(self.phase, Preparing)
        self._enter(event, Left())
        return self._withdraw() if requested else []

    def _withdraw(self) -> list[Command]:
        return [Withdraw(), TraceEntry("withdrawn", {"event": self.told})]

    def leave(self) -> list[Command]:
        """Leave: the robot is clear of the resource."""
        self._enter(OwnEvent.CLEARED, Left())
        return [Leave(), TraceEntry("left", {"event": self.told})]

    def follow_leader(self, now: Instant, situation: Situation) -> list[Command]:
        """Tell a new leader the release of today, if `release_may_be_old`."""
        if not situation.may_ask:
            return []
        self.plan = situation.plan or self.plan
        self.release = max(self.release, now + self.plan.approach)
        return [Revise(self.release)]

    # -- phase by phase -------------------------------------------------------------------------------------

    def _request(self, now: Instant, phase: Preparing, situation: Situation) -> list[Command]:
        self.plan = situation.plan or self.plan
        if not situation.may_ask:
            phase.polled_at = now if situation.pose is not None else phase.polled_at
            return []
        self.beyond = situation.beyond
        if situation.excused:
            self._enter(OwnEvent.EXCUSED, Left())
            return []
        self._enter(OwnEvent.REQUESTED, Asking(now))
        plan = self.plan
        self.release = max(self.release, now + plan.approach, self.ready_from)
        times = {"approach_s": plan.approach, "inside_s": plan.inside, "after_s": plan.after}
        fields = {name: in_seconds(time) for name, time in times.items()}
        return [TraceEntry("asks", {"event": self.told, **fields, "way": plan.direction}), self._job_request()]

    def _job_request(self) -> JobRequest:
        plan = self.plan
        return JobRequest(
            group_id=self.group_id,
            trigger=self.trigger,
            release=self.release,
            duration=self.reserved,
            deadline=self.deadline,
            headway=plan.headway,
            direction=plan.direction,
            inside=plan.within,
            underway=self.late.committed,
            postpones=plan.gated,
            capacity=self.capacity,
        )

    def _poll(self, now: Instant, phase: Asking | Slotted, situation: Situation) -> list[Command]:
        """Compare the robot's own estimate with its slot, and with what the leader has heard."""
        if self.station:
            self.free_at = self.free_at if situation.barred and self.free_at else now
            self.barred = now - self.free_at > STUCK
        if not self.poll_is_due(now):
            return []
        phase.polled_at = now
        if not self.station:
            self.barred = situation.barred
        # Pushed in, or its slot was lost there, it has to get out. Its way may lead through another passage by now.
        if situation.within or self._goes_elsewhere(situation.plan):
            return self.renew(now, self.job, self.goal)
        self.plan = situation.plan or self.plan
        slot = phase.start if isinstance(phase, Slotted) else None
        symptom = self.late.diagnose(now, situation, self.plan.approach, self.release, slot)
        return [] if symptom is None else self._treat(now, symptom, situation)

    def _goes_elsewhere(self, plan: CrossingPlan | None) -> bool:
        own = self.plan
        return plan is not None and plan.gated and (plan.passage, plan.direction) != (own.passage, own.direction)

    def _treat(self, now: Instant, symptom: Symptom, situation: Situation) -> list[Command]:
        release = self.late.treat(now, symptom, self.plan.approach, alone=situation.alone)
        if release is None:
            return []
        self.release = release
        return [Revise(release, self.deadline, self.late.committed)]

    def _take_slot(self, event: SlotAssigned) -> list[Command]:
        phase = self.phase
        assert isinstance(phase, (Asking, Slotted))
        self._enter(SlotAssigned, Slotted(event.start, phase.polled_at))
        self.course.replan_from = event.start - REPLAN_BEFORE
        times = {"start_s": in_seconds(event.start), "end_s": in_seconds(event.end)}
        commands: list[Command] = [TraceEntry("slotted", {"event": self.told, "rank": event.rank, **times})]
        if (event.rank, event.place) != (self.rank, self.place):
            self.rank = event.rank
            self.place = event.place
            commands.append(ChangeRank())
        return [*commands, self.hold_line()]

    def _lose_slot(self, now: Instant, event: SlotLost | EntryMissed, situation: Situation) -> list[Command]:
        missed = isinstance(event, EntryMissed)
        revised: list[Command] = []
        if missed and self.plan.gated and not situation.ready:
            cannot_be_passed = situation.late_goes_next and situation.set_out and self.plan.approach <= NEAR_ENTRANCE
            revised = self._treat(now, Symptom.RETRY_NEXT if cannot_be_passed else Symptom.SLOT_WASTED, situation)
        self._enter(type(event), Asking(0))
        return [*revised, self.hold_line(), TraceEntry("slot_lost", {"event": self.told, "missed": missed})]

    def _pass(self, now: Instant, phase: Inside, situation: Situation) -> list[Command]:
        """Go on inside until the robot is clear."""
        if self.station:
            end = held_until(now, phase.end, leaving=situation.retreating)
            return self.leave() if situation.cleared else [] if end is None else self._extend(phase, end)
        if not self.plan.gated:
            if self.job.finish is not None:
                return self.leave()
            return self._extend(phase, now + UNKNOWN_INSIDE) if phase.end < now + self.plan.notice else []
        phase.route = situation.route
        slept = now - phase.stepped_at > PRESUMED_GONE
        phase.stepped_at = now
        if situation.within:  # its action is still to begin
            return self._extend(phase, now + UNKNOWN_INSIDE)
        if slept and situation.before_hold_line and not self.plan.within:
            return self.renew(now, self.job, self.goal)  # others may have entered since, for they heard nothing of it
        if self._leaves_entry_unused(now, situation):
            self._treat(now, Symptom.ENTRY_UNUSED, situation)
            return self.renew(now, self.job, self.goal)
        if situation.cleared:
            return self.leave()
        end = now + max(situation.eta_clear, EXTEND_BEFORE)
        return self._extend(phase, end) if abs(end - phase.end) > REVISE_FROM else []

    def _leaves_entry_unused(self, now: Instant, situation: Situation) -> bool:
        """Return whether the robot gives its entry back, since a robot that waits for its own turn is in its way."""
        stands = situation.before_hold_line and now - self.entered_at > POLICIES[Symptom.ENTRY_UNUSED].after
        return not self.plan.within and (situation.retreating or stands)

    def _extend(self, phase: Inside, end: Instant) -> list[Command]:
        phase.end = end
        return [InsideUntil(end)]
