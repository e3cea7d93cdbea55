"""Makes the history of a robot from a replay of its minds: the provenance log, and a look at the node after each call.

The node's configuration needs the listener's `log` as provenance log, and a witness, of whatever kind: without one a
node does not tell which frames it hands to its radio. The listener changes nothing in the node.
"""

from bisect import bisect_right
from typing import Any, Protocol

from rmr.base.geometry import Pose, hypot
from rmr.base.time import FRAME, NEVER, Instant
from rmr.bytecode.program import Program
from rmr.node.actions.dispatcher import Dispatcher
from rmr.node.config import NodeConfig
from rmr.node.crossing.crossing import Crossing
from rmr.node.crossing.crossing_table import gate_of
from rmr.node.crossing.crossings import Crossings
from rmr.node.crossing.phases import Preparing
from rmr.node.driver import Driver
from rmr.node.motion.hindrance import Hindrance
from rmr.node.motion.localiser import MISTAKEN_M
from rmr.node.peers.perception import Peers
from rmr.node.services import RobotServices
from rmr.node.standstill import Motion, MotionState, motion_state
from rmr.node.trace import Trace
from rmr.vm.machine_events import JobFinished, JobMissed, JobStarted
from rmr.vm.provenance import ActionRecord, ProvenanceLog, ToldRecord
from rmr.why.mind_index import MindIndex
from rmr.why.past_items import PastAction, TurnGate
from rmr.why.robot_history import LostDelivery, PassageSpan, RobotHistory


class WatchedNode(Protocol):
    """What the listener looks at: `rmr.node.node.Node`."""

    config: NodeConfig
    next_wake: Instant
    driver: Driver | None
    peers: Peers
    notes: Trace
    actions: Dispatcher
    crossings: Crossings
    services: RobotServices


class TruePlaces:
    """Where a robot really was, ten times a second while any robot moves."""

    def __init__(self) -> None:
        self._at: list[Instant] = []
        self._places: list[tuple[float, float]] = []

    def add(self, at: Instant, x: float, y: float) -> None:
        """Add a place; instants ascend."""
        self._at.append(at)
        self._places.append((x, y))

    def off_m(self, at: Instant, pose: Pose) -> float:
        """Return how far `pose` is from the nearer of the places before and after `at`, metres; 0 without any."""
        after = bisect_right(self._at, at)
        around = self._places[max(0, after - 1) : after + 1]
        return min([hypot(pose.x - x, pose.y - y) for x, y in around], default=0.0)


