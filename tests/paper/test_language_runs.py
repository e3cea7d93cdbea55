"""Section III of the paper: its programs, compiled from the source as printed, do what it says. One test per claim."""

from collections import Counter
from pathlib import Path

import pytest
from vm_hand import machine_of

from rmr.base.time import Instant, seconds
from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode import codec
from rmr.bytecode.program import Program
from rmr.lang.compiler import compile_file, compile_source
from rmr.vm.machine import Machine
from rmr.vm.machine_events import ActionDerived, FactSent, JobFinished, JobMissed, RuleFired, VmEvent

PROGRAMS = Path(__file__).parents[1] / "programs"
SEEDS = range(300)


def loaded(program: Program | None) -> Program:
    """Return the program as robots get it: through byte-code."""
    assert program is not None
    return codec.decode(codec.encode(program, debug=False))


def printed(figure: str) -> Program:
    return loaded(compile_file(PROGRAMS / f"{figure}.rmr").program)


def started(program: Program, robot: int = 1, seed: int = 0, now: Instant = 0) -> Machine:
    machine = machine_of(program, robot, seed)
    machine.start(now)
    machine.run(now)
    return machine


def fired(machine: Machine) -> list[int]:
    return [event.rule for event in machine.drain() if isinstance(event, RuleFired)]


def actions(events: list[VmEvent]) -> list[ActionDerived]:
    return [event for event in events if isinstance(event, ActionDerived)]


def index(program: Program, name: str) -> int:
    found = program.index(name)
    assert found is not None
    return found


# ---- III.B, figure 3


def test_iii_b_figure_3_passes_by_middle_every_time() -> None:
    program = printed("figure3")
    for seed in SEEDS:
        machine = started(program, seed=seed)
        assert fired(machine) == [0, 2]
        assert machine.facts() == ["location(@1, t)"]
        assert machine.goals() == {"achieved": [["location(@1, middle)", 0.0]], "open": []}


def test_iii_b_without_its_goal_figure_3_passes_by_middle_only_sometimes() -> None:
    text = (PROGRAMS / "figure3.rmr").read_text(encoding="utf-8")
    program = loaded(compile_source(text.replace("?location(R, middle).", "")).program)
    ways = Counter(tuple(fired(started(program, seed=seed))) for seed in SEEDS)
    assert set(ways) == {(0, 2), (1,)}
    assert 100 < ways[(1,)] < 200


def test_iii_b_every_robot_runs_figure_3_on_its_own_facts() -> None:
    program = printed("figure3")
    assert [started(program, robot).facts() for robot in (1, 2, 7)] == [[f"location(@{n}, t)"] for n in (1, 2, 7)]


# ---- III.C, figure 4


def test_iii_c_figure_4_is_in_the_repository_as_printed() -> None:
    text = (PROGRAMS / "figure4.rmr").read_text(encoding="utf-8")
    assert text.partition("\n\n")[2] == (
        "type action moveto(robot, area).\n"
        "location(R, s).\n"
        "?location(R, middle).\n"
        "// use action moveto instead\n"
        "location(R, L), L = S -o moveto(R, middle).\n"
        "location(R, L), L = s -o moveto(R, t).\n"
        "location(R, L), L = middle -o moveto (R, t).\n"
    )
    assert [each.code for each in compile_file(PROGRAMS / "figure4.rmr").diagnostics] == ["W101"]


def test_iii_c_figure_4_goes_to_middle_first() -> None:
    program = printed("figure4")
    moveto = index(program, "moveto")
    for seed in SEEDS:
        machine = started(program, seed=seed)
        [action] = actions(machine.drain())
        assert (action.predicate, action.executor, action.args) == (moveto, 1, (Symbol("middle"),))
        assert machine.facts() == []


def test_iii_c_on_arrival_the_location_is_back_and_figure_4_goes_on_to_t() -> None:
    program = printed("figure4")
    onward = Counter()
    for seed in SEEDS:
        machine = started(program, seed=seed)
        [first] = actions(machine.drain())
        machine.complete(seconds(5), first.serial, True)
        assert machine.facts() == ["location(@1, middle)"]
        assert machine.goals() == {"achieved": [["location(@1, middle)", 5.0]], "open": []}
        machine.run(seconds(5))
        [second] = actions(machine.drain())
        onward[str(second.args[0])] += 1
    assert set(onward) == {"middle", "t"}, "as printed, rule 1 matches any location: `S` is a variable"


def test_iii_c_with_the_constant_that_is_meant_figure_4_ends_in_t() -> None:
    text = (PROGRAMS / "figure4.rmr").read_text(encoding="utf-8").replace("L = S", "L = s")
    program = loaded(compile_source(text).program)
    for seed in SEEDS:
        machine = started(program, seed=seed)
        went: list[str] = []
        while todo := actions(machine.drain()):
            for action in todo:
                went.append(str(action.args[0]))
                machine.complete(0, action.serial, True)
            machine.run(0)
        assert went == ["middle", "t"]


# ---- III.D, comprehensions, on several robots

READY = """
online(A,L) -o {B | edge(A,B) |
    ready(B,A)}.
"""


