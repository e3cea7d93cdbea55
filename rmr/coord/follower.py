"""Election and membership of a group (paper IV.C: discover, then join).

A robot with a job and no fresh schedule is a candidate: it asks three times by broadcast, then leads. Candidates defer
to the earliest one. They tell that one their jobs at once: when all robots ask, nobody leads, and it need not wait for
answers that cannot come. Any member that holds a fresh schedule answers by relaying it unchanged, for a schedule means
the same from every sender. A member makes sure that it is listed, reminds the leader of itself, and asks again when the
leader is silent or does not acknowledge.
"""

from rmr.base.time import NEVER, Duration, Instant
from rmr.coord import passage
from rmr.coord.context import Context, Timer, stamp
from rmr.coord.events import LeaderChanged
from rmr.coord.known_schedule import extract
from rmr.coord.messages import Job, Phase, Sched
from rmr.coord.states import Passage, Role
from rmr.coord.term import NO_TERM, NOBODY, Term
from rmr.coord.timing import BANS_MAX, RECORDS_MAX


def begin_election(c: Context, now: Instant, first: Instant | None = None) -> None:
    """Become a candidate; the first question goes out at `first` (default: after a short random delay)."""
    c.become(Role.CANDIDATE)
    c.asks = 0
    c.asked = None
    c.candidates.clear()
    c.no_acks = 0
    c.set(Timer.JOIN, NEVER)
    c.set(Timer.SUSPECT, NEVER)
    if c.alone:
        c.asks = c.timing.election.asks
        first = now  # there is no robot to ask
    c.set(Timer.ASK, now + c.spread(c.peers() + 1, c.timing.election.ask_spread) if first is None else first)


def on_ask_timer(c: Context, now: Instant) -> bool:
    """Ask again, or return True: all questions are unanswered, and this robot must lead."""
    c.set(Timer.ASK, NEVER)
    if c.role is not Role.CANDIDATE or c.job is None:
        return False
    if c.asks >= c.timing.election.asks:
        return True
    if c.asked is None:
        c.asked = stamp(now)  # in the frame's resolution, else two that ask within one millisecond both defer
    c.asks += 1
    c.send(c.job_frame(now, Term(c.counter, NOBODY)), now)
    c.set(Timer.ASK, now + c.timing.election.ask_gap + c.uniform(0, c.timing.election.ask_jitter))
    return False


def on_question(c: Context, now: Instant, source: int, job: Job) -> bool:
    """Handle a question of another candidate: defer to an earlier one, or answer with the known schedule.

    Return True where this robot asked first and has heard questions of all others: then none of them leads.
    """
    if c.role is Role.CANDIDATE:
        if now - job.time > c.timing.schedule.lease:
            return False  # it follows or leads by now
        if source in c.candidates or len(c.candidates) < RECORDS_MAX:
            c.candidates[source] = job
        if c.asked is None or (job.asked, source) < (c.asked, c.robot):
            _defer_to(c, now, source, job)
        return c.asks > 0 and len(c.candidates) >= c.peers()
    if c.role is Role.FOLLOWING and c.fresh(now):
        relay_soon(c, now + c.timing.election.relay_wait)
    return False


def _defer_to(c: Context, now: Instant, candidate: int, job: Job) -> None:
    """Defer to `candidate`: ask again only if it does not lead by then, and send it the own job once.

    With the jobs of all others it leads at once.
    """
    c.asks = 0
    c.set(Timer.ASK, now + c.timing.election.backoff + c.spread(c.peers(), c.timing.election.backoff_jitter))
    first = c.candidates.get(c.candidate)
    if first is None or (job.asked, candidate) < (first.asked, c.candidate):
        c.candidate = candidate
        c.sooner(Timer.JOIN, now + c.spread(c.peers()))


def relay_soon(c: Context, now: Instant) -> None:
    """Relay the schedule held after a random delay: all followers have the same reason to, and one answer suffices."""
    followers = c.peers() if c.held.opening else len(c.held.entries())
    c.sooner(Timer.RELAY, now + c.spread(followers))


def on_relay_timer(c: Context, now: Instant) -> None:
    """Relay the schedule held, unless its lease is over."""
    c.set(Timer.RELAY, NEVER)
    if c.fresh(now):
        relay(c, now)


def relay(c: Context, now: Instant) -> None:
    """Send the schedule held unchanged."""
    c.relayed = now
    for payload in c.held.raw():
        c.send_raw(payload, now)


def accept(c: Context, now: Instant, sched: Sched) -> None:
    """Hold `sched`, follow its leader if there is a job, and take the own slot from it."""
    old = c.held.term
    was_listed = listed(c)
    c.held.take(sched)
    for robot, trigger in extract(sched.entries).over:
        if c.job is not None and (robot, trigger) == (c.robot, c.job.trigger):
            passage.renew(c, now)
        c.fence.finish(robot, trigger)
    c.report_order()
    if c.job is None:
        _remind(c, now, sched)
        return
    if sched.term != old or c.role is not Role.FOLLOWING:
        _follow(c, sched.term)
    passage.on_schedule(c, now)
    _see_to_listing(c, now, was_listed)
    _suspect_later(c)


def _follow(c: Context, term: Term) -> None:
    c.become(Role.FOLLOWING)
    c.asked = None
    c.asks = 0
    c.candidates.clear()
    c.set(Timer.ASK, NEVER)
    c.no_acks = 0
    c.joins = 0
    c.untold = True
    c.set(Timer.JOIN, NEVER)
    c.emit(LeaderChanged(c.group_id, term.leader, term.counter))


