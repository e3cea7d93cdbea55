"""A rule over two robots as real processes: killed with kill -9 and started again, no fact is used twice or lost."""

import random
import re
import signal

import pytest
from process_tools import Stage, wait_until

from rmr.bytecode import codec
from rmr.lang.compiler import compile_source
from rmr_agent.state_files import JOURNAL

pytestmark = pytest.mark.slow

KILLS = 3
ROUNDS = 16
PAIRS = f"""
type action wait(R: robot, T: float) -o rested(R).
type !link(robot, robot).
type !got(robot, int, int).
type !gave(robot, int, int).
type step(robot, int).
type resting(robot, int).
type rested(robot).
type free(robot, int).
type more(robot, int).
!link(@1, @2).
step(@1, 0).
more(@2, 0).
more(B, Y), Y < {ROUNDS + 4} -o free(B, Y), more(B, Y + 1).
step(A, N), free(B, Y), link(A, B), N < {ROUNDS} -o got(A, N, Y), gave(B, N, Y), resting(A, N), wait(A, 0.1).
rested(A), resting(A, N) -o step(A, N + 1).
"""
LAB = """\
lab: bench
program: pairs.rbc
arena: {size: [1.0, 1.0]}
robots: [{id: 1, pose: [0.2, 0.2, 0deg]}, {id: 2, pose: [0.8, 0.8, 0deg]}]
radio: {loss: 0.2}
duration: 10min
"""


@pytest.fixture
def stage(tmp_path):
    stage = Stage(tmp_path)
    (tmp_path / "lab.yaml").write_text(LAB)
    program = compile_source(PAIRS).program
    (tmp_path / "pairs.rbc").write_bytes(codec.encode(program, debug=True))
    yield stage
    stage.end()
    assert not any("Traceback" in started.said() for started in stage.started)


def test_durable_robots_that_are_killed_complete_each_firing_once(stage):
    chance = random.Random(3)
    stage.world()
    state = {robot: stage.folder / f"state{robot}" for robot in (1, 2)}

    def start(robot):
        return stage.agent(robot, "--state", state[robot], program="pairs.rbc")

    running = {robot: start(robot) for robot in (1, 2)}
    for robot in (2, 1, 2)[:KILLS]:
        journal = state[robot] / JOURNAL
        wait_until(journal.exists)
        until = journal.stat().st_size + chance.randrange(200, 3000)
        wait_until(lambda journal=journal, until=until: journal.stat().st_size > until)
        running[robot].send(signal.SIGKILL)
        running[robot].process.wait(60)
        running[robot] = start(robot)
        running[robot].wait_for("and goes on as it was at")

    def pairs(newest, robot, name):
        facts = " ".join(newest[robot].report.get("facts", ()))
        return sorted((int(n), int(y)) for n, y in re.findall(rf"{name}\(@{robot}, (\d+), (\d+)\)", facts))

    newest = stage.statuses(
        lambda newest: (
            1 in newest
            and 2 in newest
            and f"step(@1, {ROUNDS})" in newest[1].report.get("facts", ())
            and len(pairs(newest, 2, "gave")) == ROUNDS
        )
    )
    got = pairs(newest, 1, "got")
    assert got == pairs(newest, 2, "gave")
    assert [n for n, _ in got] == list(range(ROUNDS))
    assert len({y for _, y in got}) == ROUNDS
    free = [int(y) for y in re.findall(r"free\(@2, (\d+)\)", " ".join(newest[2].report["facts"]))]
    assert sorted([*free, *[y for _, y in got]]) == list(range(ROUNDS + 4))
    assert sum(newest[robot].report["restarts"] for robot in (1, 2)) == KILLS