class HistoryListener:
    """Builds the history of one robot.

    Call `begin` before a node of the robot is made, `born` after its start, `called` after each tick, `touched` after
    any other call, and `died` when its process ends; `ended` at the end of the run.
    """

    def __init__(self, robot: int, program: Program, truth: TruePlaces | None = None) -> None:
        """`truth`: where the robot was, if the recording tells."""
        self._truth = truth
        self.history = RobotHistory(robot)
        self._robot = robot
        self._program = program
        self.begin()

    def begin(self) -> None:
        """Begin with a new incarnation: its node writes the `log` that stands here from now on."""
        self.log = ProvenanceLog()
        self._due: Instant = NEVER
        self._called: Instant = 0
        self._sets_out: Instant | None = None
        self._last_entry: dict[str, Any] | None = None
        self._groups: dict[str, bytes] = {}
        """What the trace calls a resource -> those that contend for it."""
        self._inside: dict[str, tuple[bytes, Instant]] = {}

    @property
    def _mind(self) -> MindIndex:
        """The present incarnation."""
        return self.history.minds[-1]

    # -- the life of a process --------------------------------------------------------------------------------

    def born(self, node: WatchedNode, now: Instant) -> None:
        """Note that a process of the robot has begun, and its node was started."""
        minds = self.history.minds
        before = minds[-1] if minds else None
        minds.append(MindIndex(self._robot, node.config.epoch, self._program, now, before))
        self.called(node, now)

    def died(self, now: Instant, *, stopped: bool = False) -> None:
        """Note that the process has ended, perhaps because it was `stopped` in order."""
        self._mind.died = now
        self._mind.stopped = stopped
        self.history.motion.append((now, MotionState(Motion.IDLE)))
        for group in list(self._inside):
            self._leave(group, now)

    def ended(self, now: Instant) -> None:
        """Note that the run is over."""
        self.history.ends = now
        for group in list(self._inside):
            self._leave(group, NEVER)

    # -- after each call --------------------------------------------------------------------------------------

    def touched(self, node: WatchedNode) -> None:
        """Take in a call that was none of the executive: a frame overheard, a fact inserted."""
        self._take_records(node)
        self._due = node.next_wake

    def called(self, node: WatchedNode, now: Instant) -> None:
        """Look at the node after a call at `now`."""
        history = self.history
        history.ends = max(history.ends, now)
        due = max(self._due, self._called)
        if due < NEVER and now - due > FRAME:  # later than it was due by more than a frame
            history.late.append((due, now))
        self._called = now
        self._due = node.next_wake
        self._take_records(node)
        self._take_notes(node, now)
        self._take_waits(node, now)
        drive = node.actions.driving
        since = None if drive is None else drive.started
        state = motion_state(now, node.driver, node.peers, self._robot, node.config.roster, since)
        self._take_motion(now, self._mistaken(now, node, state))

    def _mistaken(self, now: Instant, node: WatchedNode, state: MotionState | None) -> MotionState | None:
        """Return what the wheels do: of a robot on its way that is mistaken about its position, that it is so."""
        pose = None if node.driver is None else node.driver.localiser.pose
        if self._truth is None or pose is None or state is None or state.motion is Motion.IDLE:
            return state
        off_m = self._truth.off_m(now, pose)
        if off_m <= MISTAKEN_M:
            return state
        return MotionState(Motion.LOCATES, Hindrance("", place=f"its estimate was {off_m:.1f} m off"))

    def _take_motion(self, now: Instant, state: MotionState | None) -> None:
        """Take in what the wheels do. Between a drive's beginning and its first frame they do what that frame finds."""
        states = self.history.motion
        idle = not states or states[-1][1].motion is Motion.IDLE
        if state is None:
            self._sets_out = now if idle and self._sets_out is None else self._sets_out
            return
        if not states or states[-1][1] != state:
            states.append((now if self._sets_out is None else self._sets_out, state))
        self._sets_out = None

    def _take_notes(self, node: WatchedNode, now: Instant) -> None:
        """Take in the new entries of the trace."""
        entries = node.notes.entries
        first = len(entries)
        while first > 0 and entries[first - 1] is not self._last_entry:
            first -= 1
        for entry in entries[first:]:
            if entry["what"] == "entered":
                self._leave(entry["event"], now)
                self._inside[entry["event"]] = self._group(entry["event"], node), now
            elif entry["what"] in ("left", "slot_lost", "withdrawn"):
                self._leave(entry["event"], now)
            elif entry["what"] == "undelivered":
                lost = LostDelivery(now, self._robot, entry["destination"], entry["fact"], entry["why"])
                self.history.undelivered.append(lost)
        if entries:
            self._last_entry = entries[-1]

    def _group(self, told: str, node: WatchedNode) -> bytes:
        """Return the group of a resource of which the trace tells, that of an event, a station or a passage."""
        groups = [crossing.group_id for crossing in node.crossings.all_current if crossing.told == told]
        return groups[-1] if groups else self._groups.get(told, told.encode())

    def _leave(self, told: str, now: Instant) -> None:
        if told in self._inside:
            self.history.passages.append(PassageSpan(*self._inside.pop(told), now))

    def _take_waits(self, node: WatchedNode, now: Instant) -> None:
        """Note which actions wait, and for what."""
        for waiting, what in ((node.actions.held, "held"), (node.actions.queue, "queued"), (node.actions.running, "")):
            for running in waiting:
                action = self._mind.actions.get(running.serial)
                if action is None or action.executor != self._robot:
                    continue
                action.job, action.due = running.job, running.due
                crossing = gate_of(running)
                if crossing is not None:
                    self._take_gate(now, action, crossing)
                if what and (not action.waits or action.waits[-1][1] != what):
                    action.waits.append((now, what))

    def _take_gate(self, now: Instant, action: PastAction, crossing: Crossing) -> None:
        """Note by which turn an action goes now, if it is another one than before."""
        self._groups[crossing.told] = crossing.group_id
        gate = TurnGate(now, crossing.group_id, not isinstance(crossing.phase, Preparing))
        if not action.gates or action.gates[-1][1:] != gate[1:]:
            action.gates.append(gate)

    def _take_records(self, node: WatchedNode) -> None:
        """Take in the new records of the provenance log."""
        mind = self._mind
        for record in self.log.records:
            mind.take(record)
            if isinstance(record, ActionRecord) and record.executor == self._robot:
                if node.services.handler(self._program.predicates[record.predicate].name).wheels:
                    mind.wheels.add(record.predicate)
            elif isinstance(record, ToldRecord) and isinstance(record.event, JobStarted | JobFinished | JobMissed):
                job = record.event.job
                self._groups[job.event] = node.crossings.group_of(job)
        self.log.records.clear()