def _remind(c: Context, now: Instant, sched: Sched) -> None:
    """Repeat OUT for a finished job that is still listed."""
    for entry in sched.entries:
        if entry.robot != c.robot or entry.phase is Phase.OUT:  # one that is presumed over is confirmed
            continue
        if c.fence.is_finished(c.robot, entry.trigger) and now - c.reminded >= c.timing.claim.reminder_gap:
            c.reminded = now
            passage.repeat_out(c, now + c.spread(len(sched.entries)), entry)


def _see_to_listing(c: Context, now: Instant, was_listed: bool) -> None:
    """Arrange for the next JOB: soon when the leader does not know the job as it is, else as a reminder.

    The job is sent to a new leader at once, even if the robot knows only one part of its schedule and may be listed in
    another.
    """
    job = c.job
    if job is None or c.passage is Passage.INSIDE:
        c.set(Timer.JOIN, NEVER)
        return
    if listed(c):
        c.joins = 0
        told = job.told == (job.request.release, job.request.duration)
        if c.timers[Timer.JOIN] == NEVER or (told and not was_listed):
            c.set(Timer.JOIN, _reminder(c, now))
        # The question had an older estimate: a job whose robot waits elsewhere tells the new one without delay.
        if not job.request.postpones and abs(job.request.release - job.told[0]) > c.timing.schedule.revision:
            tell(c, now)
    elif c.joins == 0 and (c.untold or c.held.complete() or c.held.find(c.robot, job.trigger) is not None):
        c.joins = 1
        c.sooner(Timer.JOIN, now + c.spread(c.unlisted()))


def _reminder(c: Context, now: Instant) -> Instant:
    """Return when to repeat a job that is listed: not when all others do that one schedule listed."""
    return now + c.timing.liveness.keep - c.spread(c.peers() + 1)


def listed(c: Context) -> bool:
    """Return whether the schedule held shows that the leader knows the own job as it is."""
    job = c.job
    if job is None:
        return True
    found = c.held.find(c.robot, job.trigger)
    if found is None or found[2].phase in (Phase.PROVISIONAL, Phase.GONE):
        return False
    start = found[2].start
    return job.missed is None or start is None or start > job.missed


def on_join_timer(c: Context, now: Instant) -> None:
    """Send the own job to the leader, repeatedly while it is not listed; or to the earliest candidate, once per
    question."""
    c.set(Timer.JOIN, NEVER)
    if c.job is None or c.passage is Passage.INSIDE:
        return
    if c.role is Role.CANDIDATE:
        c.send(c.job_frame(now, Term(c.counter, NOBODY)), now, c.candidate)
    if c.role is not Role.FOLLOWING:
        return
    c.untold = False
    c.send(c.job_frame(now, c.held.term), now, c.held.term.leader)
    if listed(c):
        c.set(Timer.JOIN, _reminder(c, now))
    else:
        c.set(Timer.JOIN, now + _back_off(c))
        c.joins += 1


def _back_off(c: Context) -> Duration:
    """Return how long to wait before telling the leader again."""
    gap = min(c.timing.liveness.rejoin_first << min(max(c.joins - 1, 0), 8), c.timing.liveness.rejoin_max)
    return c.uniform(gap, gap + gap // 2)


def tell(c: Context, now: Instant) -> None:
    """Tell the leader at once that the own job has changed."""
    if c.role is Role.FOLLOWING:
        c.joins = max(c.joins, 1)
        c.set(Timer.JOIN, now + c.uniform(0, c.timing.election.join_jitter))


def _suspect_later(c: Context) -> None:
    """The leader is suspected when it is silent for long; the next in the list moves first, the unlisted last."""
    timing = c.timing
    held = c.held
    coming = held.coming()
    leader = held.term.leader
    unlisted = c.robot == leader or c.robot not in coming
    before = coming if unlisted else coming[: coming.index(c.robot)]
    rank = len(before) - before.count(leader)
    wait = timing.schedule.lease if held.resigned else timing.liveness.suspicion
    spread = c.spread(c.unlisted()) if unlisted else 0
    c.set(Timer.SUSPECT, held.issued + wait + rank * timing.liveness.stagger + spread)


def on_suspect_timer(c: Context, now: Instant) -> None:
    """The leader has been silent for too long."""
    c.set(Timer.SUSPECT, NEVER)
    if c.role is Role.FOLLOWING and c.job is not None:
        if c.passage is Passage.INSIDE:
            c.set(Timer.SUSPECT, now + c.timing.liveness.suspicion)
        else:
            begin_election(c, now, now)


def on_confirmed(c: Context, now: Instant, status: str) -> None:
    """The outcome of a JOB to the leader.

    One that has arrived is not repeated before the leader has had time to list it, one that has not, after a
    back-off. After some without acknowledgement that leader is avoided.
    """
    if status == "ok":
        c.no_acks = 0
        if c.timers[Timer.JOIN] < NEVER:
            gap = c.timing.schedule.repetition
            c.set(Timer.JOIN, max(c.timers[Timer.JOIN], now + c.uniform(gap, gap + gap // 2)))
        return
    if c.role is Role.FOLLOWING and c.joins:
        c.sooner(Timer.JOIN, now + _back_off(c))
    if status != "no_ack" or c.role is not Role.FOLLOWING:
        return
    c.no_acks += 1
    if c.no_acks >= c.timing.liveness.no_acks and c.passage is Passage.WAITING:
        while len(c.bans) >= BANS_MAX:
            del c.bans[next(iter(c.bans))]
        c.bans[c.held.term.leader] = now + c.timing.liveness.ban
        c.held.take(Sched(c.group_id, -NEVER, NO_TERM, False, NOBODY, 0, 0, 0, 1, ()))
        begin_election(c, now)
