"""A rule that only keeps facts examines the new ones, however many it has kept, also where its expressions may fail."""

import pytest

from rmr.base.streams import Choices
from rmr.lang.compiler import compile_source
from rmr.vm import match, once
from rmr.vm.engines import Engine, new_machine
from rmr.vm.machine_events import ExpressionFailed

KEPT = """type n(robot, int). type go(robot). type !limit(robot, int). go(R). limit(R, 60).
$go(R), !limit(R, L), $n(R, X), Y = 1000 / (X + 1), X < L -o n(R, X + 1)."""


@pytest.fixture
def examined(monkeypatch):
    """The facts that searches have examined."""
    facts = []

    def noted(step, args, env, agrees=match.agrees):
        facts.append(args)
        return agrees(step, args, env)

    monkeypatch.setattr(match, "agrees", noted)
    monkeypatch.setattr(once, "agrees", noted)
    return facts


def test_a_firing_examines_as_many_facts_with_many_kept_as_with_few(examined):
    machine = new_machine(compile_source(KEPT).program, 1, Choices("any"), engine=Engine.INTERPRETER)
    machine.start(0)
    counts = []
    for _ in range(20):
        machine.insert(0, 0, (0,))
        examined.clear()
        before = machine.firings
        machine.run(0)
        assert machine.firings == before + 60
        counts.append(len(examined))
    assert len(machine.held(0)) == 20 * 61
    assert max(counts) <= min(counts) + 10


@pytest.mark.parametrize("engine", Engine)
def test_failures_with_new_facts_are_reported_once_in_the_order_of_all_matches(engine):
    source = """type a(robot, int). type b(robot, int). a(R, 1). b(R, 2).
$a(R, X), $b(R, Y), 4 / X > 0, sqrt(Y) > 0 -o c(R, X, Y)."""
    machine = new_machine(compile_source(source).program, 1, Choices("any"), engine=engine)
    machine.start(0)
    machine.run(0)
    machine.insert(0, 0, (0,))
    machine.insert(0, 1, (-1,))
    machine.run(0)
    of_b, of_a = (each.reason for each in machine.drain() if isinstance(each, ExpressionFailed))
    assert "zero" in of_a
    assert "zero" not in of_b  # with the first a, which is older than the one that has no quotient
    machine.insert(0, 0, (3,))
    machine.run(0)
    assert [each.reason for each in machine.drain() if isinstance(each, ExpressionFailed)] == [of_b]
    assert machine.firings == 2
