"""The leader's books: the jobs of its group, their slots and their ranks.

Slots. A slot nearer than the frozen zone is fixed: it is neither moved nor its time used for another until its
owner sends OUT or GONE, or reports that it missed this very slot. A robot inside, of whatever term, keeps its place
until it sends OUT or is presumed gone. All others are placed behind the fixed slots; their order is computed anew only
when jobs are added, end or change. A robot that has set out and was deferred goes first, since the others would have to
pass it; of more than `EXACT_MAX` jobs all that have set out do, and before them those that do not delay them. Jobs that
were not ready for their slots go last, jobs that enough others have overtaken first.

Ranks. The entries of a schedule are in order of rank. A rank is fixed once its slot is in the frozen zone, because exit
and queue places depend on it. Free ranks are assigned to the others in order of their slots. Finished jobs keep their
rank until all before them are finished too; then `passed` counts them instead.
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

    def __init__(self, robot: int, timing: Timing, passed: int, headway: Duration, capacity: int = 1) -> None:
        """`capacity`: how many robots may be inside at a time."""
        self._robot = robot
        self._capacity = capacity
        self._timing = timing
        self._headway = headway
        """For robots whose own headway is not known."""
        self.passed = passed
        self.bookings: dict[int, Booking] = {}
        """Live jobs by robot."""
        self.done: dict[int, Booking] = {}
        """By rank: finished jobs, as long as an unfinished one is before them."""
        self.opens: Instant = NEVER
        """When slots are given for the first time."""
        self.answered: Instant = 0
        """By when all answers to the announcement should be here."""
        self.open = False

    # -- news ------------------------------------------------------------------------------------------

    def note(self, now: Instant, robot: int, job: Job, fence: Fence) -> bool:
        """Process a JOB frame; return whether a new plan is needed."""
        # OUT and GONE are final: this is a late repeat of a finished job.
        if fence.is_finished(robot, job.trigger):
            return False
        booking = self.bookings.get(robot)
        # A robot has one job at a time, so a smaller trigger is a late frame of an earlier job.
        if booking is not None and job.trigger < booking.trigger:
            return False
        if booking is None or job.trigger > booking.trigger:
            # The books are bounded. A robot that is refused repeats its JOB until it is listed.
            if booking is None and len(self.bookings) >= JOBS_MAX:
                return False
            self.bookings[robot] = booking = self._book(robot, job.trigger, now)
            # The age of information counts from the frame's own time, however late it arrives.
            booking.heard = job.time
        elif job.time < booking.said:
            return False  # reordered: a newer frame of this job has been processed
        timing = self._timing
        booking.heard = max(booking.heard, job.time)
        # The first JOB frame of this booking, which may come from a predecessor's list or a beacon.
        changed = booking.said < 0
        # A robot with a JOB frame waits. So it is not inside, if that was only assumed from a predecessor's list.
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
        """Free a slot that its owner has reported as missed, even if its claim has made it count as inside."""
        booking = self.bookings.get(robot)
        # Only this very slot: a late report must not free the slot that the job has got since.
        if booking is None or booking.start != start:
            return False
        booking.start = None
        booking.missed = start
        booking.inside = False
        return True

    def finish(self, robot: int, trigger: Instant, entered: bool) -> bool:
        """End a job; return whether it was in the books. A robot that never entered leaves its rank to others."""
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
        """Confirm the end of a job that was only presumed over; return whether it was."""
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
            booking.among = max(booking.among, len(self.bookings))
            booking.overtaken += 1
            booking.bypassed += booking.joined < passed.joined

    def inherit(self, now: Instant, entries: Iterable[Entry], exact: bool, fence: Fence) -> list[Entry]:
        """Take over a predecessor's list; return the entries that had started. `exact`: keep the slots."""
        started = []
        for rank, entry in enumerate(entries, self.passed + 1):
            if entry.robot == NOBODY:
                continue  # a void rank
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
            # A JOB frame of the robot itself is better than the list; of the same job it keeps the rank.
            known = self.bookings.get(entry.robot)
            if known is not None and known.trigger >= entry.trigger:
                if known.trigger == entry.trigger:
                    known.rank = rank
                continue
            # Release, deadline and headway are unknown until the owner repeats its JOB.
            booking.provisional = True
            has_started = entry.start is not None and entry.start <= now
            # An heir continues the slots. After a takeover only a slot that has begun counts: its owner may be inside.
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
        """Update the reservations by the beacons; return whether a place was freed or taken."""
        timing = self._timing
        changed = False
        for beacon in fence.inside(now):
            booking = self.bookings.get(beacon.who)
            # A robot that entered under another leader, or whose JOB was lost, takes its place all the same.
            if booking is None or booking.trigger < beacon.trigger:
                self.bookings[beacon.who] = booking = self._book(beacon.who, beacon.trigger, now)
                booking.direction = beacon.direction
                booking.headway = self._headway
                booking.provisional = False
                booking.duration = beacon.end - beacon.start
            # A beacon of an earlier job; or a claim past its window, which counts as inside, for a slot that its owner
            # has reported as missed.
            if booking.trigger != beacon.trigger or booking.missed == beacon.start:
                continue
            # Anything new may lengthen a reservation; only IN of this very slot may shorten it.
            this_slot = (
                booking.start is not None and booking.start <= beacon.start <= booking.start + timing.schedule.window
            )
            until = beacon.end if this_slot and beacon.phase is Phase.IN else max(beacon.end, booking.until)
            until = max(until, now)  # a robot that overruns its announced end is still inside
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
            # It counted as inside by a claim past its window; now it has announced that it did not enter.
            if record is not None and record.beacon.phase is Phase.YIELD:
                booking.inside = False
                booking.start = None
                return True
            if booking.robot == self._robot or (record is not None and fence.is_inside(record.beacon, now)):
                return False
            # Over by OUT, or silent for so long that it is presumed over. Either way the place is free.
            booking.presumed = not fence.is_finished(booking.robot, booking.trigger)
            return self.finish(booking.robot, booking.trigger, entered=True)
        # The whole slot has passed without a word of its owner: no claim, no entry, no report that it was missed.
        if booking.start is not None and now > booking.until + timing.schedule.window:
            booking.start = None
            return True
        if booking.robot == self._robot:
            return False  # the leader does not hear itself
        # A silent waiting job is dropped, but not from the frozen zone: its owner may still enter under a schedule that
        # it holds.
        silent = now - booking.heard
        waiting = booking.start is None or booking.start > now + timing.schedule.frozen
        if waiting and silent > (timing.liveness.drop_provisional if booking.provisional else timing.liveness.drop):
            del self.bookings[booking.robot]
            return True
        return False

    def stands(self, booking: Booking, now: Instant) -> bool:
        """Return whether the slot of `booking` must not be moved.

        An inherited slot is not moved before its owner has been heard: it may hold a lease of the predecessor.
        """
        if booking.inside:
            return True
        return booking.start is not None and (
            booking.start <= now + self._timing.schedule.frozen or booking.provisional
        )

    def plan(self, now: Instant, reorder: bool, eager: bool = False) -> bool:
        """Assign slots and ranks; return whether any has changed. `eager`: the leader's own job may start at once."""
        before = [(booking.start, booking.rank) for booking in self.bookings.values()]
        standing = [booking for booking in self.bookings.values() if self.stands(booking, now)]
        pinned = [booking for booking in standing if booking.rank is not None]
        if self.open:  # before that jobs are gathered, and only ranks are assigned
            known = {booking.robot for booking in standing}
            # Of a provisional job neither release nor deadline is known, so it cannot be placed.
            movable = [one for one in self.bookings.values() if one.robot not in known and not one.provisional]
            if movable:
                planner = Planner(self._robot, self._timing, now, reorder=reorder, eager=eager, capacity=self._capacity)
                planner.place(standing, movable)
        self._deal(pinned)
        self._trim(now)
        return before != [(booking.start, booking.rank) for booking in self.bookings.values()]

    def _deal(self, pinned: list[Booking]) -> None:
        """Assign the free ranks to all jobs without a fixed one, in order of their slots.

        Jobs without a slot follow: provisional ones in the order of the predecessor, then by deadline.
        """
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
        """Drop the finished jobs at the head of the list, and count them in `passed`.

        Of a long list whole frames are dropped: otherwise the contents of every frame would shift with each passage.


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

    # -- the schedule ----------------------------------------------------------------------------------

    def entries(self) -> list[Entry]:
        """Return all bookings by rank, with void entries for ranks without a job."""
        by_rank = {booking.rank: booking for booking in self.bookings.values() if booking.rank is not None} | self.done
        room = entries_max(self._timing.payload_max) * PARTS_MAX
        top = min(max(by_rank, default=self.passed), self.passed + room)
        return [entry_of(by_rank[rank]) if rank in by_rank else _VOID for rank in range(self.passed + 1, top + 1)]

    def waiting(self) -> list[Booking]:
        """Return the jobs that are not inside."""
        return [booking for booking in self.bookings.values() if not booking.inside]

    def gathers(self, now: Instant, robot: int) -> Duration:
        """Return how long a change of `robot` may wait for others before a new plan is made.

        The cost of a plan, and of sending it, grows with the number of jobs. So a change that affects no near slot
        waits longer.
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
        """Return the waiting robot with the latest slot, NOBODY if no other robot waits."""
        others = [booking for booking in self.waiting() if booking.robot != self._robot]
        if not others:
            return NOBODY
        return max(others, key=lambda booking: (booking.start or 0, -booking.robot)).robot

    def wait(self, now: Instant, peers: int) -> Duration:
        """Return the paper's waiting time n: how much longer to wait for joins before giving slots.

        Waiting x costs the k jobs noted k x of lateness. Of p peers not yet noted the share exp(-x / tau) comes later
        still and loses c each. The sum is least at tau ln(p c / (k tau)). The slack only bounds it, since lateness
        turns into misses in proportion to 1 / slack for all jobs. While a peer is missing, the leader also waits for
        the answers to its announcement. A robot that is known only from a predecessor's list is missing.
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
