"""Shared state of one group's machine: roles, timers, and the outbox.

The parts (follower, leader, passage) are functions over this one value; the group hands it from one to the
next. Everything a robot remembers of a group stands here, so that any state is readable at any moment.
"""

from collections.abc import Callable
from enum import IntEnum
from random import Random

from rmr.base.grid_path import GridPath
from rmr.base.time import NEVER, Duration, Instant
from rmr.coord.events import CoordEvent, JobRequest, ScheduleChanged, Send
from rmr.coord.fence import Fence
from rmr.coord.known_schedule import KnownSchedule
from rmr.coord.ledger import Ledger
from rmr.coord.messages import Job, Message, encode, entries_max, on_grid
from rmr.coord.states import Passage, Role, check_passage, check_role
from rmr.coord.term import NO_TERM, NOBODY, Term, newer
from rmr.coord.timing import GRID, MS, OUTPUT_MAX, Timing


class Timer(IntEnum):
    """The timers of one machine, in the order in which equal ones run."""

    POLL = 0
    """Claim, enter, or let the window pass."""
    BEACON = 1
    ASK = 2
    JOIN = 3
    SUSPECT = 4
    RELAY = 5
    WITNESS = 6
    OPEN = 7
    PLAN = 8
    ISSUE = 9


class Outbox:
    """Frames and events of all events of one robot, waiting to be drained."""

    def __init__(self) -> None:
        self.items: list[Send | CoordEvent] = []
        self.handle = 0
        self.owners: dict[int, bytes] = {}
        """Event of each unicast whose outcome is awaited."""

    def put(self, item: "Send | CoordEvent") -> None:
        """Queue `item`; the oldest is dropped if the host does not drain the queue."""
        if len(self.items) >= OUTPUT_MAX:
            del self.items[0]
        self.items.append(item)


class OwnJob:
    """This robot's live job."""

    __slots__ = (
        "absent",
        "announced",
        "assured",
        "claimed",
        "entered",
        "lease",
        "missed",
        "ready",
        "request",
        "since",
        "slot",
        "told",
        "trigger",
        "until",
    )

    def __init__(self, request: JobRequest, trigger: Instant) -> None:
        self.request = request
        self.trigger = trigger
        """On the grid and unique; the job's identity in frames."""
        self.slot: tuple[Instant, Instant, int] | None = None
        """Start, end, rank."""
        self.lease: Instant = 0
        """Entering under the slot is allowed before this."""
        self.announced: tuple[Instant, Instant, int, int, Term] | None = None
        self.missed: Instant | None = None
        self.assured: Instant = -NEVER
        """Until then no other robot of the roster can claim or be inside: all have said that they are candidates."""
        self.ready = False
        self.absent = 0
        """Slots in a row missed because the robot was not ready; 0 again as soon as it is."""
        self.claimed: Instant | None = None
        """Start of the slot that claims were sent for."""
        self.since: Instant = 0
        """Claiming and awake since."""
        self.entered: Instant = 0
        self.until: Instant = 0
        self.told: tuple[Instant, Duration] = (request.release, request.duration)
        """Release and duration as last reported to the leader."""


