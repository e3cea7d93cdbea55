"""The passage of this robot's own job: claim, entry, beacons inside, exit (phases).

A slot alone does not permit entry. The robot claims for at least W before entering, awake all the time, under a
schedule whose lease has not run out, and enters in the window after the slot's start when the fence is open
and its motion is ready. Otherwise the window passes, and it requests another slot.
"""

from rmr.base.direction import may_follow
from rmr.base.time import NEVER, Instant
from rmr.coord.context import Context, OwnJob, Timer, identity, stamp
from rmr.coord.events import Entered, EntryMissed, JobRequest, SlotAssigned, SlotLost
from rmr.coord.fence import Claim
from rmr.coord.messages import OVER, Beacon, Entry, Phase, Sched
from rmr.coord.states import Passage
from rmr.coord.timing import ABSENT_MAX


def begin(c: Context, request: JobRequest) -> None:
    """Make `request` the own live job."""
    previous = c.fence.finished.get(c.robot, -1)
    if c.job is not None:
        previous = max(previous, c.job.trigger)
        abandon(c)
    c.fence.capacity = request.capacity
    c.job = OwnJob(request, identity(request.trigger, previous))
    c.proceed(Passage.WAITING)


def renew(c: Context, now: Instant) -> None:
    """Continue the own job under a new identity: others have its present one as over, which is final."""
    job = c.job
    assert job is not None
    if c.passage is not Passage.INSIDE:
        _lose(c, now)
        job.missed = None
    job.trigger = identity(now, job.trigger)
    c.joins = 0
    c.untold = True


def abandon(c: Context) -> None:
    """Forget the own job."""
    c.job = None
    c.proceed(Passage.OUT)
    c.set(Timer.POLL, NEVER)
    c.set(Timer.BEACON, NEVER)
    c.set(Timer.JOIN, NEVER)


def on_schedule(c: Context, now: Instant) -> None:
    """Take the own slot from the schedule held."""
    job = c.job
    if job is None or c.passage is Passage.INSIDE:
        return
    found = c.held.find(c.robot, job.trigger)
    if found is None:
        # Only a complete schedule shows that the job is not listed: the missing part may have it.
        if c.held.complete():
            _lose(c, now)
        return
    part, rank, entry = found
    # A slot that this robot has reported as missed is void, although the leader may not have heard so yet.
    if entry.start is None or entry.phase in OVER or (job.missed is not None and entry.start <= job.missed):
        _lose(c, now)
        return
    _take(c, now, part, rank, entry)


def _take(c: Context, now: Instant, part: Sched, rank: int, entry: Entry) -> None:
    job = c.job
    assert job is not None
    assert entry.start is not None
    place = c.held.place(rank, entry.direction)
    slot = (entry.start, entry.start + entry.duration, rank)
    # The slot was moved: others must not wait for a claim of the old one.
    if c.passage is Passage.CLAIMING and entry.start != job.claimed:
        _withdraw_claim(c, now)
    job.slot = slot
    job.lease = part.issued + c.timing.schedule.lease - c.timing.clock_error
    if (*slot, place, part.term) != job.announced:
        job.announced = (*slot, place, part.term)
        leader = part.term.leader
        term = part.term.counter
        c.emit(SlotAssigned(c.group_id, job.request.trigger, rank, place, slot[0], slot[1], leader, term))
    if c.passage is Passage.WAITING:
        c.set(Timer.POLL, max(now, entry.start - c.timing.claim.quiet - c.timing.claim.ahead))


def _lose(c: Context, now: Instant) -> None:
    job = c.job
    assert job is not None
    if c.passage is Passage.CLAIMING:
        _withdraw_claim(c, now)
    if job.slot is not None:
        job.slot = job.announced = None
        c.emit(SlotLost(c.group_id))
    c.set(Timer.POLL, NEVER)


def _withdraw_claim(c: Context, now: Instant) -> None:
    _say(c, now, Phase.YIELD, c.timing.claim.finals)
    c.proceed(Passage.WAITING)
    c.set(Timer.BEACON, NEVER)
    assert c.job is not None
    c.job.claimed = None


def on_poll(c: Context, now: Instant) -> bool:
    """Claim, enter, or miss the slot; return whether it was missed."""
    job = c.job
    if job is None or job.slot is None or c.passage is Passage.INSIDE:
        c.set(Timer.POLL, NEVER)
        return False
    if c.passage is Passage.WAITING:
        return _consider_claim(c, now)
    return _consider_entry(c, now)


def _consider_claim(c: Context, now: Instant) -> bool:
    job = c.job
    timing = c.timing
    assert job is not None
    assert job.slot is not None
    start, _, _ = job.slot
    # Too late to have claimed for long enough within the window.
    if now + c.quiet(now) > start + timing.schedule.window:
        return miss(c, now)
    # Without a lease the slot may have been moved: wait for the next schedule.
    if now >= job.lease:
        c.set(Timer.POLL, now + timing.claim.poll)
        return False
    c.proceed(Passage.CLAIMING)
    job.claimed = start
    job.since = now
    on_beacon(c, now)
    c.set(Timer.POLL, min(now + timing.claim.poll, max(start, now + timing.claim.entry_poll)))
    return False


