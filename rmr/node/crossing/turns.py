"""Turns: how a time assertion's job gets its turn and how the robot keeps it (paper IV.C).

A job whose finish some action serves takes part in the distributed schedule of its event. This module stands between
three machines that know nothing of each other: the jobs of the virtual machine, the coordination core, and the
navigator. It asks for a slot with the times that the robot's way needs, releases the held action just in time, tells
the coordination core when the robot is at its gate, opens the gate when entering is granted, and reports when the
robot is clear.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from rmr.base.arena import Area
from rmr.base.streams import stable_hash
from rmr.base.time import NEVER, Duration, Instant, in_seconds, milliseconds
from rmr.base.values import Symbol, Value
from rmr.coord.coordination import Coordination
from rmr.coord.events import (
    CoordEvent,
    Entered,
    EntryMissed,
    LeaderChanged,
    LeadershipBegan,
    LeadershipEnded,
    PathReceived,
    ScheduleChanged,
    SlotAssigned,
    SlotLost,
)
from rmr.coord.values import Order
from rmr.node.crossing.destination import keep_course, rank_changed
from rmr.node.crossing.request import estimate, finds_itself_within, request_of
from rmr.node.crossing.shared_path import Leading
from rmr.node.crossing.turn import (
    EVENTS_KEPT,
    EXTEND_BEFORE,
    HINDERED_MAX,
    OFF_ROUTE_M,
    REVISE_EVERY,
    UNKNOWN_INSIDE,
    Phase,
    Turn,
    area_among,
    clear_of_bottleneck,
    gets_nowhere,
    goal_of,
    in_mouth,
    is_beyond,
    keep,
    passage_of,
)
from rmr.node.motion.navigator import Navigator
from rmr.vm.job import Job

if TYPE_CHECKING:
    from rmr.node.node import Node

READY: Final[Duration] = milliseconds(200)
"""A robot asks to enter when it will be at its gate's line within this; less than the entry window."""
REVISE_FROM: Final[Duration] = milliseconds(250)
"""A slot is asked for anew when the robot's own estimate has moved by more than this."""
TRIGGERS_APART: Final[Duration] = milliseconds(10)
"""Two triggers of one robot differ by this at least: the grid of instants in frames."""


