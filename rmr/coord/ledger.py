"""The leader's books: the jobs of its group, their slots and their ranks.

Slots. A slot nearer than the frozen zone stands: it is neither moved nor its time used for another until its
owner says OUT or GONE, or that it let this very slot pass. A robot inside, of whatever term, keeps its place
until it says OUT or is presumed gone. All others are placed behind those that stand; their order is made anew only when
jobs come, go or change. A robot that has set out and was put off goes first, for the others would have to pass it; of
more than `EXACT_MAX` jobs all that have set out do, and before them those that do not hold them up. Jobs that were not
ready for their slots go last, jobs that enough others have overtaken first.

Ranks. The entries of a schedule stand in order of rank, and a rank is fixed from the frozen zone
on (exit and queue places go by it). Free ranks are dealt to the others in order of their slots. Jobs that are
done keep their rank until all before them are done too; then `passed` counts them instead.
"""

import math
from collections.abc import Iterable
from typing import Final

from rmr.base.time import NEVER, Duration, Instant
from rmr.coord.booking import Booking, doubled, entry_of
from rmr.coord.fence import Fence
from rmr.coord.messages import PARTS_MAX, Entry, Job, Phase, entries_max
from rmr.coord.planner import Planner
from rmr.coord.term import NOBODY
from rmr.coord.timing import JOBS_MAX, Timing

_VOID: Final = Entry(NOBODY, 0, None, 0, 0, Phase.OUT)


