"""Leading: gather jobs for the waiting time n, give slots, repeat the schedule (paper IV.C).

A leader issues its schedule every R, at once when it has changed, and in answer to questions; each frame is a
lease. One that has issued nothing for a lease leads no more, for others may by then have replaced it. It
stays while others wait, even when its own job is done.

A schedule of one or two frames is sent whole. Of a longer one, which N robots hear, each issue holds the parts that
concern a slot that is near, those that list a job or its slot for the first time, and one of the others in turn: what
has changed in them can wait: a robot whose slot is not near may not enter under any part that it holds. So frames come
as robots pass, and not as all that pass later are shifted.
"""

from rmr.base.grid_path import GridPath
from rmr.base.time import NEVER, Instant
from rmr.coord import passage
from rmr.coord.context import Context, Timer, stamp
from rmr.coord.events import LeadershipBegan, LeadershipEnded
from rmr.coord.known_schedule import KnownSchedule
from rmr.coord.ledger import Ledger
from rmr.coord.messages import OVER, PARTS_MAX, Beacon, Entry, Job, PathPart, Phase, Sched, entries_max, steps_max
from rmr.coord.states import Role
from rmr.coord.term import NOBODY, Term, successor
from rmr.coord.timing import MS, PAYLOAD_MAX


def begin(c: Context, now: Instant, heir: bool = False) -> None:
    """Lead: take over what is known of a predecessor, issue at once, give slots after the waiting time."""
    held = c.held
    passed = held.parts[0].passed if 0 in held.parts else 0
    headway = c.job.request.headway if c.job is not None else 0
    ledger = c.ledger = Ledger(c.robot, c.timing, passed, headway, c.fence.capacity)
    predecessor = any(e.phase not in OVER for e in held.entries())
    c.counter = successor(c.counter)
    c.become(Role.LEADING)
    for timer in (Timer.ASK, Timer.JOIN, Timer.SUSPECT, Timer.RELAY):
        c.set(timer, NEVER)
    own = Term(c.counter, c.robot)
    c.led = own
    _note_own(c, now)
    _assure(c)
    for source, job in c.candidates.items():
        ledger.note(now, source, job, c.fence)
    c.candidates.clear()
    if _contiguous(held):
        for entry in ledger.inherit(now, held.entries(), heir, c.fence):
            _assume_inside(c, now, entry)
    c.held = KnownSchedule(entries_max(c.timing.payload_max))
    c.held.term = own
    c.held.order = held.order
    c.idle_since = None
    c.extras = 0
    answers = (
        c.timing.election.reply_spread * min(c.peers(), c.timing.election.answers_max) + c.timing.election.answer_time
    )
    ledger.answered = now + answers
    takeover = max(c.timing.election.takeover_wait, answers)
    wait = 0 if heir else takeover if predecessor else ledger.wait(now, c.peers())
    ledger.opens = now + wait
    c.emit(LeadershipBegan(c.group_id, c.counter))
    if wait:
        c.set(Timer.OPEN, ledger.opens)
        replan(c, now, reorder=False)
    else:
        ledger.open = True
        replan(c, now, reorder=True)


def _assure(c: Context) -> None:
    """Note until when no other robot can be about to enter, if all robots of the roster ask.

    A candidate is not inside, does not claim, and does not claim before it has asked in vain or been given a slot,
    which takes longer than W.
    """
    if c.job is not None and 0 < c.peers() <= len(c.candidates):
        c.job.assured = min(job.time for job in c.candidates.values()) + c.timing.claim.quiet


def _contiguous(held: KnownSchedule) -> bool:
    return sorted(held.parts) == list(range(len(held.parts)))


def _assume_inside(c: Context, now: Instant, entry: Entry) -> None:
    assert entry.start is not None
    c.fence.assume(
        Beacon(
            c.group_id,
            stamp(now),
            c.held.term,
            entry.robot,
            entry.trigger,
            Phase.IN,
            entry.direction,
            entry.start,
            entry.start + entry.duration,
        ),
    )


def _note_own(c: Context, now: Instant) -> bool:
    if c.job is None or c.ledger is None:
        return False
    return c.ledger.note(now, c.robot, c.job_frame(now, c.led), c.fence)


def end(c: Context) -> None:
    """Lead no more; the caller decides what comes instead."""
    assert c.ledger is not None
    c.ledger = None
    c.paths.clear()
    for timer in (Timer.OPEN, Timer.PLAN, Timer.ISSUE):
        c.set(timer, NEVER)
    c.emit(LeadershipEnded(c.group_id))


