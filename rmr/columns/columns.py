"""Vectorised run of all robots: in each step every robot that is not quiescent fires once.

In a step each row takes one of its satisfied rules of the best rank: the first in the text, or one drawn with one draw
from the row's stream. A row without a choice draws nothing. The streams are those of `rmr.base.streams.Choices`, for a
column of robots: SplitMix64 on unsigned 64-bit integers.
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from rmr.analysis.column_obstacles import obstacles
from rmr.base.streams import Choices, stable_hash
from rmr.base.time import in_seconds, tick_start
from rmr.base.values import Robot, format_fact
from rmr.bytecode.program import Constant, InitialFact, InitialGoal, Kind, Program, Slot, Strategy
from rmr.bytecode.provided import ROBOT_NUMBER
from rmr.columns.block import Block, ColumnLayout, Follows, owned, stated_values
from rmr.columns.numbers import Array, same, unless
from rmr.columns.rules import MatchedRows, column_rules
from rmr.vm.assertions import goal_text
from rmr.vm.ranks import here

# ---- goals in columns (paper III.B): the rows in which each goal is open, and the ranks of rules by row
#
# Only goals that the program states are supported, with ranks from the compiler that are the same for all firings
# of a rule (`InitialGoal.leads`). A row's rank of a rule is then the lowest over its open goals.

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

    def want(self, block: Block, index: int, rows: Array) -> None:
        """Open a goal in `rows` unless an identical one is open there; discharge it at once where it is fulfilled."""
        goal = self._program.goals[index]
        for earlier in self._of[goal.predicate]:
            if earlier == index:
                break
            rows = rows & ~(block.open[earlier] & self._alike(self._program.goals[earlier], goal, block.robots))
        block.open[index] |= rows
        block.live.append(index)
        self._achieve(block, index, block.present[goal.predicate])

    def inserted(self, block: Block, predicate: int, rows: Array) -> None:
        """Discharge the goals that a fact inserted in `rows` fulfils."""
        for index in self._of[predicate]:
            if index in block.live:
                self._achieve(block, index, rows)

    def ranks(self, block: Block, rule: int) -> Array:
        """Return the rank indices of a rule's firings by row; the largest 16-bit number stands for no rank."""
        ranks = np.full(block.size, np.iinfo(np.uint16).max, np.uint16)
        for index in block.live:
            if rule in self._ranks[index]:
                np.minimum(ranks, unless(block.open[index]) | self._ranks[index][rule], out=ranks)
        return ranks

    def report(self, block: Block, row: int) -> Report:
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

    def _achieve(self, block: Block, index: int, rows: Array) -> None:
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

    def _agreeing(self, block: Block, goal: InitialGoal, rows: Array) -> Array:
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


ROWS = 1 << 14
"""Robots of a block: the columns of one step fit into a second-level cache, and the overhead of numpy's calls is
small."""

_GAMMA = np.uint64(Choices.GAMMA)
_ONE, _OTHER = (np.uint64(each) for each in Choices.MULTIPLIERS)
_27, _30, _31, _32 = (np.uint64(each) for each in (27, 30, 31, 32))


