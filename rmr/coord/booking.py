"""One job in the books of a leader, as the order of jobs and the schedule see it."""

from rmr.base.direction import EXCLUSIVE
from rmr.base.time import NEVER, Duration, Instant
from rmr.coord.messages import Entry, Job, Phase, on_grid
from rmr.coord.schedule import Task
from rmr.coord.timing import MS, ScheduleTiming


class Booking:
    """One job in the books."""

    __slots__ = (
        "absent",
        "among",
        "approach",
        "behind",
        "bypassed",
        "deadline",
        "direction",
        "done",
        "duration",
        "headway",
        "heard",
        "inside",
        "joined",
        "missed",
        "missed_absent",
        "overtaken",
        "presumed",
        "provisional",
        "rank",
        "release",
        "retry",
        "robot",
        "said",
        "start",
        "trigger",
        "underway",
        "until",
    )

    def __init__(self, robot: int, trigger: Instant, now: Instant) -> None:
        self.robot = robot
        self.trigger = trigger
        self.joined = now
        self.approach: Duration = 0
        """Travel time to the entrance from where the robot reported its release; the whole approach until its slot is
        near."""
        self.release: Instant = 0
        self.duration: Duration = 0
        self.deadline: Instant = NEVER
        self.headway: Duration = 0
        self.direction = 0
        self.start: Instant | None = None
        self.until: Instant = 0
        """End of the reservation that the start begins."""
        self.rank: int | None = None
        self.inside = False
        self.underway = False
        """Has set out and was put off: it goes before those that have not set out."""
        self.done = False
        self.presumed = False
        """Done, but only for its owner has been silent for too long."""
        self.provisional = False
        """Known from the predecessor's list only."""
        self.missed: Instant | None = None
        self.absent = 0
        """Slots in a row that the owner missed because it was not ready; 0 when it is."""
        self.retry: Instant = 0
        """No slot before this, for the last one was missed so."""
        self.overtaken = 0
        """Passages of others since then."""
        self.missed_absent: Instant | None = None
        """Start of the last slot that it missed so."""
        self.bypassed = 0
        """Passages of others that joined later."""
        self.among = 0
        """The greatest number of jobs in the books, at a passage, while it waited."""
        self.behind = False
        """Has its place behind all others for now."""
        self.heard = now
        self.said: Instant = -1
        """Time of the newest JOB frame."""

    def tell(self, job: Job) -> bool:
        """Take over what the owner says; return whether it matters for the order."""
        new = (max(job.release, job.time), job.duration, job.deadline, job.headway, job.direction, job.underway)
        old = (max(self.release, job.time), self.duration, self.deadline, self.headway, self.direction, self.underway)
        self.said = job.time
        changed = self.provisional or new != old
        self.provisional = False
        # A frame tells a release that is past as one of now: it is a repeat, and the robot is as far away as it was.
        # What is no passage is not approached: there the release is when the robot will have done what comes before.
        if job.release > job.time and job.release != self.release and job.direction != EXCLUSIVE:
            self.approach = job.release - job.time
        _, self.duration, self.deadline, self.headway, self.direction, self.underway = new
        self.release = job.release
        return changed

    def set_absent(self, job: Job, retry: Instant) -> bool:
        """Take over how many slots in a row the owner has missed because it was not ready; return whether that is news.

        After one more of them it gets no slot before `retry`.
        """
        if (job.absent, job.absent and job.missed) == (self.absent, self.absent and self.missed_absent):
            return False
        self.retry, self.overtaken = (retry, 0) if job.absent else (0, 0)
        self.absent = job.absent
        self.missed_absent = job.missed
        return True

    def is_behind(self, schedule: ScheduleTiming) -> bool:
        """Return whether the job goes behind all others, because its robot was not ready when its last slot came.

        It does until the robot is ready, or a bounded number of others have passed.
        """
        return self.absent > 0 and not self.underway and self.overtaken < self._passes(schedule)

    def is_due(self, schedule: ScheduleTiming) -> bool:
        """Return whether the job goes before all others, for as many have overtaken it as may.

        Each of those that it waits among may go before it, in whatever order they have asked: robots that begin at the
        same time ask within a second or two.
        """
        if self.absent > 0:
            return self.overtaken >= self._passes(schedule)
        return self.bypassed >= max(schedule.bypass_max, self.among)

    def _passes(self, schedule: ScheduleTiming) -> int:
        """Return how many others may pass before a job whose robot was not ready."""
        return doubled(schedule.absent_passes, self.absent, schedule.absent_passes_max)

    def has_set_out(self, now: Instant) -> bool:
        """Return whether the robot, which sets out just in time for its slot, has done so."""
        # A robot may have set out earlier than its approach requires by this.
        return self.start is not None and self.start - self.approach <= now + 500 * MS


def task_of(booking: Booking, now: Instant, grace: Duration) -> Task:
    """Return a job as the order sees it: one that has a slot in time is given a little grace.

    A robot that waits for a slot stands. Its release is past although it is not at the entrance: it can keep the slot
    it has, but another one only after its whole approach.
    """
    release = max(booking.release, now + booking.approach, booking.retry)
    if booking.start is not None:
        release = min(release, max(booking.release, booking.start))
    if booking.start is None or booking.start + booking.duration > booking.deadline + grace:
        grace = 0
    return Task(
        booking.robot,
        release,
        booking.duration,
        booking.deadline,
        booking.headway,
        booking.direction,
        booking.joined,
        grace,
    )


def entry_of(booking: Booking) -> Entry:
    """Return a job as the schedule lists it."""
    phase = Phase.IN if booking.inside else Phase.WAITING
    if booking.done:
        phase = Phase.GONE if booking.presumed else Phase.OUT
    if booking.provisional and phase is Phase.WAITING:
        phase = Phase.PROVISIONAL
    start = None if booking.start is None else on_grid(booking.start)
    duration = booking.duration if booking.start is None else max(booking.until - booking.start, 0)
    return Entry(booking.robot, booking.trigger, start, duration, booking.direction, phase)


def doubled(first: int, times: int, most: int) -> int:
    """Return `first` doubled with each of `times` after the first one, up to `most`."""
    return min(first << max(times - 1, 0), most)