class Ensemble:
    """Several robots with one program and a radio that loses nothing."""

    def __init__(self, text: str, robots: tuple[int, ...]) -> None:
        self.program = loaded(compile_source(text).program)
        self.machines = {robot: started(self.program, robot) for robot in robots}

    def insert(self, robot: int, name: str, *args: Value, now: Instant = 0) -> None:
        self.machines[robot].insert(now, index(self.program, name), args)

    def run(self, now: Instant = 0) -> dict[int, list[VmEvent]]:
        """Let all run and deliver until none sends any more; return what happened at each robot."""
        seen: dict[int, list[VmEvent]] = {robot: [] for robot in self.machines}
        busy = True
        while busy:
            busy = False
            for robot, machine in self.machines.items():
                machine.run(now)
                events = machine.drain()
                seen[robot] += events
                for event in events:
                    if isinstance(event, FactSent) and event.destination in self.machines:
                        self.machines[event.destination].insert(now, event.predicate, event.args)
                        busy = True
        return seen

    def facts(self) -> dict[int, list[str]]:
        return {robot: machine.facts() for robot, machine in self.machines.items()}


def test_iii_d_a_robot_that_comes_online_makes_all_its_neighbours_ready() -> None:
    ensemble = Ensemble("!edge(@1, @2). !edge(@1, @3). !edge(@2, @3)." + READY, (1, 2, 3))
    ensemble.insert(1, "online", Symbol("west"))
    ensemble.run()
    assert ensemble.facts() == {
        1: ["!edge(@1, @2)", "!edge(@1, @3)"],
        2: ["!edge(@2, @3)", "ready(@2, @1)"],
        3: ["ready(@3, @1)"],
    }
    ensemble.insert(2, "online", Symbol("west"))
    ensemble.run()
    assert ensemble.facts()[3] == ["ready(@3, @1)", "ready(@3, @2)"]


def test_iii_d_temporary_edges_are_used_up_with_the_first_online() -> None:
    ensemble = Ensemble("edge(@1, @2). edge(@1, @3)." + READY, (1, 2, 3))
    for area in ("west", "east"):
        ensemble.insert(1, "online", Symbol(area))
    ensemble.run()
    assert ensemble.facts() == {1: [], 2: ["ready(@2, @1)"], 3: ["ready(@3, @1)"]}


def test_iii_d_without_neighbours_the_fact_is_used_up_and_nothing_derived() -> None:
    ensemble = Ensemble("!edge(@1, @2)." + READY, (1, 2))
    ensemble.insert(2, "online", Symbol("west"))
    ensemble.run()
    assert ensemble.facts() == {1: ["!edge(@1, @2)"], 2: []}


# ---- III.E, time assertions, on several robots

ASSERTION = """
assert(offline(A,L), online(A,L), 10,
    broadcast (A)).
"""


def test_iii_e_each_robot_watches_its_own_deadline() -> None:
    ensemble = Ensemble(ASSERTION, (1, 2, 3))
    for robot in (1, 2, 3):
        ensemble.insert(robot, "offline", Symbol("l"), now=seconds(robot))
    ensemble.run(seconds(3))
    assert [ensemble.machines[robot].next_wake for robot in (1, 2, 3)] == [seconds(11), seconds(12), seconds(13)]
    ensemble.insert(2, "online", Symbol("l"), now=seconds(11))
    seen = ensemble.run(seconds(20))
    broadcast = index(ensemble.program, "broadcast")
    assert [[each.predicate for each in actions(seen[robot])] for robot in (1, 2, 3)] == [[broadcast], [], [broadcast]]
    assert [each.executor for robot in (1, 3) for each in actions(seen[robot])] == [Robot(1), Robot(3)]
    outcomes = {robot: [type(e) for e in seen[robot] if isinstance(e, JobMissed | JobFinished)] for robot in (1, 2, 3)}
    assert outcomes == {1: [JobMissed], 2: [JobFinished], 3: [JobMissed]}


@pytest.mark.parametrize(("online_s", "missed"), [(9, False), (11, False), (12, True)])
def test_iii_e_ten_seconds_after_the_start_are_in_time(online_s: int, missed: bool) -> None:
    ensemble = Ensemble(ASSERTION, (4,))
    ensemble.insert(4, "offline", Symbol("l"), now=seconds(1))
    ensemble.run(seconds(1))
    ensemble.insert(4, "online", Symbol("l"), now=seconds(online_s))
    events = ensemble.run(seconds(online_s))[4]
    assert bool(actions(events)) is missed
    [job] = ensemble.machines[4].jobs
    assert (job.missed, job.deadline, job.finish) == (missed, seconds(11), seconds(online_s))


def test_iii_e_another_line_is_another_job() -> None:
    ensemble = Ensemble(ASSERTION, (1,))
    for line in ("north", "south"):
        ensemble.insert(1, "offline", Symbol(line), now=seconds(1))
    ensemble.insert(1, "online", Symbol("south"), now=seconds(2))
    events = ensemble.run(seconds(30))[1]
    assert [(job.text, job.missed) for job in ensemble.machines[1].jobs] == [
        ("online(@1, north)", True),
        ("online(@1, south)", False),
    ]
    assert len(actions(events)) == 1


def test_iii_d_and_iii_e_together_as_printed() -> None:
    ensemble = Ensemble("!edge(@1, @2)." + READY + ASSERTION, (1, 2))
    ensemble.insert(1, "offline", Symbol("l"))
    ensemble.run()
    ensemble.insert(1, "online", Symbol("l"), now=seconds(4))
    ensemble.run(seconds(4))
    seen = ensemble.run(seconds(60))
    assert ensemble.facts()[2] == ["ready(@2, @1)"]
    assert actions(seen[1]) == []
    [job] = ensemble.machines[1].jobs
    assert (job.finish, job.missed) == (seconds(4), False)