class Turns:
    """All turns of one robot."""

    def __init__(self, node: "Node", coordination: Coordination, digest: int) -> None:
        self._node = node
        self._coordination = coordination
        self._digest = digest
        self._turns: dict[bytes, Turn] = {}
        self.next_wake: Instant = NEVER
        """When `step` has something to do even if nothing happens; at most once a frame."""
        self.leading = Leading(node, coordination, self.name_of)
        self.schedules: dict[bytes, ScheduleChanged] = {}
        """The newest schedule of each event."""

    @property
    def _navigator(self) -> Navigator | None:
        return None if self._node.driver is None else self._node.driver.navigator

    # -- jobs -----------------------------------------------------------------------------------------------

    def started(self, now: Instant, job: Job) -> None:
        """Handle a job that has started: it asks for a turn as soon as the robot knows where it is."""
        assertion = self._node.program.assertions[job.assertion]
        alone = self._node.config.values.order is Order.NONE
        if alone or not assertion.scheduled or not assertion.serving:
            return
        event = self.event_of(job)
        old = self._turns.get(event)
        if old is not None and old.phase is Phase.INSIDE:
            old.job = job  # started anew on its way through: the passage goes on
            return
        if old is not None and old.phase is not Phase.LEFT:
            old.hindered, old.behind, old.release = 0, None, 0
            self._ask_again(now, old, job, goal_of(self._node, job))  # what it holds waits for this very turn
            return
        trigger = max(now, old.trigger + TRIGGERS_APART if old else 0)
        self._turns.pop(event, None)  # the newest turn is the last
        self._turns[event] = Turn(job, event, trigger, goal_of(self._node, job))
        self._forget()
        self._ask(now, self._turns[event])

    def _ask(self, now: Instant, turn: Turn) -> None:
        """Ask for a turn; of a job that leaves its goal to the action, `step` asks once rules have derived that."""
        servings = self._node.program.assertions[turn.job.assertion].serving
        if turn.goal is not None or not any(self._node.drives_to_area(serving.action) for serving in servings):
            self._request(now, turn)

    def _ask_again(self, now: Instant, turn: Turn, job: Job, goal: Area | None) -> None:
        """Give back the slot that `turn` has, if any, and ask for another one."""
        if turn.requested and turn.phase is not Phase.LEFT:
            self._coordination.withdraw(now, turn.event)
        turn.job, turn.goal, turn.underway = job, goal, False
        turn.trigger = max(now, turn.trigger + TRIGGERS_APART)
        turn.phase, turn.requested = Phase.ASKING, False
        self._open(turn, None, opened=False)
        self._ask(now, turn)

    def _forget(self) -> None:
        """Keep memory bounded: drop the oldest turns that are over, with what is known of their events."""
        over = [event for event, turn in self._turns.items() if turn.phase is Phase.LEFT]
        for event in over[: max(0, len(self._turns) - EVENTS_KEPT)]:
            del self._turns[event]
            self.schedules.pop(event, None)

    def event_of(self, job: Job) -> bytes:
        """Return the event's six octets: program, assertion and finish arguments."""
        return stable_hash(f"{self._digest}/{job.assertion}/{job.event}", 6).to_bytes(6, "big")

    def finished(self, now: Instant, job: Job) -> None:
        """Handle a job that has ended: its turn is over."""
        turn = self._turns.get(self.event_of(job))
        if turn is None or turn.job is not job:
            return
        if turn.phase is Phase.INSIDE:
            self._inside(now, turn)
        elif turn.phase is not Phase.LEFT:
            turn.phase = Phase.LEFT
            if turn.requested:
                self._coordination.withdraw(now, turn.event)

    def serving(self, now: Instant, job: Job, action: int, args: Sequence[Value]) -> Turn | None:
        """Return the turn by which `action` goes, which serves `job`, which has not ended.

        A turn that has been used up without an end of the job, by an action that failed, is asked for again: else
        the next try would go while others have theirs.
        """
        turn = self._turns.get(self.event_of(job))
        if turn is None or turn.job is not job:
            return None
        if turn.phase is Phase.LEFT and self._needs_another(now, turn):
            self._ask_again(now, turn, job, turn.goal)
        if self._node.drives_to_area(action) and goal_of(self._node, job) is None:
            self._leads_to(now, turn, area_among(self._node, args))
        return turn

    def _leads_to(self, now: Instant, turn: Turn, goal: Area | None) -> None:
        """Take the goal from the action, where the job does not say it: the way may be another than was told."""
        if turn.goal == goal or turn.phase is Phase.INSIDE:
            return
        if turn.requested:
            self._ask_again(now, turn, turn.job, goal)
        turn.goal = goal

    def _needs_another(self, now: Instant, turn: Turn) -> bool:
        """Return whether the next try must wait for a turn: not where the robot has the bottleneck behind it."""
        if not turn.gated:
            return True
        estimate(self._node, now, turn)
        passes, turn.gated = turn.gated, True
        return passes

    @property
    def current(self) -> Turn | None:
        """The newest turn under way."""
        return next((turn for turn in reversed(self._turns.values()) if turn.phase is not Phase.LEFT), None)

    def entered_since(self, instant: Instant) -> bool:
        """Return whether a turn of this robot has begun after `instant`."""
        return any(turn.entered_at > instant for turn in self._turns.values())

    @property
    def hindered(self) -> bool:
        """Whether a slot has been of no use: the robot could not get to the gate."""
        return any(turn.hindered and turn.phase is not Phase.LEFT for turn in self._turns.values())

    @property
    def beyond(self) -> bool:
        """Whether the robot has the bottleneck behind it: there is no queue in which it should wait for its turn."""
        return any(turn.beyond for turn in self._turns.values())

    @property
    def rank(self) -> int:
        """The robot's place in the newest turn's schedule, 0 without one."""
        return next((turn.rank for turn in reversed(self._turns.values()) if turn.rank), 0)

    # -- asking ---------------------------------------------------------------------------------------------

    def _request(self, now: Instant, turn: Turn) -> None:
        if not estimate(self._node, now, turn):
            return
        turn.requested, turn.beyond = True, is_beyond(turn, self._node.driver)
        if self._needs_none(turn):
            turn.phase = Phase.LEFT
            return
        times = {"approach_s": turn.approach, "inside_s": turn.inside, "after_s": turn.after}
        self._node.trace(now, "asks", **{name: in_seconds(time) for name, time in times.items()}, way=turn.way)
        turn.release = max(turn.release, now + turn.approach)
        turn.revised_at = now
        self._coordination.trigger(now, request_of(turn))

    def _needs_none(self, turn: Turn) -> bool:
        """Return whether the robot is beyond the bottleneck that others of its event pass.

        It must not wait for a turn where those come out. As long as nobody is known to pass, the event is one of
        drives that exclude each other, and the robot takes its turn.
        """
        return turn.beyond and self._coordination.passes(turn.event)

    def _revise(self, now: Instant, turn: Turn) -> None:
        """Tell the leader when the robot's own estimate no longer fits its slot."""
        if not turn.gated or now - turn.revised_at < REVISE_EVERY:
            return
        turn.revised_at = now
        if finds_itself_within(self._node, turn):  # pushed in, or its turn was lost there: it has to get out
            self._ask_again(now, turn, turn.job, turn.goal)
            return
        estimate(self._node, now, turn)
        release, navigator = now + turn.approach, self._navigator
        if navigator is not None and turn.press(now, in_mouth(turn, navigator, self._node.percept().pose)):
            self._tell(now, turn)
        elif turn.phase is Phase.SLOTTED and release <= turn.start + READY:
            if turn.put_off(now):
                self._tell(now, turn)
        elif release > turn.release + REVISE_FROM:
            if turn.slide(now, release, self._node.percept().pose):
                turn.hinder(now)
            self._tell(now, turn)

    def _tell(self, now: Instant, turn: Turn) -> None:
        """Tell the leader when the robot will be at the gate, and what its order goes by."""
        self._coordination.revise(now, turn.event, release=turn.release, deadline=turn.deadline, underway=turn.underway)

    def _stands(self, now: Instant, event: bytes) -> None:
        """Bring the release up to date for a new leader: who has no slot is no nearer than when it asked."""
        turn = self._turns.get(event)
        if turn and turn.gated and turn.requested and turn.phase is Phase.ASKING and estimate(self._node, now, turn):
            turn.release = max(turn.release, now + turn.approach)
            self._coordination.revise(now, event, release=turn.release)

    # -- each call ------------------------------------------------------------------------------------------

    def step(self, now: Instant) -> None:
        """Advance every turn."""
        soonest = NEVER
        for turn in self._turns.values():
            phase = turn.phase
            if turn.bound is not None:
                keep_course(self._node, now, turn)
            if phase is Phase.LEFT:
                continue
            if phase is Phase.INSIDE:
                self._inside(now, turn)
            elif phase is Phase.ASKING and not turn.requested:
                self._request(now, turn)
            elif self._needs_none(turn):
                turn.phase = Phase.LEFT
                self._coordination.withdraw(now, turn.event)
            else:
                self._revise(now, turn)
                self._coordination.ready(now, turn.event, self._is_ready(turn))
            soonest = min(soonest, turn.next_wake)
        self.next_wake = max(soonest, self._node.executive.frame_ends) if soonest < NEVER else NEVER

    def _is_ready(self, turn: Turn) -> bool:
        action, navigator = turn.action, self._navigator
        if action is None or not turn.gated:
            return action is not None
        return action.started is not None and navigator is not None and navigator.reaches_gate(READY)

    def _inside(self, now: Instant, turn: Turn) -> None:
        driver = self._node.driver
        if not turn.gated or driver is None:
            if turn.job.finish is not None:
                self._leave(now, turn)
            elif turn.end < now + turn.notice:
                self._until(now, turn, now + UNKNOWN_INSIDE)
            return
        navigator = driver.navigator
        turn.passage = turn.passage or passage_of(navigator)
        starts = turn.within and turn.passage is None  # its action is still to begin
        if starts and finds_itself_within(self._node, turn, OFF_ROUTE_M):
            self._until(now, turn, now + UNKNOWN_INSIDE)
        elif gets_nowhere(now, turn, navigator):
            turn.hindered = HINDERED_MAX
            turn.hinder(now)
            self._ask_again(now, turn, turn.job, turn.goal)
        elif clear_of_bottleneck(turn, navigator, driver.localiser.pose):
            self._leave(now, turn)
        else:
            end = now + max(navigator.eta_clear(), EXTEND_BEFORE)
            if abs(end - turn.end) > REVISE_FROM:
                self._until(now, turn, end)

    def _until(self, now: Instant, turn: Turn, end: Instant) -> None:
        turn.end = end
        self._coordination.inside_until(now, turn.event, end)

    def _leave(self, now: Instant, turn: Turn) -> None:
        turn.phase = Phase.LEFT
        self._coordination.leave(now, turn.event)
        self._node.trace(now, "left", event=turn.job.event)

    def action_ended(self, now: Instant, turn: Turn) -> None:
        """Handle the end of an action that served `turn`; where several do, the last one ends it."""
        if turn.phase is Phase.INSIDE and not turn.gated and not turn.serving:
            self._leave(now, turn)

    # -- what the coordination core says ----------------------------------------------------------------------

    def handle(self, now: Instant, event: CoordEvent) -> None:
        """Take in one event of the coordination core."""
        match event:
            case PathReceived(way=way, path=path):
                self.leading.heard(event.event, way, path)
            case LeadershipBegan(term=term):
                self._node.trace(now, "leads", term=term)
                self.leading.leads(now, event.event, does=True)
                self._stands(now, event.event)
                if (turn := self._turns.get(event.event)) is not None:
                    self.leading.share(now, turn)
            case LeadershipEnded() | LeaderChanged():
                self.leading.leads(now, event.event, does=False)
                self._stands(now, event.event)
            case ScheduleChanged():
                keep(self.schedules, event.event, event)
                self._node.trace(now, "scheduled", leader=event.leader, term=event.term, order=list(event.order))
            case _:
                self._turn_event(now, event)

    def _turn_event(self, now: Instant, event: CoordEvent) -> None:
        turn = self._turns.get(event.event)
        if turn is None or turn.phase is Phase.LEFT:
            return
        self.next_wake = min(self.next_wake, self._node.executive.frame_ends)
        match event:
            case SlotAssigned():
                self._slotted(now, turn, event)
            case Entered(end=end, cautious=cautious):
                turn.phase, turn.entered_at, turn.end = Phase.INSIDE, now, end
                turn.passage = None if self._navigator is None else passage_of(self._navigator)
                self._open(turn, None, opened=True)
                self._node.trace(now, "entered", event=turn.job.event, cautious=cautious)
            case SlotLost() | EntryMissed():
                hindered = isinstance(event, EntryMissed) and turn.gated and not self._is_ready(turn)
                if hindered and (turn.go_on(now) if self._node.config.profile.late_goes_next else turn.hinder(now)):
                    self._tell(now, turn)
                turn.phase = Phase.ASKING
                turn.revised_at = 0
                self._open(turn, None, opened=False)
                self._node.trace(now, "slot_lost", event=turn.job.event, missed=isinstance(event, EntryMissed))

    def _slotted(self, now: Instant, turn: Turn, event: SlotAssigned) -> None:
        if turn.phase is Phase.INSIDE:
            return
        turn.phase, turn.start, turn.end = Phase.SLOTTED, event.start, event.end
        self._node.trace(now, "slotted", rank=event.rank, start_s=in_seconds(event.start), end_s=in_seconds(event.end))
        if (event.rank, event.place) != (turn.rank, turn.place):
            turn.rank, turn.place = event.rank, event.place
            rank_changed(self._node, now, turn)
        self._open(turn, event.start, opened=False)

    def _open(self, turn: Turn, opens_at: Instant | None, *, opened: bool) -> None:
        """Tell the navigator about the gate if it drives for `turn`."""
        driving, navigator = self._node.actions.driving, self._navigator
        if navigator is not None and driving is not None and driving.turn is turn:
            navigator.gate(opens_at, opened)

    def apply_gate(self, turn: Turn) -> None:
        """Tell a navigator that has just been given its way what `turn` allows."""
        if turn.phase in (Phase.INSIDE, Phase.LEFT):
            self._open(turn, None, opened=True)
        else:
            self._open(turn, turn.start if turn.phase is Phase.SLOTTED else None, opened=False)

    def name_of(self, event: bytes) -> Symbol | None:
        """Return the name of the assertion behind `event`."""
        turn = self._turns.get(event)
        return None if turn is None else Symbol(turn.job.name)
