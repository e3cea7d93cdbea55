"""Rule: no term has two leaders, and without faults an event has at most one leader.

A term is identified by its leader and a counter, so a term with two leaders is one that a robot begins twice. A
restarted robot has lost its counter and is excused.
"""

from rmr.base.time import NS_PER_S, Duration, Instant, seconds
from rmr.coord.events import LeadershipBegan, LeadershipEnded
from rmr_sim.checkers.recent_table import RecentTable
from rmr_sim.checkers.run_view import RunView

SETTLE: Duration = seconds(5)
"""Time for two leaders in radio range to agree: many repetitions of their schedules."""
EVERY: Duration = NS_PER_S
"""Period of the count of leaders."""


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
                if now < since + SETTLE or (event, a, b) in self._told or not self._view.linked(a, b, since, now):
                    continue
                self._told[event, a, b] = None
                self._view.violate(now, "leaders", (a, b), f"robots {a} and {b} lead one event though all is well")