def on_job(c: Context, now: Instant, source: int, job: Job, question: bool) -> None:
    """A robot asks or tells its job: note it, answer a question soon, plan again."""
    ledger = c.ledger
    assert ledger is not None
    known = source in ledger.bookings
    changed = ledger.note(now, source, job, c.fence)
    if changed:
        c.paths_due = c.paths_due or not known
        c.idle_since = None
        if ledger.open:
            c.sooner(Timer.PLAN, now + ledger.gathers(now, source))
        else:
            _shorten_wait(c, now)
    if question:
        c.sooner(Timer.ISSUE, now + c.uniform(0, c.timing.election.answer_jitter))


def _shorten_wait(c: Context, now: Instant) -> None:
    """Recompute the waiting time at a join; it only shrinks."""
    ledger = c.ledger
    assert ledger is not None
    opens = min(ledger.opens, now + ledger.wait(now, c.peers()))
    if opens < ledger.opens:
        ledger.opens = opens
        c.set(Timer.OPEN, opens)


def own_job_changed(c: Context, now: Instant) -> None:
    """The leader's own job is new, revised or has missed its slot."""
    if _note_own(c, now):
        c.idle_since = None
        c.sooner(Timer.PLAN, now)


def on_open_timer(c: Context, now: Instant) -> None:
    """The waiting time is over: give slots."""
    c.set(Timer.OPEN, NEVER)
    if c.ledger is not None:
        c.ledger.open = True
        replan(c, now, reorder=True)


def on_plan_timer(c: Context, now: Instant) -> None:
    """Plan again after news."""
    c.set(Timer.PLAN, NEVER)
    if c.ledger is not None:
        replan(c, now, reorder=True)


def replan(c: Context, now: Instant, reorder: bool) -> None:
    """Plan and issue, with extra repeats, for something has changed."""
    ledger = c.ledger
    assert ledger is not None
    c.set(Timer.PLAN, NEVER)
    ledger.observe(now, c.fence)
    ledger.plan(now, reorder, eager=_eager(c, now))
    c.extras = c.timing.schedule.extra
    issue(c, now)
    if c.paths_due and ledger.open:
        c.paths_due = False
        for direction in c.paths:
            send_path(c, now, direction)


def _eager(c: Context, now: Instant) -> bool:
    """Return whether the leader's own job may have a slot at once.

    It needs no claim and must be ready; alone it need not be, since no other robot loses time.
    """
    return c.job is not None and c.undisputed(now) and (c.job.ready or c.alone)


def on_issue_timer(c: Context, now: Instant) -> None:
    """Repeat the schedule, brought up to date; fall silent when no robot needs it any more."""
    ledger = c.ledger
    if ledger is None:
        c.set(Timer.ISSUE, NEVER)
        return
    if not ledger.bookings:
        if c.idle_since is None:
            c.idle_since = now
        elif now >= c.idle_since + c.timing.schedule.repetition:
            c.set(Timer.ISSUE, c.last_issued + c.timing.schedule.lease + MS)
            return
    changed = ledger.observe(now, c.fence)
    if changed or ledger.open:
        changed = ledger.plan(now, changed, eager=_eager(c, now)) or changed
    if changed:
        c.extras = c.timing.schedule.extra
    issue(c, now)


def issue(c: Context, now: Instant) -> None:
    """Send the schedule, and hold it as members do.

    No two versions may have one instant of issue, else members would take either for the newest.
    """
    if stamp(now) == stamp(c.last_issued) or now < c.last_issued:
        c.set(Timer.ISSUE, c.last_issued + MS)
        return
    for part in _due(c, now, schedule_frames(c, now, resign=False, heir=NOBODY)):
        c.send(part, now)
        c.held.take(part)
    c.last_issued = now
    gap = c.timing.schedule.repetition
    # A changed schedule is repeated sooner: a lost frame then costs less than a whole repetition.
    if c.extras > 0:
        c.extras -= 1
        gap = c.timing.schedule.extra_gap
    c.set(Timer.ISSUE, now + gap)
    c.report_order()
    passage.on_schedule(c, now)


def _due(c: Context, now: Instant, parts: list[Sched]) -> list[Sched]:
    """Return those of `parts` that are sent now: what changes soon for a robot at once, the others in turn."""
    if len(parts) <= 2:  # longer ones are not sent whole each time
        return parts
    held = c.held
    soon = now + c.timing.schedule.soon
    told = {(entry.robot, entry.trigger): entry for entry in held.entries()}
    chosen = [
        part
        for part in parts
        if not held.has(part)
        or any(_concerns(entry, told.get((entry.robot, entry.trigger)), soon) for entry in part.entries)
    ]
    rest = [part for part in parts if part not in chosen]
    oldest = min(rest, key=lambda part: held.parts[part.part].issued, default=None)
    return chosen if oldest is None else [*chosen, oldest]


