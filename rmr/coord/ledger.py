"""The leader's books: the jobs of its group, their slots and their ranks.

Slots. A slot nearer than the frozen zone stands: it is neither moved nor its time used for another until its
owner says OUT or GONE, or that it let this very slot pass. A robot inside, of whatever term, keeps its place
until it says OUT or is presumed gone. All others are placed behind those that stand; their order is made anew only when
jobs come, go or change. A robot that has set out and was put off goes first, for the others would have to pass it; of
more than `EXACT_MAX` jobs all that have set out do, and before them those that do not hold them up. Jobs that were not
ready for their slots go last, jobs that enough others have overtaken first.

Ranks. The entries of a schedule stand in order of rank, and a rank is a robot's for good from the frozen zone
on (exit and queue places go by it). Free ranks are dealt to the others in order of their slots. Jobs that are
done keep their line until all before them are done too; then `passed` counts them instead.
"""

import math
from collections.abc import Iterable
from typing import Final

from rmr.base.time import NEVER, Duration, Instant
from rmr.coord.fence import Fence
from rmr.coord.ledger_job import Line, entry_of, task_of
from rmr.coord.messages import PARTS_MAX, Entry, Job, Phase, entries_max
from rmr.coord.schedule import EXACT_MAX, Placed, Rules, Task, merge, on_time, order_jobs, place
from rmr.coord.term import NOBODY
from rmr.coord.timing import JOBS_MAX, Order, Timing

_VOID: Final = Entry(NOBODY, 0, None, 0, 0, Phase.OUT)


