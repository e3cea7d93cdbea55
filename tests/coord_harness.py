"""A discrete-event model of robots that coordinate over a faulty radio, with checkers.

Each robot is the real core; its motion is ideal (ready at its release, clear after its passage), its host
wakes it up to a tick late. Frames are lost, doubled, delayed and reordered by a seeded stream; robots crash,
restart, stall and are parted. Every entry is checked against the protocol's guarantees.
"""

import heapq
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from random import Random
from typing import Any

from schedule_bruteforce import follows

from rmr.base.direction import EXCLUSIVE
from rmr.base.time import NEVER, NS_PER_MS, Instant
from rmr.coord import events, messages
from rmr.coord.coordination import Coordination
from rmr.coord.events import JobRequest, Send
from rmr.coord.messages import Beacon, Job, Phase, Sched
from rmr.coord.states import Passage, Role
from rmr.coord.term import Term
from rmr.coord.timing import Timing

MS = NS_PER_MS
EVENT = b"corrid"
TICK = 16 * MS
decode = lru_cache(maxsize=256)(messages.decode)
"""For the checkers, which look at a frame once for each robot that hears it; the cores decode for themselves."""


def ms(value: float) -> int:
    """Return milliseconds as nanoseconds."""
    return int(value * MS)


@dataclass
class Entry:
    """One passage, as it truly was."""

    robot: int
    trigger: Instant
    direction: int
    start: Instant
    end: Instant
    slot: Instant
    rank: int
    term: tuple[int, int]
    cautious: bool
    heard: dict[int, Beacon]
    """What its robot had heard of the others as it entered."""
    announced: Instant
    """The end of the passage as the robot announced it last."""
    estimated: Instant
    """Its end by the estimate that the leader had when it gave the slot."""


@dataclass
class Air:
    """What the radio does to a frame."""

    loss: float = 0.0
    duplicate: float = 0.0
    late: float = 0.0
    late_max: int = ms(600)
    delay_min: int = ms(2)
    delay_max: int = ms(6)
    links: dict[tuple[int, int], float] = field(default_factory=dict)
    """Loss of single links, by (source, target), instead of `loss`."""
    slow: tuple[int, int] | None = None
    """A kind of frame, and by how much its frames are delayed at most."""
    echo: float = 0.0
    """Share of frames that arrive once more between `echo_min` and `echo_max` later."""
    echo_min: int = ms(500)
    echo_max: int = ms(30_000)
    filter: Callable[[int, int, bytes, Instant], bool] = lambda source, target, payload, now: True


class Mind:
    """One robot: the core and its ideal motion."""

    def __init__(self, model: "Model", robot: int) -> None:
        self.model = model
        self.robot = robot
        self.boot()
        self.alive = True
        self.stalled_until: Instant = 0
        self.job: JobRequest | None = None
        self.slot: events.SlotAssigned | None = None
        self.inside: Entry | None = None
        self.leaves: Instant = NEVER
        self.done: list[Instant] = []
        self.log: list[tuple[Instant, Any]] = []
        self.overrun = 0
        self.inbox: list[tuple[bytes, int]] = []
        self.heard: dict[int, Beacon] = {}
        """The newest CLAIM or IN of each other robot that this one's present life has taken in."""
        self.outcomes: list[tuple[int, str]] = []
        self.woken: Instant = NEVER

    def boot(self) -> None:
        model = self.model
        self.core = Coordination(
            self.robot, Random(f"{model.seed}/{self.robot}/{model.boots}"), len(model.ids) - 1, model.timing
        )
        model.boots += 1


