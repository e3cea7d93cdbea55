"""What a machine does depends on its seed, and on nothing else of the process that it runs in."""

import subprocess
import sys
from random import Random

import pytest

from rmr.base.streams import Choices
from rmr.lang.compiler import compile_source
from rmr.vm.engines import new_machine

pytestmark = pytest.mark.medium

TEXT = """
type sensor near(robot, area). type action go(R: robot, A: area) -o in(R, A) else stuck(R, A).
?in(R, cellar). ?met(R, _, _).
in(R, hall). !door(R, hall, kitchen). !door(R, hall, yard). !door(R, kitchen, cellar). !door(R, yard, hall).
coin(R, red). coin(R, blue). coin(R, green). coin(R, amber).
in(R, A), !door(R, A, B) -o go(R, B).
coin(R, X), coin(R, Y), not met(R, X, Y) -o met(R, X, Y).
!door(R, A, B), !door(R, B, C) -o !door(R, A, C).
near(R, A) -o {X | $coin(R, X) | kept(R, A, X)}.
met(R, X, Y) -o [collect Z => L | met(R, Z, _) | all(R, L)].
in(R, A) -o [count => N | $coin(R, _) | left(R, A, N)] .
stuck(R, A) -o go(R, A) then in(R, hall).
watch(near(R, A), in(R, A), 2, go(R, A)).
"""


def trace(seed: int) -> list[str]:
    """Everything that a machine reports while its actions end, well or not, in the order of the seed."""
    compilation = compile_source(TEXT)
    assert compilation.program is not None, compilation.errors
    chance = Random(seed)
    machine = new_machine(compilation.program, 1, Choices(str(seed)), trace=True)
    machine.start(0)
    near = compilation.program.index("near")
    assert near is not None
    machine.insert(0, near, (chance.choice(machine.held(compilation.program.index("door") or 0))[0],))
    told: list[str] = []
    for now in range(0, 4_000_000_000, 250_000_000):
        machine.run(now)
        for event in machine.drain():
            told.append(repr(event))
            if hasattr(event, "serial"):
                machine.complete(now, event.serial, chance.random() < 0.7)
    return [*told, *machine.facts(), repr(machine.goals())]


SCRIPT = """
import sys; sys.path[:0] = {path!r}
from test_vm_order import trace
print([trace(seed) for seed in range(12)])
"""


def test_the_trace_is_the_same_whatever_the_order_of_sets_and_dicts() -> None:
    outcomes = set()
    for hash_seed in ("0", "1", "4711"):
        script = [sys.executable, "-c", SCRIPT.format(path=sys.path)]
        done = subprocess.run(script, capture_output=True, text=True, check=True, env={"PYTHONHASHSEED": hash_seed})
        outcomes.add(done.stdout)
    assert len(outcomes) == 1
    assert len(next(iter(outcomes))) > 10_000


def test_another_seed_gives_another_trace() -> None:
    assert len({tuple(trace(seed)) for seed in range(5)}) == 5
