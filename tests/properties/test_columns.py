"""Columns do what as many machines do by themselves, run by run and draw by draw, on programs drawn at random."""

import pytest
from column_programs import Alone, qualifying
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from rmr.bytecode.program import Program
from rmr.columns.columns import Columns, streams
from rmr.lang.compiler import compile_source
from rmr.vm.engines import Engine

pytestmark = pytest.mark.slow

ROBOTS = [0, 1, 2, 7, 65533]
RUNS = 12


class Together:
    """The robots of a program as columns, and each by itself."""

    def __init__(self, program: Program, seed: int, budget: int) -> None:
        names = [f"{seed}/robot{robot}/vm" for robot in ROBOTS]
        self.budget = budget
        self._undrawn = streams(names)
        self.columns = Columns(program, ROBOTS, streams(names), rows=2)
        self.alone = [Alone(program, robot, name, budget) for robot, name in zip(ROBOTS, names, strict=True)]

    def run(self) -> None:
        """One run of each within the budget."""
        self.columns.run(self.budget)
        for each in self.alone:
            each.run()

    @property
    def drew(self) -> bool:
        """Whether any robot has drawn."""
        return bool((self.columns.streams != self._undrawn).any())

    def states(self) -> tuple[list[object], list[object]]:
        """What can be seen of the robots here and there."""
        columns = self.columns
        firings, drawn, busy = columns.firings, columns.streams, columns.busy
        seen = [
            {
                "facts": columns.facts(place),
                "goals": columns.goals(place),
                "firings": int(firings[place]),
                "stream": int(drawn[place]),
                "failures": columns.failures(place),
                "busy": bool(busy[place]),
            }
            for place in range(len(ROBOTS))
        ]
        return seen, [each.state for each in self.alone]


def compare(seed: int, program: Program) -> Together:
    """Run a program on both until all is quiet, or long enough; they look the same after every run."""
    together = Together(program, seed, budget=1 + seed % 3)
    for _each in range(RUNS):
        together.run()
        seen, expected = together.states()
        assert seen == expected
    return together


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 2**32))
def test_columns_do_what_machines_do(seed: int) -> None:
    drawn = qualifying(seed)
    assume(drawn is not None)
    assert drawn is not None
    compare(seed, drawn[1])


def test_the_drawn_programs_do_something() -> None:
    programs = [each[1] for each in map(qualifying, range(150)) if each is not None]
    runs = [compare(seed, program) for seed, program in enumerate(programs)]
    assert len(programs) > 60
    assert sum(run.columns.firings.max() > 5 for run in runs) > 25
    assert sum(run.columns.failed > 0 for run in runs) > 10
    assert sum(bool(run.columns.goals(1)["achieved"]) for run in runs) > 10
    assert sum(run.drew for run in runs) > 10


@pytest.mark.parametrize("budget", [1, 7])
def test_a_run_that_is_cut_short_leaves_the_robots_behind_as_they_were(budget: int) -> None:
    for seed in range(20):
        drawn = qualifying(seed)
        if drawn is None:
            continue
        whole = Together(drawn[1], seed, budget)
        whole.run()
        made = whole.columns.firings.tolist()
        for firings_max in range(1, sum(made) + 1):
            cut = Together(drawn[1], seed, budget)
            done = cut.columns.run(budget, 0, firings_max)
            assert done == next((i for i in range(len(made)) if sum(made[:i]) >= firings_max), len(made))
            assert cut.columns.firings.tolist() == made[:done] + [0] * (len(made) - done)
            assert cut.columns.busy.tolist() == whole.columns.busy.tolist()[:done] + [True] * (len(made) - done)
            assert [cut.columns.facts(i) for i in range(done)] == [whole.columns.facts(i) for i in range(done)]
            assert [cut.columns.failures(i) for i in range(done)] == [whole.columns.failures(i) for i in range(done)]


ROBOTS_AT_ONCE = 3_000
WALK = """
type side(robot, side).  type at(robot, int).
side(R, heads).  at(R, 0).
side(R, heads) -o side(R, tails).
side(R, heads) -o side(R, edge).
side(R, tails) -o side(R, heads).
side(R, edge), at(R, X) -o side(R, heads), at(R, X + 1).
"""
"""Without a goal: what machines do to rank rules takes a minute."""


def test_three_thousand_robots_fire_a_thousand_times_as_machines_do() -> None:
    program = compile_source(WALK, "walk.rmr").program
    assert program is not None
    robots = range(1, ROBOTS_AT_ONCE + 1)
    names = [f"7/robot{robot}/vm" for robot in robots]
    columns = Columns(program, robots, streams(names), rows=1 << 10)
    alone = [Alone(program, robot, name, 100, Engine.GENERATED) for robot, name in zip(robots, names, strict=True)]
    for times in (1, 2, 7):
        columns.run(100 * times)
        for each in alone:
            each.run(times)
        assert columns.streams.tolist() == [each.choices.state for each in alone]
        assert columns.firings.tolist() == [each.machine.firings for each in alone]
        assert [columns.facts(place) for place in range(len(alone))] == [each.machine.facts() for each in alone]
    assert columns.firings.tolist() == [1000] * ROBOTS_AT_ONCE
    assert len({tuple(columns.facts(place)) for place in range(ROBOTS_AT_ONCE)}) > 30
