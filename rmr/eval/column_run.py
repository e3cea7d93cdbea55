"""The columnar run of a program's robots, with the virtual time and the report of a run of nodes.

Robots without messages, actions and senses only fire rules. A node of such a robot is called at the beginning, and then
in every frame in which rules are left over from the budget of the frame before. So are columns.
"""

from collections.abc import Callable, Iterator
from typing import Any

from rmr.analysis.column_obstacles import Obstacle, obstacles
from rmr.base.time import Instant, tick_start
from rmr.bytecode.program import Program
from rmr.columns.columns import Columns, streams
from rmr.eval.ensemble import FIRINGS_MAX, Conditions, most
from rmr.eval.eval_ether import Messages
from rmr.eval.eval_report import satisfied
from rmr.eval.given import Given, Insertion
from rmr.eval.options import Death
from rmr.node.trace import rule_text
from rmr.vm.machine import FIRING_BUDGET


def hindrance(program: Program, given: Given, conditions: Conditions, *, traced: bool) -> Obstacle | None:
    """Return the first reason why the run cannot be columnar; None if it can."""
    found = obstacles(program, given.facts)
    found += [Obstacle("--edges gives a robot several facts")] if given.edges is not None else []
    found += [Obstacle("--insert brings facts from outside")] if given.insertions else []
    found += [Obstacle("--kill ends robots")] if conditions.deaths else []
    found += [Obstacle("--trace tells of every firing by itself")] if traced else []
    return found[0] if found else None


class ColumnRun:
    """All robots of one evaluation."""

    def __init__(self, program: Program, given: Given, conditions: Conditions) -> None:
        """Raise ValueError if there is a `hindrance` in program or facts."""
        self.firings = 0
        self.happened: Instant = 0
        self.now: Instant = 0
        self.outstanding: list[Insertion | Death] = []
        self.messages = Messages()
        self.frames = 0
        self.busy = len(conditions.robots)
        self._program = program
        self._robots = list(conditions.robots)
        names = [f"{conditions.seed}/robot{robot}/vm" for robot in self._robots]
        self._columns = Columns(program, self._robots, streams(names), given.facts)
        self._tick = 0
        """The frame that comes next."""
        self._failed = 0
        self._stopping = False

    @property
    def quiescent(self) -> bool:
        """Whether nothing is left to do."""
        return not self.busy

    @property
    def exhausted(self) -> bool:
        """Whether the run has used up its firings."""
        return self.firings >= self._firings_max

    @property
    def _firings_max(self) -> int:
        return most(FIRINGS_MAX, len(self._robots))

    def run(self, until: Instant, look: Callable[[], None] = lambda: None) -> bool:
        """Run to quiescence, or to `until` (included) at the latest; return whether it became quiescent."""
        while not self.quiescent:
            if tick_start(self._tick) > until or self.exhausted or self._stopping:
                return False
            self._frame(tick_start(self._tick))
            self._tick += 1
            look()
        return True

    def stop(self) -> None:
        """End the run after the present frame."""
        self._stopping = True

    def _frame(self, now: Instant) -> None:
        """Let each robot fire up to its budget."""
        self.now = now
        columns = self._columns
        before = (self.firings, self._failed)
        columns.run(FIRING_BUDGET, self._tick, self._firings_max - self.firings)
        self.firings = int(columns.firings.sum())
        self._failed = columns.failed
        self.busy = int(columns.busy.sum())
        if (self.firings, self._failed) != before:
            self.happened = now

    # ---- the report

    def entries(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yield each robot with its part of the report."""
        columns = self._columns
        for place, robot in enumerate(self._robots):
            yield (
                robot,
                {
                    "facts": columns.facts(place),
                    "goals": columns.goals(place),
                    "actions": [],
                    "assertions": [],
                    "undelivered": 0,
                    "expression_failures": columns.failures(place),
                },
            )

    def unfinished(self) -> Iterator[tuple[int, Iterator[str]]]:
        """Yield the robots that are not idle, with what each has yet to do."""
        busy = self._columns.busy
        firings = self._columns.firings
        for place in busy.nonzero()[0].tolist():
            last = self._columns.last(place)
            text = None if last is None else rule_text(self._program, last)
            yield self._robots[place], iter([satisfied(int(firings[place]), text)])

    @property
    def unsendable(self) -> int:
        """How many facts no frames can carry: none, what may be so is run by nodes."""
        return 0

    def warnings(self) -> tuple[Iterator[str], ...]:
        """Return nothing: what could be dropped on the way is not there."""
        return ()