class Columns:
    """The robots of one program."""

    def __init__(
        self,
        program: Program,
        robots: Sequence[int],
        streams: Array,
        given: Sequence[InitialFact] = (),
        rows: int = ROWS,
    ) -> None:
        """Begin with the stated facts and goals, then the `given` facts; `streams` are the states of random streams.

        Raises ValueError if the program cannot be run as columns (`rmr.analysis.column_obstacles.obstacles`).
        """
        found = obstacles(program, given)
        if found:
            raise ValueError(f"not a program for columns: {found[0].text}")
        self.program = program
        self._layout = ColumnLayout(program, given)
        self._goals = ColumnGoals(program, self._layout)
        follows = Follows(program, self._goals)
        self._rules = column_rules(program, self._layout, follows)
        numbers = np.asarray(robots, np.uint16)
        states = np.array(streams, np.uint64)
        parts = [slice(start, start + rows) for start in range(0, len(numbers), rows)]
        self.blocks = [Block(program, self._layout, follows, numbers[each], states[each]) for each in parts]
        for block in self.blocks:
            self._start(block, given)

    def _start(self, block: Block, given: Sequence[InitialFact]) -> None:
        number = self.program.index(ROBOT_NUMBER)
        if number is not None and self.program.predicates[number].provided:
            block.insert(number, [block.robots], owned(None, block.robots))
        self._state(block, self.program.facts)
        for index, goal in enumerate(self.program.goals):
            self._goals.want(block, index, owned(goal.owner, block.robots))
        self._state(block, given)

    def _state(self, block: Block, facts: Sequence[InitialFact]) -> None:
        for fact in facts:
            values = stated_values(fact, block, self.program, self._layout)
            block.insert(fact.predicate, values, owned(fact.owner, block.robots))

    # ---- the run

    def run(self, budget: int, tick: int = 0, firings_max: int | None = None) -> int:
        """Let every busy robot fire until none of its rules is satisfied, `budget` times at most, in frame `tick`.

        Return how many robots have had their turn: all, or those before the first one that finds `firings_max` firings
        made by the robots before it.
        """
        with np.errstate(all="ignore"):
            return self._run(budget, tick, firings_max)

    def _run(self, budget: int, tick: int, firings_max: int | None) -> int:
        done = 0
        fired = 0
        todo = self.blocks
        self.blocks = []
        while todo:
            block, *todo = todo
            if firings_max is not None and fired + block.size * budget >= firings_max:
                cut = self._cut(block, budget, tick, firings_max - fired)
                if cut < block.size:
                    before = block.part(slice(cut))
                    after = block.part(slice(cut, None))
                    self._fire(before, budget, tick)
                    self.blocks += [each for each in (before, after) if each.size] + todo
                    return done + cut
            fired += self._fire(block, budget, tick)
            done += block.size
            self.blocks.append(block)
        return done

    def _cut(self, block: Block, budget: int, tick: int, firings_max: int) -> int:
        """Return the number of rows before which a run makes less than `firings_max` firings, in order of the rows."""
        # Rows are independent, so a run of a copy shows how many firings each makes.
        trial = block.copy()
        self._fire(trial, budget, tick)
        made = (trial.firings - block.firings).astype(np.int64)
        return int(np.count_nonzero(np.cumsum(made) - made < firings_max))

    def _fire(self, block: Block, budget: int, tick: int) -> int:
        """Run one block; return how many firings there were."""
        if not block.busy.any():
            return 0
        before = int(block.firings.sum())
        block.tick = tick
        for left in reversed(range(budget)):
            self._step(block, is_last=not left)
            if not block.busy.any():
                break
        return int(block.firings.sum()) - before

    def _step(self, block: Block, *, is_last: bool) -> None:
        """Fire a rule in each row that has one satisfied: the others are not busy any more."""
        matches = [match for rule in self._rules if (match := rule.match(block)) is not None]
        if block.live and len(matches) > 1:
            matches = self._nearest(block, matches)
        fired = np.zeros(block.size, np.bool_)
        chosen = np.full(block.size, -1, np.int32) if is_last and block.last is None else None
        for match, rows in self._chosen(block, matches):
            match.rule.fire(block, match, rows)
            fired |= rows
            if chosen is not None:
                np.putmask(chosen, rows, match.rule.index)
        block.firings += fired
        block.busy = fired
        block.last = block.last if chosen is None else chosen

    def _nearest(self, block: Block, matches: list[MatchedRows]) -> list[MatchedRows]:
        """Return the matches where they have the best rank."""
        ranks = [self._goals.ranks(block, match.rule.index) for match in matches]
        least = np.minimum.reduce([unless(each.rows) | rank for each, rank in zip(matches, ranks, strict=True)])
        return [each._replace(rows=each.rows & (rank == least)) for each, rank in zip(matches, ranks, strict=True)]

    def _chosen(self, block: Block, matches: list[MatchedRows]) -> Iterator[tuple[MatchedRows, Array]]:
        """Yield the matches and where each is the one that fires."""
        if len(matches) < 2:
            yield from ((match, match.rows) for match in matches)
        elif self.program.strategy is Strategy.TEXTUAL:
            left = np.ones(block.size, np.bool_)
            for match in matches:
                yield match, match.rows & left
                left &= ~match.rows
        else:
            place = self._drawn(block, matches)
            # `place` counts down over the satisfied rules of a row: the rule that finds 0 is the drawn one.
            for match in matches:
                yield match, match.rows & (place == 0)
                place -= match.rows

    def _drawn(self, block: Block, matches: list[MatchedRows]) -> Array:
        """Return for each row which of its matches fires, counted from 0."""
        number = np.zeros(block.size, np.int32)
        for match in matches:
            number += match.rows
        place = np.zeros(block.size, np.int32)
        rows = np.flatnonzero(number > 1)
        if len(rows) == block.size:
            place[:] = below(block.streams, number.astype(np.uint64))
        elif len(rows):
            states = block.streams[rows]
            place[rows] = below(states, number[rows].astype(np.uint64))
            block.streams[rows] = states
        return place

    # ---- report

    @property
    def firings(self) -> Array:
        """Number of firings of each robot."""
        return np.concatenate([block.firings for block in self.blocks])

    @property
    def streams(self) -> Array:
        """The state of each robot's stream."""
        return np.concatenate([block.streams for block in self.blocks])

    @property
    def busy(self) -> Array:
        """Which robots may have a rule satisfied: they have used up their budget, or have not been run."""
        return np.concatenate([block.busy for block in self.blocks])

    @property
    def failed(self) -> int:
        """Number of failures of expressions (no value) on all robots together."""
        return sum(int(block.failures.sum()) for block in self.blocks if block.failures is not None)

    def failures(self, robot: int) -> int:
        """Return the number of failures of expressions on the robot at place `robot` of those of the run."""
        block, row = self._row(robot)
        return 0 if block.failures is None else int(block.failures[row])

    def last(self, robot: int) -> int | None:
        """Return the rule with which the robot at a place used up its first budget; None if it did not."""
        block, row = self._row(robot)
        return None if block.last is None or block.last[row] < 0 else int(block.last[row])

    def facts(self, robot: int) -> list[str]:
        """Return the facts of the robot at a place, in the form of `Machine.facts`."""
        block, row = self._row(robot)
        texts: list[str] = []
        for index, predicate in enumerate(self.program.predicates):
            if block.present[index][row] and not predicate.provided:
                columns = zip(block.args[index], predicate.types, strict=True)
                values = [self._layout.value(column, row, kind.base) for column, kind in columns]
                mark = "!" if predicate.kind is Kind.PERSISTENT else ""
                texts.append(format_fact(predicate.name, (Robot(block.robots[row]), *values), mark))
        return sorted(texts)

    def goals(self, robot: int) -> Report:
        """Return the goals of the robot at a place, in the form of `Machine.goals`."""
        return self._goals.report(*self._row(robot))

    def _row(self, robot: int) -> tuple[Block, int]:
        for block in self.blocks:
            if robot < block.size:
                return block, robot
            robot -= block.size
        raise IndexError("no such robot")

    @property
    def octets(self) -> int:
        """Memory of all columns, in octets."""
        return sum(block.octets for block in self.blocks)


# --- streams of choices


def streams(names: Sequence[str]) -> Array:
    """Return the states of the streams with these names."""
    return np.fromiter(map(stable_hash, names), np.uint64, len(names))


def below(states: Array, bounds: Array) -> Array:
    """Return for each stream one of 0 .. bound - 1, and move the streams on in place."""
    states += _GAMMA
    mixed = states >> _30
    mixed ^= states
    mixed *= _ONE
    mixed ^= mixed >> _27
    mixed *= _OTHER
    mixed ^= mixed >> _31
    mixed >>= _32
    mixed *= bounds
    mixed >>= _32
    return mixed