def _concerns(entry: Entry, told: Entry | None, soon: Instant) -> bool:
    """Return whether `entry` is new to its owner, or has or had a slot by `soon`; `told` is the entry sent before."""
    if entry.robot == NOBODY:
        return False
    if told is None or _known(told) != _known(entry):
        return True
    return any(one.phase not in OVER and one.start is not None and one.start <= soon for one in (told, entry))


def _known(entry: Entry) -> tuple[bool, bool]:
    """Return whether a job is listed, and whether it has a slot."""
    return entry.phase is not Phase.PROVISIONAL, entry.start is not None


def schedule_frames(c: Context, now: Instant, resign: bool, heir: int) -> list[Sched]:
    """Return the schedule as it stands."""
    ledger = c.ledger
    assert ledger is not None
    entries = ledger.entries()
    full = entries_max(c.timing.payload_max)
    opens = 0 if ledger.open else max(ledger.opens - now, 0)
    parts = max(1, min(PARTS_MAX, -(-len(entries) // full)))
    return [
        Sched(
            c.group_id,
            stamp(now),
            c.led,
            resign,
            heir,
            opens,
            ledger.passed,
            part,
            parts,
            tuple(entries[full * part : full * (part + 1)]),
        )
        for part in range(parts)
    ]


def on_beacon(c: Context, now: Instant, beacon: Beacon) -> None:
    """Update the books by a beacon, and plan again if it frees or takes a place."""
    ledger = c.ledger
    assert ledger is not None
    booking = ledger.bookings.get(beacon.who)
    if beacon.phase in (Phase.OUT, Phase.GONE):
        if ledger.finish(beacon.who, beacon.trigger, beacon.phase is Phase.OUT):
            # After a passage the order stays as planned. A job that ends without one leaves a gap that others may use.
            replan(c, now, reorder=beacon.phase is Phase.GONE)
        elif ledger.confirm_over(beacon.who, beacon.trigger):
            c.sooner(Timer.PLAN, now)
    elif beacon.phase is Phase.YIELD:
        if ledger.missed(beacon.who, beacon.start):
            # Its JOB with the new estimate follows; the plan waits for it.
            c.sooner(Timer.PLAN, now + c.timing.schedule.replan_wait)
    elif booking is None or booking.trigger != beacon.trigger:
        c.sooner(Timer.PLAN, now)  # a robot that is not in the books claims or is inside
    else:
        booking.heard = max(booking.heard, beacon.time)
        if beacon.phase is Phase.IN and not booking.inside:
            c.sooner(Timer.PLAN, now)


def answer_worse(c: Context, now: Instant) -> None:
    """Answer a worse leader with the own schedule, by which it steps down; at a bounded rate."""
    if now - c.answered >= c.timing.schedule.answer_gap:
        c.answered = now
        issue(c, now)


def resign(c: Context, now: Instant) -> None:
    """Leave while others wait: name the heir in a last schedule, sent three times."""
    ledger = c.ledger
    assert ledger is not None
    now = max(now, c.last_issued + MS)
    heir = ledger.heir()
    for part in schedule_frames(c, now, resign=True, heir=heir):
        c.held.take(part)
        for i in range(1 + c.timing.schedule.extra):
            c.send(part, now + i * c.timing.schedule.extra_gap)
    end(c)


def others_wait(c: Context) -> bool:
    """Return whether the ledger has a waiting job of another robot."""
    return c.ledger is not None and c.ledger.heir() != NOBODY


def send_path(c: Context, now: Instant, direction: int) -> None:
    """Send the path offered for `direction`, three times."""
    offered = c.paths.get(direction)
    if offered is None or c.role is not Role.LEADING:
        return
    for part in split_path(c.group_id, offered[0], c.led, direction, offered[1], c.timing.payload_max):
        for i in range(c.timing.schedule.path_repeats):
            c.send(part, now + i * c.timing.schedule.path_gap)


def split_path(
    group_id: bytes, time: Instant, term: Term, direction: int, path: GridPath, payload_max: int = PAYLOAD_MAX
) -> list[PathPart]:
    """Return the frames of a whole path. Raises ValueError for a path of more than 65535 steps or cells beyond."""
    total = len(path.steps)
    if total > 0xFFFF or not all(0 <= c <= 0xFFFF for c in path.first):
        raise ValueError("a path has at most 65535 steps and begins in a cell of the arena")
    full = steps_max(payload_max)
    offsets = range(0, max(total, 1), full)
    return [
        PathPart(group_id, time, term, direction, i, path.first, total, at, path.steps[at : at + full])
        for i, at in enumerate(offsets)
    ]