class Ledger:
    """All jobs of one group, as its leader sees them."""

    def __init__(self, robot: int, timing: Timing, passed: int, headway: Duration) -> None:
        self._robot = robot
        self._timing = timing
        self._headway = headway
        """For robots whose own headway is not known."""
        self.passed = passed
        self.bookings: dict[int, Booking] = {}
        """Live jobs by robot."""
        self.done: dict[int, Booking] = {}
        """By rank: jobs that are over, before some that are not."""
        self.opens: Instant = NEVER
        """When slots are given for the first time."""
        self.answered: Instant = 0
        """By when all answers to the announcement should be here."""
        self.open = False

    # -- news ------------------------------------------------------------------------------------------

    def note(self, now: Instant, robot: int, job: Job, fence: Fence) -> bool:
        """Take in a JOB; return whether the plan must be made anew."""
        if fence.is_finished(robot, job.trigger):
            return False
        booking = self.bookings.get(robot)
        if booking is not None and job.trigger < booking.trigger:
            return False
        if booking is None or job.trigger > booking.trigger:
            if booking is None and len(self.bookings) >= JOBS_MAX:
                return False
            self.bookings[robot] = booking = self._book(robot, job.trigger, now)
            booking.heard = job.time
        elif job.time < booking.said:
            return False
        timing = self._timing
        booking.heard = max(booking.heard, job.time)
        changed = booking.said < 0
        fence.refute(robot, job.time)
        if booking.inside and robot not in fence.records:
            booking.inside = False
            booking.start = None
            changed = True
        if job.missed is not None:
            changed = self.missed(robot, job.missed) or changed
        retry = now + doubled(timing.schedule.absent_wait, job.absent, timing.schedule.absent_wait_max)
        changed = booking.set_absent(job, retry) or changed
        return booking.tell(job) or changed

    def missed(self, robot: int, start: Instant) -> bool:
        """The owner said that it let that slot pass, though a claim may have made it count as inside."""
        booking = self.bookings.get(robot)
        if booking is None or booking.start != start:
            return False
        booking.start = None
        booking.missed = start
        booking.inside = False
        return True

    def finish(self, robot: int, trigger: Instant, entered: bool) -> bool:
        """A job is over; return whether it was in the books. Who never entered leaves its rank to others."""
        booking = self.bookings.get(robot)
        if booking is None or booking.trigger > trigger:
            return False
        del self.bookings[robot]
        booking.done = True
        if entered:
            self._count_passage(booking)
            if booking.rank is not None:
                self.done[booking.rank] = booking
        return True

    def confirm_over(self, robot: int, trigger: Instant) -> bool:
        """A job has said that it is over; return whether it was only presumed so."""
        booking = next((booking for booking in self.done.values() if booking.robot == robot and booking.presumed), None)
        if booking is None or booking.trigger > trigger:
            return False
        booking.presumed = False
        return True

    def _book(self, robot: int, trigger: Instant, now: Instant) -> Booking:
        """Return a new booking for a job; one that was only presumed to be over gets its rank back."""
        booking = Booking(robot, trigger, now)
        for rank, done in self.done.items():
            if done.presumed and (done.robot, done.trigger) == (robot, trigger):
                booking.rank = rank
                del self.done[rank]
                break
        return booking

    def _count_passage(self, passed: Booking) -> None:
        """Count a passage for the jobs that it has overtaken."""
        for booking in self.waiting():
            booking.overtaken += 1
            booking.bypassed += booking.joined < passed.joined

    def inherit(self, now: Instant, entries: Iterable[Entry], exact: bool, fence: Fence) -> list[Entry]:
        """Take over a predecessor's list; return the entries that had started. `exact`: keep the slots."""
        started = []
        for rank, entry in enumerate(entries, self.passed + 1):
            if entry.robot == NOBODY:
                continue
            booking = Booking(entry.robot, entry.trigger, now)
            booking.duration = entry.duration
            booking.direction = entry.direction
            booking.headway = self._headway
            booking.rank = rank
            finished = entry.phase is Phase.OUT or fence.is_finished(entry.robot, entry.trigger)
            if finished or entry.phase is Phase.GONE:
                booking.done = True
                booking.presumed = not finished
                self.done[rank] = booking
                continue
            known = self.bookings.get(entry.robot)
            if known is not None and known.trigger >= entry.trigger:
                if known.trigger == entry.trigger:
                    known.rank = rank
                continue
            booking.provisional = True
            has_started = entry.start is not None and entry.start <= now
            if entry.start is not None and (exact or has_started):
                booking.start = entry.start
                booking.until = entry.start + entry.duration
                booking.deadline = booking.until
            if entry.phase is Phase.IN or (has_started and not exact):
                started.append(entry)
            self.bookings[entry.robot] = booking
        return started

    # -- the plan --------------------------------------------------------------------------------------

    def observe(self, now: Instant, fence: Fence) -> bool:
        """Bring the reservations up to date with the beacons; return whether anything is free or taken anew."""
        timing = self._timing
        changed = False
        for beacon in fence.inside(now):
            booking = self.bookings.get(beacon.who)
            if booking is None or booking.trigger < beacon.trigger:
                self.bookings[beacon.who] = booking = self._book(beacon.who, beacon.trigger, now)
                booking.direction = beacon.direction
                booking.headway = self._headway
                booking.provisional = False
                booking.duration = beacon.end - beacon.start
            if booking.trigger != beacon.trigger or booking.missed == beacon.start:
                continue
            this_slot = (
                booking.start is not None and booking.start <= beacon.start <= booking.start + timing.schedule.window
            )
            until = beacon.end if this_slot and beacon.phase is Phase.IN else max(beacon.end, booking.until)
            until = max(until, now)
            changed = changed or not booking.inside or beacon.start != booking.start
            booking.inside = True
            booking.start = beacon.start
            booking.until = until
            booking.heard = max(booking.heard, beacon.time)
        for booking in list(self.bookings.values()):
            changed = self._expire(now, booking, fence) or changed
        return changed

    def _expire(self, now: Instant, booking: Booking, fence: Fence) -> bool:
        timing = self._timing
        if booking.inside:
            record = fence.records.get(booking.robot)
            if record is not None and record.beacon.phase is Phase.YIELD:
                booking.inside = False
                booking.start = None
                return True
            if booking.robot == self._robot or (record is not None and fence.is_inside(record.beacon, now)):
                return False
            booking.presumed = not fence.is_finished(booking.robot, booking.trigger)
            return self.finish(booking.robot, booking.trigger, entered=True)
        if booking.start is not None and now > booking.until + timing.schedule.window:
            booking.start = None
            return True
        if booking.robot == self._robot:
            return False
        silent = now - booking.heard
        waiting = booking.start is None or booking.start > now + timing.schedule.frozen
        if waiting and silent > (timing.liveness.drop_provisional if booking.provisional else timing.liveness.drop):
            del self.bookings[booking.robot]
            return True
        return False

    def stands(self, booking: Booking, now: Instant) -> bool:
        """Return whether the slot of `booking` must not be moved."""
        if booking.inside:
            return True
        return booking.start is not None and (
            booking.start <= now + self._timing.schedule.frozen or booking.provisional
        )

    def plan(self, now: Instant, reorder: bool, eager: bool = False) -> bool:
        """Give slots and ranks; return whether any has changed. `eager`: the leader's own job may start at once."""
        before = [(booking.start, booking.rank) for booking in self.bookings.values()]
        standing = [booking for booking in self.bookings.values() if self.stands(booking, now)]
        pinned = [booking for booking in standing if booking.rank is not None]
        if self.open:
            known = {booking.robot for booking in standing}
            movable = [one for one in self.bookings.values() if one.robot not in known and not one.provisional]
            if movable:
                Planner(self._robot, self._timing, now, reorder=reorder, eager=eager).place(standing, movable)
        self._deal(pinned)
        self._trim(now)
        return before != [(booking.start, booking.rank) for booking in self.bookings.values()]

    def _deal(self, pinned: list[Booking]) -> None:
        """Give the free ranks to all that have no fixed one, in order of their slots."""
        taken = {booking.rank for booking in pinned if booking.rank is not None} | set(self.done)
        fixed = {booking.robot for booking in pinned}
        rest = sorted(
            (booking for booking in self.bookings.values() if booking.robot not in fixed),
            key=lambda booking: (
                NEVER if booking.start is None else booking.start,
                (booking.rank or math.inf) if booking.provisional else math.inf,
                booking.deadline,
                booking.robot,
            ),
        )
        rank = self.passed
        for booking in rest:
            rank += 1
            while rank in taken:
                rank += 1
            booking.rank = rank

    def _trim(self, now: Instant) -> None:
        """Count the jobs at the head of the list that are done; of a long list by whole frames, or all would change.

        A job that is only presumed to be over stays listed for a while, so that newcomers enter with caution.
        """
        live = {booking.rank for booking in self.bookings.values()}
        cautious = now - 3 * self._timing.liveness.gone
        live |= {rank for rank, booking in self.done.items() if booking.presumed and booking.heard > cautious}
        top = max(self.done, default=self.passed)
        first = self.passed + 1
        while first <= top and first not in live:
            first += 1
        full = entries_max(self._timing.payload_max)
        if len(live) > 2 * full:
            first -= (first - 1 - self.passed) % full
        for rank in range(self.passed + 1, first):
            self.done.pop(rank, None)
        self.passed = first - 1

    # -- what is said ----------------------------------------------------------------------------------

    def entries(self) -> list[Entry]:
        """Return all bookings by rank; ranks that nobody holds are void."""
        by_rank = {booking.rank: booking for booking in self.bookings.values() if booking.rank is not None} | self.done
        room = entries_max(self._timing.payload_max) * PARTS_MAX
        top = min(max(by_rank, default=self.passed), self.passed + room)
        return [entry_of(by_rank[rank]) if rank in by_rank else _VOID for rank in range(self.passed + 1, top + 1)]

    def waiting(self) -> list[Booking]:
        """Return the jobs that are not inside."""
        return [booking for booking in self.bookings.values() if not booking.inside]

    def gathers(self, now: Instant, robot: int) -> Duration:
        """Return for how long news of `robot` may wait for others before the plan is made anew.

        A plan costs more the more jobs there are, and so does telling it: news that concerns nobody soon waits longer.
        """
        timing = self._timing
        booking = self.bookings.get(robot)
        if booking is not None and booking.start is not None and booking.start <= now + timing.schedule.soon:
            return timing.schedule.replan_wait
        return max(
            timing.schedule.replan_wait,
            timing.schedule.replan_job * (len(self.bookings) - entries_max(timing.payload_max)),
        )

    def heir(self) -> int:
        """Return the waiting robot with the latest slot, NOBODY when nobody else waits."""
        others = [booking for booking in self.waiting() if booking.robot != self._robot]
        if not others:
            return NOBODY
        return max(others, key=lambda booking: (booking.start or 0, -booking.robot)).robot

    def wait(self, now: Instant, peers: int) -> Duration:
        """Return the paper's waiting time n: how much longer to wait for joins before giving slots.

        Waiting x costs the k jobs noted k x of lateness and spares p peers not yet noted, of whom
        exp(-x / tau) come later still, a delay c each; the sum is least at tau ln(p c / (k tau)). Lateness
        turns into misses as 1 / slack, so the slack only bounds it. While somebody is missing, answers to the
        announcement are waited for, too. A robot known from a predecessor's list only is missing.
        """
        timing = self._timing
        if timing.schedule.wait is not None:
            return timing.schedule.wait
        told = [booking for booking in self.bookings.values() if not booking.provisional]
        missing = peers - sum(booking.robot != self._robot for booking in told)
        if missing <= 0 or not told:
            return 0
        delay = timing.schedule.frozen / 2 + max(booking.headway for booking in told)
        best = timing.schedule.spread * math.log(max(missing * delay / (len(told) * timing.schedule.spread), 1.0))
        slack = min(booking.deadline - booking.duration - max(now, booking.release) for booking in told)
        return int(max(0.0, min(max(best, self.answered - now), slack / 4, timing.schedule.wait_max)))
