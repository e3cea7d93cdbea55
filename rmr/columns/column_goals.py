"""Goals in columns (paper III.B): the rows in which each goal is open, and the ranks of rules by row.

Only goals that the program states are supported, with ranks from the compiler that are the same for all firings of a
rule (`InitialGoal.leads`). A row's rank of a rule is then the lowest over its open goals.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from rmr.base.time import in_seconds, tick_start
from rmr.base.values import Robot
from rmr.bytecode.program import Constant, InitialGoal, Program, Slot
from rmr.columns.column_layout import ColumnLayout
from rmr.columns.numbers import Array, same, unless
from rmr.vm.assertions import goal_text
from rmr.vm.ranks import here

if TYPE_CHECKING:
    from rmr.columns.block import Block

Report = dict[str, list[list[object]] | list[str]]


class ColumnGoals:
    """The goals of one program; the same for all blocks."""

    def __init__(self, program: Program, layout: ColumnLayout) -> None:
        self._program = program
        self._layout = layout
        self._of: list[list[int]] = [[] for _ in program.predicates]
        for index, goal in enumerate(program.goals):
            self._of[goal.predicate].append(index)
        leads = [{lead.rule: lead.rank for lead in goal.leads or () if lead.rank is not None} for goal in program.goals]
        places = {
            rank: np.uint16(place) for place, rank in enumerate(sorted({r for each in leads for r in each.values()}))
        }
        self._ranks = [{rule: places[rank] for rule, rank in each.items()} for each in leads]
        """By goal and rule: the rank's index in the sorted list of all ranks, which fits into 16 bits."""

    def want(self, block: "Block", index: int, rows: Array) -> None:
        """Open a goal in `rows` unless an identical one is open there; discharge it at once where it is fulfilled."""
        goal = self._program.goals[index]
        for earlier in self._of[goal.predicate]:
            if earlier == index:
                break
            rows = rows & ~(block.open[earlier] & self._alike(self._program.goals[earlier], goal, block.robots))
        block.open[index] |= rows
        block.live.append(index)
        self._achieve(block, index, block.present[goal.predicate])

    def inserted(self, block: "Block", predicate: int, rows: Array) -> None:
        """Discharge the goals that a fact inserted in `rows` fulfils."""
        for index in self._of[predicate]:
            if index in block.live:
                self._achieve(block, index, rows)

    def ranks(self, block: "Block", rule: int) -> Array:
        """Return the rank indices of a rule's firings by row; the largest 16-bit number stands for no rank."""
        ranks = np.full(block.size, np.iinfo(np.uint16).max, np.uint16)
        for index in block.live:
            if rule in self._ranks[index]:
                np.minimum(ranks, unless(block.open[index]) | self._ranks[index][rule], out=ranks)
        return ranks

    def report(self, block: "Block", row: int) -> Report:
        """Return the goals of one robot in the form of a machine's report (`Goals.report`)."""
        robot = Robot(block.robots[row])
        texts = [
            goal_text(self._program.predicates[goal.predicate].name, robot, here(goal.args, robot))
            for goal in self._program.goals
        ]
        order = sorted((int(place[row]), index) for index, place in enumerate(block.achieved_as) if place[row])
        return {
            "achieved": [[texts[i], in_seconds(tick_start(int(block.achieved_at[i][row])))] for _, i in order],
            "open": sorted(text for text, still in zip(texts, block.open, strict=True) if still[row]),
        }

    def _achieve(self, block: "Block", index: int, rows: Array) -> None:
        """Discharge a goal in those of `rows` in which the fact that holds fulfils it."""
        still = block.open[index]
        met = self._agreeing(block, self._program.goals[index], rows & still)
        if met.any():
            order = 1 + sum((place > 0).astype(np.uint16) for place in block.achieved_as)
            still ^= met
            np.putmask(block.achieved_at[index], met, block.tick)
            np.putmask(block.achieved_as[index], met, order)
        if not still.any():
            block.live.remove(index)

    def _agreeing(self, block: "Block", goal: InitialGoal, rows: Array) -> Array:
        """Return those of `rows` in which the fact that holds matches the goal."""
        types = self._program.predicates[goal.predicate].types
        columns = block.args[goal.predicate]
        first: dict[int, int] = {}
        for place, (arg, kind) in enumerate(zip(goal.args, types, strict=True)):
            if isinstance(arg, Constant):
                rows = rows & (columns[place] == self._layout.single(arg.value, kind.base))
            elif isinstance(arg, Slot) and arg.index == 0:
                rows = rows & (columns[place] == block.robots)
            elif isinstance(arg, Slot):
                before = first.setdefault(arg.index, place)
                rows = rows & same(columns[before], types[before].base, columns[place], kind.base)
        return rows

    def _alike(self, one: InitialGoal, other: InitialGoal, robots: Array) -> Array:
        """Return the mask of the robots for which two goals of a predicate are identical."""
        robot = _only_alike_for(zip(one.args, other.args, strict=True))
        if robot is None:
            return np.ones(len(robots), np.bool_)
        alike: Array = robots == robot
        return alike


def _only_alike_for(pairs: Iterable[tuple[object, object]]) -> int | None:
    """Return the robot for which pairs of arguments are the same; None: for all; -1: for none."""
    robot: int | None = None
    for one, other in pairs:
        if _written(one) == _written(other):
            continue
        named = [each.value for each in (one, other) if isinstance(each, Constant) and type(each.value) is Robot]
        if Slot(0) not in (one, other) or len(named) != 1 or robot not in (None, int(named[0])):
            return -1
        robot = int(named[0])
    return robot


def _written(arg: object) -> object:
    """Return a key that two arguments share if they are written the same (1 is not 1.0, nor @1)."""
    return repr(arg)