def _consider_entry(c: Context, now: Instant) -> bool:
    job = c.job
    timing = c.timing
    assert job is not None
    assert job.slot is not None
    start, end, _ = job.slot
    claimed = job.since + c.quiet(now)
    if now > start + timing.schedule.window or max(now, claimed) > start + timing.schedule.window:
        return miss(c, now)
    claim = Claim(c.robot, start, end, job.request.headway, job.request.direction)
    if c.fence.capacity > 1:
        verdict = c.fence.judge_places(now, claim, _listed_before(c, start))
    else:
        verdict = c.fence.judge(now, claim)
    if verdict.lost:
        return miss(c, now)  # a conflicting claim goes first: yield to it
    may_enter = start <= now < job.lease and job.ready and now >= claimed and verdict.open
    if may_enter and (c.fence.capacity > 1 or not _waits_for_listed(c, now, start)):
        enter(c, now, cautious=verdict.cautious or _somebody_presumed_gone(c))
        return False
    c.set(Timer.POLL, min(now + timing.claim.poll, start) if now < start else now + timing.claim.entry_poll)
    return False


def _waits_for_listed(c: Context, now: Instant, start: Instant) -> bool:
    """Return whether the schedule lists a robot that goes first, even if no beacon of it was heard.

    That is an opposed job of earlier start without OUT, or a robot of the same direction that has been inside for less
    than the headway.
    """
    job = c.job
    assert job is not None
    for part in c.held.parts.values():
        for entry in part.entries:
            if entry.robot == c.robot or entry.start is None or entry.phase in OVER:
                continue
            if c.fence.is_finished(entry.robot, entry.trigger):
                continue
            if may_follow(entry.direction, job.request.direction):
                first = entry.phase is Phase.IN and now < entry.start + job.request.headway
            else:
                first = entry.start < start
            if first:
                return True
    return False


def _listed_before(c: Context, start: Instant) -> set[int]:
    """Return the robots that the schedule lists before an own slot at `start` and that are not known to be out.

    Of equal starts the smaller robot is before: so of more robots than there are places one counts all the others.
    """
    return {
        entry.robot
        for part in c.held.parts.values()
        for entry in part.entries
        if entry.start is not None
        and (entry.start, entry.robot) < (start, c.robot)
        and entry.phase not in OVER
        and not c.fence.is_finished(entry.robot, entry.trigger)
    }


def _somebody_presumed_gone(c: Context) -> bool:
    """Return whether the schedule lists an opposed robot that entered and has been silent for too long since."""
    assert c.job is not None
    direction = c.job.request.direction
    return any(
        entry.phase is Phase.GONE
        and not may_follow(entry.direction, direction)
        and not c.fence.is_finished(entry.robot, entry.trigger)
        for part in c.held.parts.values()
        for entry in part.entries
    )


def enter(c: Context, now: Instant, *, cautious: bool) -> None:
    """Enter, and announce it."""
    job = c.job
    assert job is not None
    c.proceed(Passage.INSIDE)
    job.entered = stamp(now)
    job.until = now + job.request.duration
    c.set(Timer.POLL, NEVER)
    c.set(Timer.JOIN, NEVER)
    on_beacon(c, now)
    c.emit(Entered(c.group_id, now, job.until, cautious))


def miss(c: Context, now: Instant) -> bool:
    """Give up the slot; the caller asks the leader for another. Return True."""
    job = c.job
    assert job is not None
    assert job.slot is not None
    job.missed = job.slot[0]
    # Absent: the robot was not ready. One on its way to a bottleneck reports a later release itself (`postpones`).
    if not job.ready and not job.request.postpones:
        job.absent = min(job.absent + 1, ABSENT_MAX)
    if c.passage is Passage.CLAIMING:
        _withdraw_claim(c, now)
    job.slot = job.announced = None
    c.set(Timer.POLL, NEVER)
    c.emit(EntryMissed(c.group_id))
    return True


def on_beacon(c: Context, now: Instant) -> None:
    """Send CLAIM or IN, and again after H."""
    if c.passage is Passage.CLAIMING:
        _say(c, now, Phase.CLAIM)
    elif c.passage is Passage.INSIDE:
        assert c.job is not None
        c.job.until = max(c.job.until, now)
        _say(c, now, Phase.IN)
    else:
        c.set(Timer.BEACON, NEVER)
        return
    c.set(Timer.BEACON, now + c.timing.claim.beacon)


def end(c: Context, now: Instant, phase: Phase) -> None:
    """The own job is over: say OUT (was inside) or GONE."""
    job = c.job
    assert job is not None
    _say(c, now, phase, c.timing.claim.finals)
    abandon(c)


def _say(c: Context, now: Instant, phase: Phase, times: int = 1) -> None:
    job = c.job
    assert job is not None
    if c.passage is Passage.INSIDE:
        start = job.entered
        until = job.until
    elif job.claimed is not None:
        start = job.claimed
        until = job.claimed + job.request.duration
    else:
        start = until = stamp(now)
    beacon = Beacon(
        c.group_id,
        stamp(now),
        c.held.term,
        c.robot,
        job.trigger,
        phase,
        job.request.direction,
        start,
        max(until, start),
    )
    c.fence.note(beacon)
    for i in range(times):
        c.send(beacon, now + i * c.timing.claim.final_gap)


def repeat_out(c: Context, now: Instant, entry: Entry) -> None:
    """Say once more that a finished job, still listed as `entry`, is over."""
    start = stamp(now) if entry.start is None else entry.start
    c.send(
        Beacon(c.group_id, stamp(now), c.held.term, c.robot, entry.trigger, Phase.OUT, entry.direction, start, start),
        now,
    )