class Model:
    """All robots, the air and the checkers."""

    def __init__(
        self, seed: int, count: int, air: Air | None = None, timing: Timing | None = None, capacity: int = 1
    ) -> None:
        """`capacity`: how many may be inside at a time; more than one: each job is a turn that excludes all others."""
        self.seed = seed
        self.capacity = capacity
        self.rng = Random(f"harness/{seed}")
        self.timing = timing or Timing()
        self.air = air or Air()
        self.ids = list(range(1, count + 1))
        self.boots = 0
        self.now: Instant = 0
        self.heap: list[tuple[Instant, int, Callable[[], None]]] = []
        self.sequence = 0
        self.parted: dict[int, int] = {}
        self.entries: list[Entry] = []
        self.violations: list[str] = []
        self.excused: list[str] = []
        """Overlaps that no protocol without a quorum can prevent."""
        self.overlaps: Counter[str] = Counter()
        """All overlaps, by term and by what the first had announced."""
        self.stalls: list[tuple[int, Instant]] = []
        self.restarts: list[tuple[int, Instant]] = []
        self.partitions: list[tuple[Instant, dict[int, int]]] = []
        self.frames = 0
        self.by_kind: dict[int, int] = {}
        self.senders: dict[tuple[int, int], int] = {}
        self.told: dict[int, tuple[Instant, Term]] = {}
        """When each robot last sent a JOB, which it does only while it waits, and the term that it followed then."""
        self.yielded: set[tuple[int, Instant]] = set()
        """Slots that their owners have said to give up, by robot and start."""
        self.promised: dict[tuple[tuple[int, int], int, Instant], Instant] = {}
        self.issued: dict[Term, Instant] = {}
        """When the newest schedule of a term that has been sent was issued."""
        self.minds = {robot: Mind(self, robot) for robot in self.ids}

    # -- driving ---------------------------------------------------------------------------------------

    def at(self, when: Instant, action: Callable[[], None]) -> None:
        self.sequence += 1
        heapq.heappush(self.heap, (when, self.sequence, action))

    def run(self, until: Instant) -> None:
        while self.heap and self.heap[0][0] <= until:
            self.now, _, action = heapq.heappop(self.heap)
            action()
        self.now = until

    def run_until(self, done: Callable[[], bool], limit: Instant) -> bool:
        while not done():
            if not self.heap or self.heap[0][0] > limit:
                return False
            self.now, _, action = heapq.heappop(self.heap)
            action()
        return True

    def trigger(
        self,
        when: Instant,
        robot: int,
        *,
        deadline: Instant,
        release: Instant = 0,
        duration: int = ms(3000),
        headway: int = ms(950),
        direction: int = 0,
        inside: bool = False,
    ) -> None:
        def start() -> None:
            mind = self.minds[robot]
            if not mind.alive:
                return
            if mind.inside is not None or self.now < mind.stalled_until:  # one job after the other
                self.at(max(self.now + ms(500), mind.stalled_until), start)
                return
            way = direction if self.capacity == 1 else EXCLUSIVE
            request = JobRequest(
                EVENT, self.now, max(release, self.now), duration, deadline, headway, way, inside,
                capacity=self.capacity,
            )  # fmt: skip
            mind.job = request
            mind.core.trigger(self.now, request)
            self.at(request.release, lambda: self._set_ready(mind, request))
            self.settle(mind)

        self.at(when, start)

    def _set_ready(self, mind: Mind, request: JobRequest) -> None:
        if mind.alive and mind.job is request:
            mind.core.ready(self.now, EVENT, True)
            self.settle(mind)

    def unready(self, when: Instant, robot: int, duration: int) -> None:
        """The robot is off its gate for a while."""

        def turn(ready: bool) -> None:
            mind = self.minds[robot]
            mind.core.ready(self.now, EVENT, ready)
            self.settle(mind)

        self.at(when, lambda: turn(False))
        self.at(when + duration, lambda: turn(True))

    def withdraw(self, when: Instant, robot: int) -> None:
        def stop() -> None:
            mind = self.minds[robot]
            if mind.alive and mind.job is not None and mind.inside is None:
                mind.job = None
                mind.core.withdraw(self.now, EVENT)
                self.settle(mind)

        self.at(when, stop)

    def crash(self, when: Instant, robot: int) -> None:
        self.at(when, lambda: self._die(self.minds[robot]))

    def _die(self, mind: Mind) -> None:
        mind.alive = False
        mind.job = None
        if mind.inside is not None:
            mind.inside.end = min(mind.inside.end, self.now)
            mind.inside = None

    def restart(self, when: Instant, robot: int) -> None:
        def rise() -> None:
            mind = self.minds[robot]
            self._die(mind)  # two faults may overlap: it may have been restarted already
            mind.alive = True
            mind.inbox, mind.outcomes, mind.heard, mind.slot = [], [], {}, None
            mind.boot()
            self.restarts.append((robot, self.now))
            # A leader that begins anew counts its terms from 1 again, and knows none of the slots that it has frozen.
            self.promised = {key: start for key, start in self.promised.items() if key[0][1] != robot}

        self.at(when, rise)

    def stall(self, when: Instant, robot: int, duration: int) -> None:
        def freeze() -> None:
            mind = self.minds[robot]
            mind.stalled_until = self.now + duration
            mind.woken = NEVER
            self.stalls.append((robot, mind.stalled_until))
            if mind.inside is not None:  # its body stands where it is
                mind.inside.end = max(mind.inside.end, mind.stalled_until)
            self.at(mind.stalled_until, lambda: self.tick(mind))

        self.at(when, freeze)

    def forge(self, when: Instant, source: int, payload: Callable[[Instant], bytes]) -> None:
        """Everybody hears a frame that `source` has not sent."""

        def send() -> None:
            octets = payload(self.now)
            for target in self.ids:
                if target != source:
                    self._arrive(target, octets, source)

        self.at(when, send)

    def partition(self, when: Instant, groups: dict[int, int]) -> None:
        def part() -> None:
            self.parted = groups
            self.partitions.append((self.now, groups))

        self.at(when, part)

    # -- hosts and air ---------------------------------------------------------------------------------

    def settle(self, mind: Mind) -> None:
        """Take what the core has to say and arrange for its next wake."""
        for item in mind.core.drain():
            if isinstance(item, Send):
                self._sent(mind, item)
            else:
                self._happened(mind, item)
        wake = mind.core.next_wake
        if wake < NEVER:
            self.wake_at(mind, max(wake, self.now))

    def wake_at(self, mind: Mind, when: Instant) -> None:
        """Hosts wake on a grid of ticks."""
        when = max(-(-when // TICK) * TICK, mind.stalled_until)
        if when < mind.woken or mind.woken <= self.now:
            mind.woken = when
            self.at(when, lambda: self.tick(mind) if mind.woken == when else None)

    def tick(self, mind: Mind) -> None:
        if not mind.alive or self.now < mind.stalled_until:
            return
        mind.woken = NEVER
        inbox, mind.inbox = mind.inbox, []
        for payload, source in inbox:
            self._take_in(mind, payload)
            mind.core.receive(self.now, payload, source)
            self.drain_now(mind)
        outcomes, mind.outcomes = mind.outcomes, []
        for handle, status in outcomes:
            mind.core.confirmed(self.now, handle, status)
        mind.core.wake(self.now)
        if self.now >= mind.leaves:
            self._leave(mind)
        self.settle(mind)

    def _take_in(self, mind: Mind, payload: bytes) -> None:
        """Remember what `mind` has heard of others that claim or are inside."""
        beacon = decode(payload, self.timing.payload_max)
        if isinstance(beacon, Beacon) and beacon.phase in (Phase.CLAIM, Phase.IN):
            known = mind.heard.get(beacon.who)
            if known is None or (beacon.trigger, beacon.time) > (known.trigger, known.time):
                mind.heard[beacon.who] = beacon

    def drain_now(self, mind: Mind) -> None:
        for item in mind.core.drain():
            if isinstance(item, Send):
                self._sent(mind, item)
            else:
                self._happened(mind, item)

    def _sent(self, mind: Mind, item: Send) -> None:
        assert item.at >= self.now
        if len(item.payload) > self.timing.payload_max:
            self.violations.append(f"a frame of {len(item.payload)} octets")
        self.at(item.at, lambda: self._transmit(mind, item))

    def _transmit(self, mind: Mind, item: Send) -> None:
        if not mind.alive:
            return
        self.frames += 1
        self.by_kind[item.payload[0]] = self.by_kind.get(item.payload[0], 0) + 1
        self._check_frame(mind, item.payload)
        targets = self.ids if item.destination is None else [item.destination]
        delivered = False
        for target in targets:
            if target != mind.robot and target in self.minds:
                delivered = self._carry(mind.robot, target, item.payload, item.destination is not None) or delivered
        if item.destination is not None:
            status = "ok" if delivered else "no_ack"
            self.at(self.now + ms(8), lambda: self._outcome(mind, item.handle, status))

    def _outcome(self, mind: Mind, handle: int, status: str) -> None:
        if mind.alive:
            mind.outcomes.append((handle, status))
            self.wake_at(mind, self.now)

    def linked(self, a: int, b: int) -> bool:
        return self.parted.get(a, 0) == self.parted.get(b, 0)

    def _carry(self, source: int, target: int, payload: bytes, unicast: bool) -> bool:
        air, rng = self.air, self.rng
        if not self.linked(source, target) or not self.minds[target].alive:
            return False
        tries = 4 if unicast else 1
        if not air.filter(source, target, payload, self.now):
            return False
        loss = air.links.get((source, target), air.loss)
        got = any(rng.random() >= loss for _ in range(tries))
        if not got:
            return False
        copies = 2 if rng.random() < air.duplicate else 1
        for _ in range(copies):
            delay = rng.randint(air.delay_min, air.delay_max)
            if rng.random() < air.late:
                delay += rng.randint(0, air.late_max)
            if air.slow is not None and payload[0] == air.slow[0]:
                delay += rng.randint(0, air.slow[1])
            self.at(self.now + delay, lambda: self._arrive(target, payload, source))
        if air.echo and rng.random() < air.echo:
            self.at(self.now + rng.randint(air.echo_min, air.echo_max), lambda: self._arrive(target, payload, source))
        return not (unicast and rng.random() < air.links.get((target, source), air.loss) ** 4)

    def _arrive(self, target: int, payload: bytes, source: int) -> None:
        mind = self.minds[target]
        if mind.alive:
            if len(mind.inbox) < 200:
                mind.inbox.append((payload, source))
            self.wake_at(mind, self.now)

    # -- what happened, and whether it was right ---------------------------------------------------------

    def _happened(self, mind: Mind, event: Any) -> None:
        mind.log.append((self.now, event))
        if isinstance(event, events.SlotAssigned):
            mind.slot = event
        elif isinstance(event, events.SlotLost | events.EntryMissed):
            mind.slot = None
        elif isinstance(event, events.Entered):
            self._entered(mind, event)

    def _entered(self, mind: Mind, event: events.Entered) -> None:
        job, slot = mind.job, mind.slot
        assert job is not None
        if job.inside:  # without a slot and of no term
            slot = events.SlotAssigned(EVENT, job.trigger, 0, 0, self.now, self.now, mind.robot, -1)
        if slot is None or not slot.start <= self.now <= slot.start + self.timing.schedule.window:
            self.violations.append(f"{mind.robot} entered outside its slot at {self.now / MS}")
            return
        entry = Entry(
            mind.robot, job.trigger, job.direction, self.now, self.now + job.duration + mind.overrun,
            slot.start, slot.rank, (slot.term, slot.leader), event.cautious, dict(mind.heard),
            self.now + job.duration + mind.overrun, self.now + job.duration,
        )  # fmt: skip
        if any(e.robot == mind.robot and e.trigger == job.trigger for e in self.entries):
            self.violations.append(f"{mind.robot} entered twice for one job")
        inside = [other for other in self.entries if other.start <= self.now < other.end and other.robot != mind.robot]
        if self.capacity > 1:
            self._overfull(entry, inside)
        else:
            for other in inside:
                if not follows(other.direction, entry.direction):
                    self._overlap(entry, other)
        self.entries.append(entry)
        mind.inside = entry
        mind.leaves = entry.end
        if mind.overrun:
            mind.core.inside_until(self.now, EVENT, entry.end)
        self.at(entry.end, lambda: self.wake_at(mind, self.now))

    def _overlap(self, entry: Entry, other: Entry) -> None:
        """Two opposed robots are inside: wrong under one term, or if the later one had heard of the first."""
        self.overlaps[self._kind_of_overlap(entry, other)] += 1
        if not entry.cautious:
            text = f"{entry.robot} and {other.robot} overlap at {self.now / MS}"
            why = self._why_wrong(entry, other)
            (self.violations if why else self.excused).append(text + why)

    def _overfull(self, entry: Entry, inside: list[Entry]) -> None:
        """As many are `inside` as may be: wrong if that holds of those alone whom the later one had to count."""
        if len(inside) < self.capacity:
            return
        # Of several the one that the later robot could not know of: without it there would have been a place.
        unknown = [other for other in inside if not self._why_wrong(entry, other)]
        self.overlaps[self._kind_of_overlap(entry, (unknown or inside)[0])] += 1
        if entry.cautious:
            return
        wrong = [why for other in inside if (why := self._why_wrong(entry, other))]
        text = f"{entry.robot} is inside with {[other.robot for other in inside]} at {self.now / MS}"
        if len(wrong) >= self.capacity:
            self.violations.append(text + wrong[0])
        else:
            self.excused.append(text)

    def _why_wrong(self, entry: Entry, other: Entry) -> str:
        """Return why `entry` should not have begun while `other` is inside; empty if nobody could have known."""
        since = self.now - self.timing.claim.quiet - self.timing.claim.beacon
        as_estimated = self.now < other.estimated
        if (
            entry.term == other.term
            and as_estimated
            and not self.forgot(entry.term[1], other.start - self.timing.schedule.lease)
        ):
            return " under one term"
        if self._has_heard(entry.robot, other) and not self.stalled_after(entry.robot, since):
            return " though one had heard the other"
        if self._hear_each_other(entry.robot, other.robot, since):
            return " though nothing but chance kept them from hearing each other"
        return ""

    def _kind_of_overlap(self, entry: Entry, other: Entry) -> str:
        """Return under which terms, and within which promises, `entry` begins while `other` is inside."""
        if entry.term != other.term:
            terms = "two terms"
        elif self.forgot(entry.term[1], other.start - self.timing.schedule.lease):
            terms = "one term, leader restarted"
        else:
            terms = "one term"
        way = "as announced" if self.now < other.estimated else "beyond its estimate"
        way = way if self.now < other.announced else "overdue"
        return f"{terms}, {'with caution' if entry.cautious else way}"

    def _hear_each_other(self, robot: int, other: int, since: Instant) -> bool:
        """Whether both have been awake and linked since `since`, by links that are as good in both directions."""
        even = not self.air.links and self.air.slow is None
        return (
            even
            and self.linked_since(robot, other, since)
            and not any(self.stalled_after(each, since) for each in (robot, other))
        )

    def _has_heard(self, robot: int, other: Entry) -> bool:
        """Whether `robot` has heard that `other` claims its slot or is inside, and that no longer ago than silence
        counts."""
        beacon = self.minds[robot].heard.get(other.robot)
        if beacon is None or self.now >= beacon.time + self.timing.liveness.gone:
            return False
        return (beacon.phase is Phase.IN and beacon.start >= other.start - MS) or (
            beacon.phase is Phase.CLAIM and beacon.start == other.slot
        )

    def forgot(self, robot: int, since: Instant) -> bool:
        """Whether `robot` lost its memory after `since`."""
        return any(when >= since for who, when in self.restarts if who == robot)

    def stalled_after(self, robot: int, since: Instant) -> bool:
        """Whether `robot` stood still at some time after `since`."""
        return any(who == robot and end > since for who, end in self.stalls)

    def linked_since(self, a: int, b: int, since: Instant) -> bool:
        """Whether the two have been in one part of the network since `since`."""
        before = [groups for when, groups in self.partitions if when <= since][-1:]
        all_since = before + [groups for when, groups in self.partitions if when > since]
        return all(groups.get(a, 0) == groups.get(b, 0) for groups in all_since)

    def _leave(self, mind: Mind) -> None:
        mind.leaves = NEVER
        if mind.inside is None:
            return
        mind.done.append(self.now)
        mind.inside.end = self.now
        mind.inside, mind.job, mind.slot = None, None, None
        mind.core.leave(self.now, EVENT)

    def _check_frame(self, mind: Mind, payload: bytes) -> None:
        message = decode(payload, self.timing.payload_max)
        if isinstance(message, Sched) and message.term.leader == mind.robot:
            known = self.senders.setdefault(message.term, id(mind.core))
            if known != id(mind.core) and not self.forgot(mind.robot, 0):
                self.violations.append(f"term {message.term} has two senders")
            self._check_frozen(message)
        if isinstance(message, Job):
            self.told[mind.robot] = message.time, message.term
        if isinstance(message, Beacon) and message.who == mind.robot and message.phase is Phase.YIELD:
            self.yielded.add((message.who, message.start))
        if isinstance(message, Beacon) and message.who == mind.robot and message.phase is Phase.IN:
            inside = mind.inside is not None or (mind.done and message.time <= mind.done[-1])
            if not inside and not self.forgot(mind.robot, message.time):
                self.violations.append(f"{mind.robot} says IN but is not at {self.now / MS}")

    def _check_frozen(self, sched: Sched) -> None:
        """A frozen slot must not move unless its owner let it pass or it is long over."""
        newest = self.issued.get(sched.term, -NEVER)
        if sched.issued < newest:  # an answer that left after the next version: no robot takes it for newer
            return
        self.issued[sched.term] = sched.issued
        for entry in sched.entries:
            key = (sched.term, entry.robot, entry.trigger)
            promised = self.promised.get(key)
            if promised is not None and entry.phase is Phase.WAITING and entry.start != promised:
                log = self.minds[entry.robot].log if entry.robot in self.minds else []
                told, followed = self.told.get(entry.robot, (-NEVER, sched.term))
                # A slot ends with the term that it is of: an owner that waits under another one has none.
                waits = told > promised + (0 if followed != sched.term else self.timing.schedule.window)
                let_pass = (
                    waits
                    or (entry.robot, promised) in self.yielded
                    or any(
                        isinstance(e, events.EntryMissed | events.SlotLost) and t >= promised - ms(1200) for t, e in log
                    )
                )
                over = sched.issued >= promised + entry.duration + self.timing.schedule.window
                if not let_pass and not over and not self.stalled_after(entry.robot, 0):
                    self.violations.append(f"frozen slot of {entry.robot} moved at {self.now / MS}")
                del self.promised[key]
            if entry.start is not None and entry.start <= sched.issued + self.timing.schedule.frozen:
                self.promised[key] = entry.start

    # -- questions ---------------------------------------------------------------------------------------

    def role(self, robot: int) -> Role:
        group = self.minds[robot].core._groups.get(EVENT)
        return Role.NONE if group is None else group.context.role

    def leaders(self) -> list[int]:
        return [r for r in self.ids if self.minds[r].alive and self.role(r) is Role.LEADING]

    def all_slotted(self) -> bool:
        """Whether every robot with a job holds a slot of one leader."""
        slots = [m.slot for m in self.minds.values() if m.job is not None and m.alive]
        return all(slots) and len({(s.leader, s.term) for s in slots if s}) == 1

    def all_served(self) -> bool:
        """Whether no living robot has a job left."""
        return all(m.job is None for m in self.minds.values() if m.alive)

    def order(self) -> list[int]:
        """Robots in the order of their entries."""
        return [entry.robot for entry in self.entries]

    def passage(self, robot: int) -> Passage:
        return self.minds[robot].core._groups[EVENT].context.passage