class Context:
    """The state of one event's machine."""

    def __init__(
        self, group_id: bytes, robot: int, rng: Random, peers: Callable[[], int], timing: Timing, outbox: Outbox
    ) -> None:
        self.group_id = group_id
        self.robot = robot
        self.rng = rng
        self.peers = peers
        self.timing = timing
        self.outbox = outbox
        self.role = Role.NONE
        self.passage = Passage.OUT
        self.job: OwnJob | None = None
        self.next_job: JobRequest | None = None
        """Triggered while inside; begins on leaving."""
        self.fence = Fence(robot, timing)
        self.held = KnownSchedule(entries_max(timing.payload_max))
        self.counter = 0
        """Newest counter of a term heard of; 0: none."""
        self.ledger: Ledger | None = None
        """Of a leader."""
        self.led = NO_TERM
        """The last term that this robot led itself."""
        self.awake: Instant = 0
        """The last input."""
        self.company = False
        """A frame of another robot has been heard."""

        self.asked: Instant | None = None
        self.asks = 0
        self.candidate = NOBODY
        """The earlier asker that goes first."""
        self.candidates: dict[int, Job] = {}
        """Jobs of other askers, for the ledger should this robot lead."""
        self.bans: dict[int, Instant] = {}
        self.no_acks = 0
        self.joins = 0
        """JOBs sent or due for what the leader does not list."""
        self.untold = False
        """The own job has not been sent to the leader that is followed."""
        self.relayed: Instant = -NEVER
        self.answered: Instant = -NEVER
        self.reminded: Instant = -NEVER
        self.witnessed: int | None = None

        self.last_issued: Instant = -NEVER
        self.extras = 0
        self.idle_since: Instant | None = None
        self.paths: dict[int, tuple[Instant, GridPath]] = {}
        """As leader: the path offered for each direction and when."""
        self.paths_due = False
        """Somebody has joined and may lack them."""
        self.path_parts: dict[int, tuple[Instant, dict[int, tuple[int, ...]]]] = {}
        self.paths_known: dict[int, Instant] = {}

        self.timers = [NEVER] * len(Timer)
        self.next_wake: Instant = NEVER

    def set(self, timer: Timer, at: Instant) -> None:
        """Set `timer`; NEVER stops it."""
        self.timers[timer] = at
        self.next_wake = min(self.timers)

    def sooner(self, timer: Timer, at: Instant) -> None:
        """Set `timer` unless it runs out earlier."""
        if at < self.timers[timer]:
            self.set(timer, at)

    def uniform(self, low: Duration, high: Duration) -> Duration:
        """Return a duration drawn from [low, high)."""
        return low + int(self.rng.random() * (high - low))

    def spread(self, answers: int, least: Duration = 0) -> Duration:
        """Return a random wait before an answer to a broadcast that `answers` robots may give.

        Where few answer, waits reach up to `least`; where many do, as far as their answers need.
        """
        timing = self.timing
        return self.uniform(
            0, max(least, timing.election.reply_spread * min(max(answers, 1), timing.election.answers_max))
        )

    @property
    def alone(self) -> bool:
        """Whether the roster names no other robot and none has been heard."""
        return self.peers() == 0 and not self.company

    def undisputed(self, now: Instant) -> bool:
        """Return whether no other robot can claim or be inside, so that entry needs no claim."""
        return self.alone or (self.job is not None and now < self.job.assured)

    def quiet(self, now: Instant) -> Duration:
        """Return how long to claim before entering."""
        return 0 if self.undisputed(now) else self.timing.claim.quiet

    def unlisted(self) -> int:
        """Return how many robots, this one included, may have a job that the schedule held does not list."""
        return self.peers() + 1 - self.held.listed

    def hear_of(self, counter: int) -> None:
        """Take note of a term's counter: the next term of this robot follows the newest one."""
        if newer(counter, self.counter):
            self.counter = counter

    def become(self, role: Role) -> None:
        """Change the role."""
        if role is not self.role:
            check_role(self.role, role)
            self.role = role

    def proceed(self, passage: Passage) -> None:
        """Change the phase of the own job."""
        if passage is not self.passage:
            check_passage(self.passage, passage)
            self.passage = passage

    def send(self, message: Message, at: Instant, destination: int | None = None) -> None:
        """Send a frame at `at` or a little later (all robots tick on one grid)."""
        self.send_raw(encode(message), at, destination)

    def send_raw(self, payload: bytes, at: Instant, destination: int | None = None) -> None:
        """Send encoded octets likewise."""
        box = self.outbox
        handle = 0
        if destination is not None:
            box.handle = handle = box.handle % 0xFFFF + 1
            box.owners[handle] = self.group_id
        box.put(Send(payload, destination, handle, at + self.uniform(0, self.timing.dither)))

    def emit(self, event: CoordEvent) -> None:
        """Report what has happened."""
        self.outbox.put(event)

    def fresh(self, now: Instant) -> bool:
        """Return whether the schedule held is still valid for some robot."""
        return now < self.held.issued + self.timing.schedule.lease + 2 * self.timing.clock_error

    def banned(self, leader: int, now: Instant) -> bool:
        """Return whether `leader` is avoided."""
        return now < self.bans.get(leader, -NEVER)

    def job_frame(self, now: Instant, term: Term) -> Job:
        """Return the JOB frame of the own job."""
        job = self.job
        assert job is not None
        request = job.request
        job.told = (request.release, request.duration)
        asked = now if self.asked is None else self.asked
        return Job(
            self.group_id,
            now,
            term,
            asked,
            job.trigger,
            request.release,
            request.duration,
            request.deadline,
            request.headway,
            request.direction,
            job.missed,
            request.underway,
            job.absent,
        )

    def report_order(self) -> None:
        """Report the order of the schedule held when it is another than before."""
        held = self.held
        order = held.dated()
        if not order or (held.order and held.order[-len(order) :] == order):
            return
        held.order = order
        held.formed = held.issued
        self.emit(ScheduleChanged(self.group_id, held.term.leader, held.term.counter, order, held.formed))


def stamp(now: Instant) -> Instant:
    """Return `now` as frames carry it, in whole milliseconds."""
    return now - now % MS


def identity(trigger: Instant, previous: Instant) -> Instant:
    """Return a trigger on the grid that is greater than `previous`."""
    return max(on_grid(trigger), on_grid(previous) + GRID)
