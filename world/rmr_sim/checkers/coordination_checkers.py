"""Rules of coordination, about leaders and about the schedules that they send.

- No term has two leaders, and without faults an event has at most one leader. A term is identified by its leader and a
  counter, so a term with two leaders is one that a robot begins twice. A restarted robot has lost its counter and is
  excused.
- Robots that forward a schedule do not change it, and no two versions have the same instant of issue.
- A slot within the frozen zone is not moved, unless its owner missed it, was stopped, or it is long over.
- A frame fits the radio.
"""

from rmr.base.time import NS_PER_S, Duration, Instant, milliseconds, seconds
from rmr.coord.events import EntryMissed, LeadershipBegan, LeadershipEnded, SlotLost
from rmr.coord.messages import Entry, FrameKind, MessageError, Phase, Sched, decode
from rmr.coord.term import Term
from rmr.node.ports import Spoken
from rmr_sim.checkers.passage_checker import TIMING
from rmr_sim.checkers.run_view import RecentTable, RunView

EVERY: Duration = NS_PER_S
"""Period of the count of leaders."""
LET_PASS = milliseconds(1200)
"""Greatest age of a slot at the report that its owner gave it up."""

_SCHED = bytes([FrameKind.SCHED])

Promise = tuple[bytes, Term, int, Instant]
"""Event, term, robot, trigger."""


class LeaderChecker:
    """Checks the beginnings and ends of leadership."""

    def __init__(self, view: RunView) -> None:
        self._view = view
        self._leads: dict[bytes, dict[int, tuple[int, Instant]]] = {}
        """By event and robot: the incarnation that leads, and since when."""
        self._terms: RecentTable[tuple[bytes, int, int], None] = RecentTable()
        self._told: RecentTable[tuple[bytes, int, int], None] = RecentTable()
        self._look_at: Instant = 0
        view.subscribe(LeadershipBegan, self._began)
        view.subscribe(LeadershipEnded, self._ended)

    def _began(self, robot: int, now: Instant, began: LeadershipBegan) -> None:
        term = (began.group_id, robot, began.term)
        if term in self._terms and not self._view.forgot(robot, 0):
            self._view.violate(now, "term", (robot,), f"robot {robot} began term {began.term} a second time")
        self._terms[term] = None
        self._leads.setdefault(began.group_id, {})[robot] = (self._view.life(robot), now)

    def _ended(self, robot: int, _now: Instant, ended: LeadershipEnded) -> None:
        self._leads.get(ended.group_id, {}).pop(robot, None)

    def __call__(self, now: Instant) -> None:
        """Count the leaders of each event, once a second."""
        if now < self._look_at:
            return
        self._look_at = now + EVERY
        for event, leads in list(self._leads.items()):
            for robot, (life, _) in list(leads.items()):
                if not self._view.alive(robot) or self._view.life(robot) != life:
                    del leads[robot]
            if len(leads) > 1:
                self._check(now, event, leads)
            elif not leads:
                del self._leads[event]

    def _check(self, now: Instant, event: bytes, leads: dict[int, tuple[int, Instant]]) -> None:
        """Report two robots that have led one event for too long although they are linked."""
        ordered = sorted(leads)
        for index, a in enumerate(ordered):
            for b in ordered[index + 1 :]:
                since = max(leads[a][1], leads[b][1], self._view.healed_at)
                # Time for two leaders in radio range to agree: many repetitions of their schedules.
                if now < since + seconds(5) or (event, a, b) in self._told or not self._view.linked(a, b, since, now):
                    continue
                self._told[event, a, b] = None
                self._view.violate(now, "leaders", (a, b), f"robots {a} and {b} lead one event though all is well")


class ScheduleChecker:
    """Checks every schedule that is sent."""

    def __init__(self, view: RunView) -> None:
        self._view = view
        self._room = view.simulation.robots[0].payload_max
        self._said: RecentTable[tuple[bytes, Term, Instant, int], bytes] = RecentTable()
        self._promised: RecentTable[Promise, tuple[Instant, Instant]] = RecentTable()
        """The fixed slot, and the issue of the schedule that fixed it: frames may overtake one another."""
        self._given_up: RecentTable[tuple[int, bytes], Instant] = RecentTable()
        view.subscribe(Spoken, self._spoken)
        view.subscribe(SlotLost, self._gave_up)
        view.subscribe(EntryMissed, self._gave_up)

    def __call__(self, _now: Instant) -> None:
        """Do nothing: all checks are made on events."""

    def _gave_up(self, robot: int, now: Instant, lost: SlotLost | EntryMissed) -> None:
        self._given_up[robot, lost.group_id] = now

    def _spoken(self, robot: int, now: Instant, spoken: Spoken) -> None:
        payload = spoken.payload
        if len(payload) > self._room:
            words = f"robot {robot} sent {len(payload)} octets where {self._room} fit"
            self._view.violate(now, "frame", (robot,), words)
        if payload[:1] != _SCHED:
            return
        try:
            sched = decode(payload, self._room)
        except MessageError as error:
            self._view.violate(now, "frame", (robot,), f"robot {robot} sent a schedule that is none: {error}")
            return
        assert isinstance(sched, Sched)
        key = (sched.group_id, sched.term, sched.issued, sched.part)
        if self._said.get(key, payload) != payload:
            words = f"robot {robot} sent another version of the schedule that leader {sched.term.leader} issued"
            self._view.violate(now, "schedule", (robot, sched.term.leader), words)
        else:
            self._said[key] = payload
        if sched.term.leader == robot:
            for entry in sched.entries:
                self._check(now, sched, entry)

    def _check(self, now: Instant, sched: Sched, entry: Entry) -> None:
        """Report a fixed slot that has moved; record the slots that are fixed now."""
        key = (sched.group_id, sched.term, entry.robot, entry.trigger)
        promised, issued = self._promised.get(key, (None, -1))
        if sched.issued <= issued:
            return
        if promised is not None and entry.phase is Phase.WAITING and entry.start != promised:
            del self._promised[key]
            over = sched.issued > promised + entry.duration + TIMING.schedule.window
            if not over and not self._excused(entry.robot, sched, promised, now):
                words = f"leader {sched.term.leader} moved the slot of robot {entry.robot}, which stood already"
                self._view.violate(now, "frozen slot", (sched.term.leader, entry.robot), words)
        if entry.start is not None and entry.start <= sched.issued + TIMING.schedule.frozen:
            self._promised[key] = entry.start, sched.issued

    def _excused(self, robot: int, sched: Sched, promised: Instant, now: Instant) -> bool:
        """Return whether the owner of a slot gave it up or could not use it."""
        if robot not in self._view.robots:
            return True
        gave_up = self._given_up.get((robot, sched.group_id), -LET_PASS)
        since = promised - TIMING.liveness.gone
        return (
            gave_up >= promised - LET_PASS
            or bool(self._view.held_up(robot, since, now))
            or self._view.forgot(robot, since)
        )
