"""What generated machines keep apart while one search goes on inside another."""

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
