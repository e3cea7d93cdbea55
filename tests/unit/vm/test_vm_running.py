"""What generated machines keep apart while one search goes on inside another, or while a rule fires as it searches."""

from typing import Any

import pytest
from vm_hand import actions

from rmr.base.streams import Choices
from rmr.lang.compiler import compile_source
from rmr.vm import match
from rmr.vm.engines import Engine, new_machine
from rmr.vm.machine_events import VmEvent

PROGRAM = """
type !p(robot, int). type a(robot, int). type b(robot, int). type z(robot). type q(robot, int).
type action out(robot, float).
a(R, X), {} b(R, Y) -o {{U, V | !p(R, U), !p(R, V), U + V < 0 | q(R, U)}}, out(R, 1 / X).
"""


@pytest.mark.parametrize("absent", ["", "not z(R),"])
def test_comprehension_over_its_search_budget_does_not_end_the_outer_search(
    absent: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(match, "LOOKS_MAX", 1000)
    program: Any = compile_source(PROGRAM.format(absent)).program
    told: list[list[VmEvent]] = []
    for engine in Engine:
        machine = new_machine(program, 1, Choices("any"), engine=engine)
        machine.start(0)
        for name, count in (("p", 40), ("a", 3), ("b", 2)):
            for number in range(count):
                machine.insert(0, program.index(name), (number,))
        machine.run(0)
        told.append(machine.drain())
    assert [event.args for event in actions(told[0])] == [(1.0,), (0.5,)]
    assert told[0] == told[1]


CLOSURE = """
type !edge(robot, int, int). type !path(robot, int, int). type loop(robot, int). type !far(robot, int).
edge(R, A, B) -o path(R, A, B).
path(R, A, B), edge(R, B, C) -o path(R, A, C){}.
path(R, A, A) -o loop(R, A).
path(R, A, B), far(R, B) -o far(R, A).
"""
NODES = 30


@pytest.mark.parametrize("also", ["", ", far(R, A)", ", loop(R, C)"])
@pytest.mark.parametrize("filler", ["", "type z(robot). " + "z(R) -o 1. " * 9])
@pytest.mark.parametrize("budget", [1, 7, 100, 2000])
def test_a_rule_that_fires_as_it_searches_ends_with_the_budget_and_where_others_are_concerned(
    also: str, filler: str, budget: int
) -> None:
    program: Any = compile_source(CLOSURE.format(also) + filler).program
    edge = program.index("edge")
    told: list[list[VmEvent]] = []
    for engine in Engine:
        machine = new_machine(program, 1, Choices("any"), engine=engine, firing_budget=budget)
        machine.start(0)
        # A line; then, between two runs, a way back and a shorter one.
        for node in range(NODES):
            machine.insert(0, edge, (node, node + 1))
        told.append([])
        for number in range(5000 // budget + 4):
            machine.run(number)
            told[-1] += machine.drain()
            if number in (1, 3):
                machine.insert(number, edge, (NODES, number) if number == 3 else (0, NODES // 2))
        assert machine.firings > NODES * NODES // 2
        if engine is Engine.GENERATED:
            assert "fire_all1" in machine.module.names
    assert told[0] == told[1]


STAYING = """
type base(robot, int). type item(robot, int, int). type used(robot, int). type more(robot, int). type !seen(robot, int).
$base(R, A), item(R, A, B), B > A + 1 -o used(R, B).
used(R, B), more(R, C) -o item(R, B % 3, C).
$base(R, A), used(R, B), item(R, B % 2, C) -o seen(R, C).
"""


@pytest.mark.parametrize("many", [5, 33, 80])
@pytest.mark.parametrize("budget", [1, 3, 500])
def test_tops_that_stay_are_joined_with_all_that_comes_and_goes(many: int, budget: int) -> None:
    program: Any = compile_source(STAYING).program
    given = [("base", (each,)) for each in range(3)] + [("item", (each % 3, each)) for each in range(3 * many)]
    told: list[list[VmEvent]] = []
    for engine in Engine:
        machine = new_machine(program, 1, Choices("any"), engine=engine, firing_budget=budget)
        machine.start(0)
        told.append([])
        for number in range(2 * many):
            for name, args in given if number == 0 else [("more", (number,)), ("item", (number % 3, number + 1))]:
                machine.insert(number, program.index(name), args)
            machine.run(number)
            told[-1] += machine.drain()
    assert len(told[0]) > many
    assert told[0] == told[1]
