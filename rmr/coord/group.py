"""One event's machine: it hands each input to the role or phase that it concerns.

Inputs are a trigger, a frame, the outcome of a unicast, the robot's own news (ready, inside until, left,
withdrawn) and the passing of time; the table of inputs is `_TIMERS` for time and `receive` for frames. Before
any input a leader that has issued nothing for a lease stops leading: it must have been stopped itself.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from rmr.base.grid_path import GridPath
from rmr.base.time import NEVER, Duration, Instant
from rmr.coord import follower, leader, passage
from rmr.coord.context import Context, Timer, stamp
from rmr.coord.events import JobRequest, LeaderChanged, PathReceived
from rmr.coord.messages import Beacon, Job, Message, PathPart, Phase, Sched
from rmr.coord.states import Passage, Role
from rmr.coord.term import NOBODY, newer

_PATHS_MAX: Final = 16


class Group:
    """The machine of one event on one robot."""

    def __init__(self, context: Context) -> None:
        self.context = context

    @property
    def next_wake(self) -> Instant:
        """When `wake` is due."""
        return self.context.next_wake

    # -- the robot's own news --------------------------------------------------------------------------

    def trigger(self, now: Instant, request: JobRequest) -> None:
        """A job starts."""
        c = self.context
        self._begin_input(now)
        if c.passage is Passage.INSIDE:
            c.next_job = request
            return
        passage.begin(c, request)
        if request.inside:
            passage.enter(c, now, cautious=True)
        if c.role is Role.LEADING:
            leader.own_job_changed(c, now)
        elif request.inside:
            c.awake = now  # it is inside and needs no slot: no election
        elif c.fresh(now) and not c.held.resigned and not c.banned(c.held.term.leader, now):
            c.become(Role.FOLLOWING)
            c.joins = 1
            c.untold = True
            c.set(Timer.JOIN, now + c.spread(c.unlisted(), c.timing.election.join_jitter))
            c.set(Timer.SUSPECT, c.held.issued + c.timing.liveness.suspicion)
            c.emit(LeaderChanged(c.group_id, c.held.term.leader, c.held.term.counter))
        elif c.role is not Role.CANDIDATE:
            follower.begin_election(c, now)
        c.awake = now

    def revise(
        self,
        now: Instant,
        release: Instant | None,
        duration: Duration | None,
        deadline: Instant | None = None,
        underway: bool | None = None,
    ) -> None:
        """The robot's own estimate has changed."""
        c = self.context
        job = c.job
        if job is None or c.passage is not Passage.WAITING:
            return
        request = job.request
        release = request.release if release is None else release
        duration = request.duration if duration is None else duration
        deadline = request.deadline if deadline is None else deadline
        material = max(abs(release - job.told[0]), abs(duration - job.told[1])) > c.timing.schedule.revision
        underway = request.underway if underway is None else underway
        material = material or deadline != request.deadline or underway is not request.underway
        job.request = replace(request, release=release, duration=duration, deadline=deadline, underway=underway)
        frozen = job.slot is not None and job.slot[0] <= now + c.timing.schedule.frozen
        # A frozen slot cannot move any more. A JOB that is due anyway has the new estimate.
        if not material or frozen or (c.untold and not follower.listed(c)):
            return
        self._begin_input(now)
        self._tell(now)
        c.awake = now

    def ready(self, now: Instant, ready: bool) -> bool:
        """Set whether the robot can enter; return whether that is new."""
        c = self.context
        if c.job is None or c.job.ready is ready:
            return False
        c.job.ready = ready
        if c.passage is Passage.CLAIMING and ready:
            c.sooner(Timer.POLL, now)  # the entry window may be open
        # The leader schedules an absent job behind all others; it must hear that the robot is ready now.
        if ready and c.job.absent:
            c.job.absent = 0
            if c.passage is Passage.WAITING:
                self._begin_input(now)
                self._tell(now)
        return True

    def inside_until(self, now: Instant, end: Instant) -> None:
        """The end of the passage has moved."""
        c = self.context
        if c.job is not None and c.passage is Passage.INSIDE:
            c.job.until = max(end, now)

    def leave(self, now: Instant) -> None:
        """Clear of it."""
        self._finish(now, Phase.OUT)

    def withdraw(self, now: Instant) -> None:
        """The job is over without entering; a robot inside is out by saying so."""
        self._finish(now, Phase.OUT if self.context.passage is Passage.INSIDE else Phase.GONE)

    def _finish(self, now: Instant, phase: Phase) -> None:
        c = self.context
        following = c.next_job
        c.next_job = None
        if c.job is None:
            return
        self._begin_input(now)
        trigger = c.job.trigger
        passage.end(c, now, phase)
        if c.ledger is not None:
            c.ledger.finish(c.robot, trigger, phase is Phase.OUT)
            # A leader that withdraws hands the group to a waiting robot. After its passage it leads while others wait.
            if phase is Phase.GONE and leader.others_wait(c):
                leader.resign(c, now)
                c.become(Role.NONE)
            else:
                leader.replan(c, now, reorder=False)
        else:
            c.become(Role.NONE)
            c.set(Timer.ASK, NEVER)
            c.set(Timer.SUSPECT, NEVER)
        c.awake = now
        if following is not None:
            self.trigger(now, following)

    def offer_path(self, now: Instant, direction: int, path: GridPath) -> None:
        """As leader: send this path to the others."""
        c = self.context
        if len(c.paths) < _PATHS_MAX or direction in c.paths:
            c.paths[direction] = (stamp(now), path)
            leader.send_path(c, now, direction)

    def _tell(self, now: Instant) -> None:
        """The own job has changed: the leader must know."""
        if self.context.role is Role.LEADING:
            leader.own_job_changed(self.context, now)
        else:
            follower.tell(self.context, now)

    # -- frames ----------------------------------------------------------------------------------------

    def receive(self, now: Instant, message: Message, source: int) -> None:
        """Take in a frame."""
        c = self.context
        c.company = c.company or source != c.robot
        self._begin_input(now)
        if isinstance(message, Beacon):
            self._on_beacon(now, message)
        elif isinstance(message, Sched):
            self._on_sched(now, message, source)
        elif isinstance(message, Job):
            self._on_job(now, message, source)
        else:
            self._on_path(message)
        c.awake = now

    def overhear(self, now: Instant, beacon: Beacon) -> bool:
        """Note a beacon that needs no reaction, and return True; else return False.

        A reaction is due if the robot leads or passes, if it may have to be a witness, or is about to be one.
        """
        c = self.context
        passes = c.passage in (Passage.CLAIMING, Passage.INSIDE)
        if beacon.phase is Phase.CLAIM or passes or c.role is Role.LEADING or c.witnessed == beacon.who:
            return False
        self._on_beacon(now, beacon)
        c.awake = now
        return True

    def _on_beacon(self, now: Instant, beacon: Beacon) -> None:
        c = self.context
        c.hear_of(beacon.term.counter)
        if beacon.who == c.robot:
            return
        if c.witnessed == beacon.who:  # heard again, from itself or another witness: no repeat is needed
            c.witnessed = None
            c.set(Timer.WITNESS, NEVER)
        if not c.fence.note(beacon):
            return
        if c.role is Role.LEADING:
            leader.on_beacon(c, now, beacon)
        if c.passage is Passage.CLAIMING:
            c.sooner(Timer.POLL, now)  # the beacon may open the fence, or be a claim that goes first
        # Witness: the claimant may not have heard a silent robot inside, whose last beacon is repeated after a delay.
        if beacon.phase is Phase.CLAIM and c.witnessed is None:
            silent = c.fence.unheard(now, beacon)
            if silent is not None:
                c.witnessed = silent
                c.set(
                    Timer.WITNESS, now + c.timing.claim.witness_min + c.spread(c.peers(), c.timing.claim.witness_spread)
                )

    def _on_job(self, now: Instant, job: Job, source: int) -> None:
        c = self.context
        question = job.term.leader == NOBODY
        c.hear_of(job.term.counter)
        if source == c.robot or now - job.time >= c.timing.liveness.drop:
            return  # its own echo, or too old to say anything of its sender
        if c.role is Role.LEADING:
            leader.on_job(c, now, source, job, question)
        elif question:
            if follower.on_question(c, now, source, job):
                leader.begin(c, now)
        elif c.role is Role.FOLLOWING and c.fresh(now):
            follower.relay_soon(c, now)  # a JOB sent to a robot that does not lead: the schedule shows who does

    def _on_sched(self, now: Instant, sched: Sched, source: int) -> None:
        c = self.context
        timing = self.context.timing
        term = sched.term
        c.hear_of(term.counter)
        # Its lease is over: it entitles no robot, and its leader may have been replaced.
        if sched.issued + timing.schedule.lease + 2 * timing.clock_error <= now:
            return
        # A leader is avoided because it does not acknowledge. A relay shows nothing of the link; its own frame does.
        if c.banned(term.leader, now):
            if source != term.leader:
                return
            del c.bans[term.leader]
        # As new as the schedule held, and no worse: it answers the question that this robot was about to answer.
        if sched.issued >= c.held.issued and not c.held.term.better(term):
            c.set(Timer.RELAY, NEVER)
        if term.leader == c.robot:
            self._on_own_name(now, sched)
        elif c.role is Role.LEADING and not sched.resign:
            self._on_rival(now, sched)
        elif c.fresh(now) and c.held.term.better(term) and not c.held.resigned:
            # A worse leader: relaying the better schedule lets it step down. Once per repetition is enough.
            if c.role is Role.FOLLOWING and now - c.relayed >= timing.schedule.repetition:
                follower.relay_soon(c, now)
        elif self._is_news(sched):
            follower.accept(c, now, sched)
            self._after_accept(now, sched)

    def _is_news(self, sched: Sched) -> bool:
        """Return whether `sched` is to be accepted: another term, a newer part, or the same part with a resignation."""
        held = self.context.held
        if self.context.role is Role.LEADING:
            return False
        if sched.term != held.term:
            return True
        known = held.parts.get(sched.part)
        return known is None or sched.issued > known.issued or (sched.resign and not known.resign)

    def _on_own_name(self, now: Instant, sched: Sched) -> None:
        """A schedule names this robot leader. If it never led that term, it has lost its memory."""
        c = self.context
        if c.role is Role.LEADING or not newer(sched.term.counter, c.led.counter):
            return
        c.led = sched.term
        # Others may enter under its leases of that term, of which it knows nothing. So it asks when they are over.
        if c.job is not None:
            first = sched.issued + c.timing.schedule.lease
            follower.begin_election(c, now, max(first, now))

    def _on_rival(self, now: Instant, sched: Sched) -> None:
        """Two lead: the worse steps down."""
        c = self.context
        if not sched.term.better(c.led):
            leader.answer_worse(c, now)  # its schedule lets the other one step down
            return
        leader.end(c)
        if c.job is None:
            c.become(Role.NONE)
        follower.accept(c, now, sched)

    def _after_accept(self, now: Instant, sched: Sched) -> None:
        c = self.context
        # An heir continues the slots, so it must hold all parts of the list.
        if sched.resign and sched.heir == c.robot and c.job is not None and c.held.complete():
            leader.begin(c, now, heir=True)

    def _on_path(self, part: PathPart) -> None:
        c = self.context
        if part.term != c.held.term or c.role is Role.LEADING or c.paths_known.get(part.direction, -1) >= part.time:
            return
        # Parts of different versions do not fit together: a newer version replaces the parts so far.
        time, pieces = c.path_parts.get(part.direction, (part.time, {}))
        if time != part.time:
            if part.time < time:
                return
            pieces = {}
        pieces[part.part] = part.steps
        c.path_parts[part.direction] = (part.time, pieces)
        steps = tuple(step for index in sorted(pieces) for step in pieces[index])
        if len(steps) == part.total:
            c.paths_known[part.direction] = part.time
            del c.path_parts[part.direction]
            c.emit(PathReceived(c.group_id, part.direction, GridPath(part.first, steps)))

    def confirmed(self, now: Instant, status: str) -> None:
        """The outcome of a unicast."""
        self._begin_input(now)
        follower.on_confirmed(self.context, now, status)
        self.context.awake = now

    # -- time ------------------------------------------------------------------------------------------

    def wake(self, now: Instant) -> None:
        """Run the timers that are due."""
        c = self.context
        self._begin_input(now)
        while c.next_wake <= now:
            for timer, at in enumerate(c.timers):
                if at <= now:
                    c.set(Timer(timer), NEVER)
                    _TIMERS[timer](self, now)
        c.awake = now

    def _begin_input(self, now: Instant) -> None:
        c = self.context
        # After a stall the robot may have missed claims of others: its assurance is void, and its claim starts anew.
        if c.job is not None and now - c.awake > c.timing.claim.stall:
            c.job.assured = -NEVER
            if c.passage is Passage.CLAIMING:
                c.job.since = now
        # All its leases are over, and others may have replaced it.
        if c.role is Role.LEADING and now - c.last_issued > c.timing.schedule.lease:
            leader.end(c)
            if c.job is None:
                c.become(Role.NONE)
            else:
                follower.begin_election(c, now)

    def _poll(self, now: Instant) -> None:
        if passage.on_poll(self.context, now):
            self._tell(now)
        elif self.context.passage is Passage.INSIDE and self.context.ledger is not None:
            self.context.sooner(Timer.PLAN, now)

    def _ask(self, now: Instant) -> None:
        if follower.on_ask_timer(self.context, now):
            leader.begin(self.context, now)

    def _witness(self, now: Instant) -> None:
        c = self.context
        who = c.witnessed
        c.witnessed = None
        record = None if who is None else c.fence.records.get(who)
        if record is not None and not record.assumed:
            c.send(record.beacon, now)


_TIMERS: Final[tuple[Callable[[Group, Instant], None], ...]] = (
    Group._poll,
    lambda group, now: passage.on_beacon(group.context, now),
    Group._ask,
    lambda group, now: follower.on_join_timer(group.context, now),
    lambda group, now: follower.on_suspect_timer(group.context, now),
    lambda group, now: follower.on_relay_timer(group.context, now),
    Group._witness,
    lambda group, now: leader.on_open_timer(group.context, now),
    lambda group, now: leader.on_plan_timer(group.context, now),
    lambda group, now: leader.on_issue_timer(group.context, now),
)
"""What each timer does, by its number."""