class Ledger:
    """All jobs of one group, as its leader sees them."""

    def __init__(self, robot: int, timing: Timing, passed: int, headway: Duration) -> None:
        self._robot = robot
        self._timing = timing
        self._headway = headway
        """For robots whose own headway is not known."""
        self.passed = passed
        self.lines: dict[int, Line] = {}
        """Live jobs by robot."""
        self.done: dict[int, Line] = {}
        """By rank: jobs that are over, before some that are not."""
        self.opens: Instant = NEVER
        """When slots are given for the first time."""
        self.answered: Instant = 0
        """By when all answers to the announcement should be here."""
        self.open = False
        self._eager = False

    # -- news ------------------------------------------------------------------------------------------

    def note(self, now: Instant, robot: int, job: Job, fence: Fence) -> bool:
        """Take in a JOB; return whether the plan must be made anew."""
        if fence.is_finished(robot, job.trigger):
            return False
        line = self.lines.get(robot)
        if line is not None and job.trigger < line.trigger:
            return False
        if line is None or job.trigger > line.trigger:
            if line is None and len(self.lines) >= JOBS_MAX:
                return False
            self.lines[robot] = line = self._line(robot, job.trigger, now)
            line.heard = job.time
        elif job.time < line.said:
            return False
        timing = self._timing
        line.heard = max(line.heard, job.time)
        changed = line.said < 0
        fence.refute(robot, job.time)
        if line.inside and robot not in fence.records:
            line.inside, line.start, changed = False, None, True
        if job.missed is not None:
            changed = self.missed(robot, job.missed) or changed
        retry = now + _doubled(timing.schedule.absent_wait, job.absent, timing.schedule.absent_wait_max)
        changed = line.set_absent(job, retry) or changed
        return line.tell(job) or changed

    def missed(self, robot: int, start: Instant) -> bool:
        """The owner said that it let that slot pass, though a claim may have made it count as inside."""
        line = self.lines.get(robot)
        if line is None or line.start != start:
            return False
        line.start, line.missed, line.inside = None, start, False
        return True

    def finish(self, robot: int, trigger: Instant, entered: bool) -> bool:
        """A job is over; return whether it was in the books. Who never entered leaves its rank to others."""
        line = self.lines.get(robot)
        if line is None or line.trigger > trigger:
            return False
        del self.lines[robot]
        line.done = True
        if entered:
            self._count_passage(line)
            if line.rank is not None:
                self.done[line.rank] = line
        return True

    def confirm_over(self, robot: int, trigger: Instant) -> bool:
        """A job has said that it is over; return whether it was only presumed so."""
        line = next((line for line in self.done.values() if line.robot == robot and line.presumed), None)
        if line is None or line.trigger > trigger:
            return False
        line.presumed = False
        return True

    def _line(self, robot: int, trigger: Instant, now: Instant) -> Line:
        """Return a new line for a job; one that was only presumed to be over gets its rank back."""
        line = Line(robot, trigger, now)
        for rank, done in self.done.items():
            if done.presumed and (done.robot, done.trigger) == (robot, trigger):
                line.rank = rank
                del self.done[rank]
                break
        return line

    def _count_passage(self, passed: Line) -> None:
        """Count a passage for the jobs that it has overtaken."""
        for line in self.waiting():
            line.overtaken += 1
            line.bypassed += line.joined < passed.joined

    def _is_behind(self, line: Line) -> bool:
        """Return whether a job goes behind all others, for its owner was not ready when its last slot came.

        It does until its owner is ready, or a bounded number of others have passed.
        """
        return line.absent > 0 and not line.underway and line.overtaken < self._passes(line)

    def _is_due(self, line: Line) -> bool:
        """Return whether a job goes before all others, for as many have overtaken it as may."""
        if line.absent > 0:
            return line.overtaken >= self._passes(line)
        return line.bypassed >= self._timing.schedule.bypass_max

    def _passes(self, line: Line) -> int:
        """Return how many others may pass before a job whose owner was not ready."""
        timing = self._timing
        return _doubled(timing.schedule.absent_passes, line.absent, timing.schedule.absent_passes_max)

    def inherit(self, now: Instant, entries: Iterable[Entry], exact: bool, fence: Fence) -> list[Entry]:
        """Take over a predecessor's list; return the entries that had started. `exact`: keep the slots."""
        started = []
        for rank, entry in enumerate(entries, self.passed + 1):
            if entry.robot == NOBODY:
                continue
            line = Line(entry.robot, entry.trigger, now)
            line.duration, line.way, line.headway, line.rank = entry.duration, entry.way, self._headway, rank
            finished = entry.phase is Phase.OUT or fence.is_finished(entry.robot, entry.trigger)
            if finished or entry.phase is Phase.GONE:
                line.done, line.presumed = True, not finished
                self.done[rank] = line
                continue
            known = self.lines.get(entry.robot)
            if known is not None and known.trigger >= entry.trigger:
                if known.trigger == entry.trigger:
                    known.rank = rank
                continue
            line.provisional = True
            has_started = entry.start is not None and entry.start <= now
            if entry.start is not None and (exact or has_started):
                line.start, line.until = entry.start, entry.start + entry.duration
                line.deadline = line.until
            if entry.phase is Phase.IN or (has_started and not exact):
                started.append(entry)
            self.lines[entry.robot] = line
        return started

    # -- the plan --------------------------------------------------------------------------------------

    def observe(self, now: Instant, fence: Fence) -> bool:
        """Bring the reservations up to date with the beacons; return whether anything is free or taken anew."""
        timing = self._timing
        changed = False
        for beacon in fence.inside(now):
            line = self.lines.get(beacon.who)
            if line is None or line.trigger < beacon.trigger:
                self.lines[beacon.who] = line = self._line(beacon.who, beacon.trigger, now)
                line.way, line.headway, line.provisional = beacon.way, self._headway, False
                line.duration = beacon.end - beacon.start
            if line.trigger != beacon.trigger or line.missed == beacon.start:
                continue
            this_slot = line.start is not None and line.start <= beacon.start <= line.start + timing.schedule.window
            until = beacon.end if this_slot and beacon.phase is Phase.IN else max(beacon.end, line.until)
            until = max(until, now)
            changed = changed or not line.inside or beacon.start != line.start
            line.inside, line.start, line.until = True, beacon.start, until
            line.heard = max(line.heard, beacon.time)
        for line in list(self.lines.values()):
            changed = self._expire(now, line, fence) or changed
        return changed

    def _expire(self, now: Instant, line: Line, fence: Fence) -> bool:
        timing = self._timing
        if line.inside:
            record = fence.records.get(line.robot)
            if record is not None and record.beacon.phase is Phase.YIELD:
                line.inside, line.start = False, None
                return True
            if line.robot == self._robot or (record is not None and fence.is_inside(record.beacon, now)):
                return False
            line.presumed = not fence.is_finished(line.robot, line.trigger)
            return self.finish(line.robot, line.trigger, entered=True)
        if line.start is not None and now > line.until + timing.schedule.window:
            line.start = None
            return True
        if line.robot == self._robot:
            return False
        silent = now - line.heard
        waiting = line.start is None or line.start > now + timing.schedule.frozen
        if waiting and silent > (timing.liveness.drop_provisional if line.provisional else timing.liveness.drop):
            del self.lines[line.robot]
            return True
        return False

    def stands(self, line: Line, now: Instant) -> bool:
        """Return whether a line's slot is not to be moved."""
        if line.inside:
            return True
        return line.start is not None and (line.start <= now + self._timing.schedule.frozen or line.provisional)

    def plan(self, now: Instant, reorder: bool, eager: bool = False) -> bool:
        """Give slots and ranks; return whether any has changed. `eager`: the leader's own job may start at once."""
        self._eager = eager
        before = [(line.start, line.rank) for line in self.lines.values()]
        standing = [line for line in self.lines.values() if self.stands(line, now)]
        pinned = [line for line in standing if line.rank is not None]
        if self.open:
            self._place(now, standing, reorder)
        self._deal(pinned)
        self._trim(now)
        return before != [(line.start, line.rank) for line in self.lines.values()]

    def _place(self, now: Instant, standing: list[Line], reorder: bool) -> None:
        timing = self._timing
        known = {line.robot for line in standing}
        movable = [line for line in self.lines.values() if line.robot not in known and not line.provisional]
        if not movable:
            return
        fixed = [
            Placed(line.start, max(line.until - line.start, 0), line.headway, line.way)
            for line in standing
            if line.start is not None
        ]
        opposed = timing.schedule.window + 2 * timing.clock_error + timing.schedule.clear
        rules = Rules(now if self._eager else now + timing.schedule.lead, opposed, timing.order)
        many = len(movable) > EXACT_MAX and timing.order is Order.OURS
        for line in movable:
            was, line.behind = line.behind, self._is_behind(line)
            if was and not line.behind:
                line.start = None  # it comes in anew
        last = sorted((line for line in movable if line.behind), key=lambda line: (line.retry, line.robot))
        movable = [line for line in movable if not line.behind]
        passed_over = sorted(
            (line for line in movable if self._is_due(line)), key=lambda line: (line.joined, line.robot)
        )
        first = [
            line for line in movable if line not in passed_over and (line.underway or (many and line.has_set_out(now)))
        ]
        first.sort(key=lambda line: (line.approach if line.underway else (line.start or now) - now, line.robot))
        first = passed_over + first
        ahead = [self._task(line, now) for line in first]
        behind = fixed + self._give(ahead, fixed, rules)
        known = {line.robot for line in first}
        rest = self._ordered(now, [line for line in movable if line.robot not in known], behind, rules, reorder)
        if many:
            rest, behind = merge(ahead, rest, fixed, rules), fixed
        behind = behind + self._give(rest, behind, rules)
        self._give([self._task(line, now) for line in last], behind, rules)

    def _ordered(self, now: Instant, lines: list[Line], fixed: list[Placed], rules: Rules, reorder: bool) -> list[Task]:
        """Return the jobs of `lines` in the order in which they go behind those `fixed`."""
        tasks = {line.robot: self._task(line, now) for line in lines}
        slotted = [(line.start, line.robot) for line in lines if line.start is not None]
        old = [robot for _, robot in sorted(slotted)]
        if reorder or len(old) < len(lines):
            order = order_jobs(list(tasks.values()), fixed, rules, old)
            return self._own_first(order, fixed, rules) if self._eager else order
        return [tasks[robot] for robot in old]

    def _own_first(self, order: list[Task], fixed: list[Placed], rules: Rules) -> list[Task]:
        """Return `order` with the leader's own job, which may start at once, first if that makes nobody else late.

        Not before a job that is due sooner by more than the time that the others need to claim.
        """
        own = [task for task in order if task.robot == self._robot]
        if not own or own[0].deadline > order[0].deadline + self._timing.schedule.lead:
            return order
        moved = own + [task for task in order if task.robot != self._robot]
        met = on_time(order, place(order, fixed, rules))
        return moved if on_time(moved, place(moved, fixed, rules)) >= met else order

    def _task(self, line: Line, now: Instant) -> Task:
        """Return a job as the order sees it: only the leader's own one may start before it could be claimed."""
        task = task_of(line, now, self._timing.schedule.grace)
        if not self._eager or line.robot == self._robot:
            return task
        return task._replace(release=max(task.release, now + self._timing.schedule.lead))

    def _give(self, tasks: list[Task], fixed: list[Placed], rules: Rules) -> list[Placed]:
        """Give slots behind those `fixed` to the jobs of `tasks`, in this order, and return these."""
        starts = place(tasks, fixed, rules)
        for task, start in zip(tasks, starts, strict=True):
            line = self.lines[task.robot]
            line.start, line.until = start, start + line.duration
        return [Placed(start, task.duration, task.headway, task.way) for task, start in zip(tasks, starts, strict=True)]

    def _deal(self, pinned: list[Line]) -> None:
        """Give the free ranks to all that have none for good, in order of their slots."""
        taken = {line.rank for line in pinned if line.rank is not None} | set(self.done)
        fixed = {line.robot for line in pinned}
        rest = sorted(
            (line for line in self.lines.values() if line.robot not in fixed),
            key=lambda line: (
                NEVER if line.start is None else line.start,
                (line.rank or math.inf) if line.provisional else math.inf,
                line.deadline,
                line.robot,
            ),
        )
        rank = self.passed
        for line in rest:
            rank += 1
            while rank in taken:
                rank += 1
            line.rank = rank

    def _trim(self, now: Instant) -> None:
        """Count the jobs at the head of the list that are done; of a long list by whole frames, or all would change.

        A job that is only presumed to be over stays listed for a while, so that newcomers enter with caution.
        """
        live = {line.rank for line in self.lines.values()}
        cautious = now - 3 * self._timing.liveness.gone
        live |= {rank for rank, line in self.done.items() if line.presumed and line.heard > cautious}
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
        """Return all lines by rank; ranks that nobody holds are void."""
        by_rank = {line.rank: line for line in self.lines.values() if line.rank is not None} | self.done
        room = entries_max(self._timing.payload_max) * PARTS_MAX
        top = min(max(by_rank, default=self.passed), self.passed + room)
        return [entry_of(by_rank[rank]) if rank in by_rank else _VOID for rank in range(self.passed + 1, top + 1)]

    def waiting(self) -> list[Line]:
        """Return the jobs that are not inside."""
        return [line for line in self.lines.values() if not line.inside]

    def gathers(self, now: Instant, robot: int) -> Duration:
        """Return for how long news of `robot` may wait for others before the plan is made anew.

        A plan costs more the more jobs there are, and so does telling it: news that concerns nobody soon waits longer.
        """
        timing, line = self._timing, self.lines.get(robot)
        if line is not None and line.start is not None and line.start <= now + timing.schedule.soon:
            return timing.schedule.replan_wait
        return max(
            timing.schedule.replan_wait,
            timing.schedule.replan_job * (len(self.lines) - entries_max(timing.payload_max)),
        )

    def heir(self) -> int:
        """Return the waiting robot with the latest slot, NOBODY when nobody else waits."""
        others = [line for line in self.waiting() if line.robot != self._robot]
        if not others:
            return NOBODY
        return max(others, key=lambda line: (line.start or 0, -line.robot)).robot

    def wait(self, now: Instant, peers: int) -> Duration:
        """Return the paper's waiting time n: how much longer to wait for joins before giving slots.

        Waiting x costs the k jobs noted k x of lateness and spares p peers not yet noted, of whom
        exp(-x / tau) come later still, a delay c each; the sum is least at tau ln(p c / (k tau)). Lateness
        turns into misses as 1 / slack, so the slack only bounds it. While somebody is missing, answers to the
        announcement are waited for, too. Who is known from a predecessor's list only is missing.
        """
        timing = self._timing
        if timing.schedule.wait is not None:
            return timing.schedule.wait
        told = [line for line in self.lines.values() if not line.provisional]
        missing = peers - sum(line.robot != self._robot for line in told)
        if missing <= 0 or not told:
            return 0
        delay = timing.schedule.frozen / 2 + max(line.headway for line in told)
        best = timing.schedule.spread * math.log(max(missing * delay / (len(told) * timing.schedule.spread), 1.0))
        slack = min(line.deadline - line.duration - max(now, line.release) for line in told)
        return int(max(0.0, min(max(best, self.answered - now), slack / 4, timing.schedule.wait_max)))


def _doubled(first: int, times: int, most: int) -> int:
    """Return `first` doubled with each of `times` after the first one, up to `most`."""
    return min(first << max(times - 1, 0), most)
