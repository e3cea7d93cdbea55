"""Programs loaded while robots run: all switch at one instant or none does, and no shared fact is lost."""

import json
import re

import pytest
from unit.mind.mind_runs import MindRun

from rmr.base.time import NS_PER_S, seconds
from rmr.vm.provenance import ProvenanceLog
from rmr_sim.event import Event
from rmr_sim.run_setup import Options, load, report_of
from rmr_world.finding import LabError

OLD = """
type token(robot, int).
type !next(robot, robot).
type go(robot).
type stop(robot).
type scrap(robot, int).
type limit(robot, int).
type !at_start(robot, int).
go(R).
scrap(R, 7).
limit(R, 3).
!at_start(R, 1).
token(R, N), $go(R), !next(R, S) -o token(S, N).
stop(R), go(R) -o 1.
"""

NEW = """
type !extra(robot, symbol).
type limit(robot, float).
type stop(robot).
type go(robot).
type !next(robot, robot).
type !at_start(robot, int).
type token(robot, int).
go(R).
!at_start(R, 2).
!extra(R, fresh).
token(R, N), $go(R), !next(R, S) -o token(S, N).
stop(R), go(R) -o 1.
"""

LAB = """
lab: tokens
program: old.rmr
duration: {duration}
arena: {{size: [3.0, 3.0]}}
robots: [{{ids: 1-5, grid: {{from: [0.4, 0.4], step: [0.5, 0], columns: 5}}}}]
facts: ["next(@1, @2)", "next(@2, @3)", "next(@3, @4)", "next(@4, @1)", "token(@1, 1)", "token(@2, 2)", "token(@3, 3)"]
radio: {{loss: {loss}}}
loads: [{{at: 1s, program: new.rmr{robots}}}]
faults: {faults}
"""


PAIRS = """
type action wait(R: robot, T: float) -o rested(R).
type idle(robot, int).
type !paired(robot, int, int).
type !lent(robot, int, int).
type !next(robot, robot).
type token(robot, int).
type more(robot, int).
type made(robot, int).
type rested(robot).
more(R, 0).
more(R, N), N < 40 -o made(R, N), wait(R, 0.2).
rested(R), made(R, N) -o idle(R, id(R) * 100 + N), more(R, N + 1).
"""
RULE = "idle(A, X), idle(B, Y), !next(A, B), X % 2 = Y % 2 -o paired(A, X, Y), lent(B, X, Y).\n"
OTHER_RULE = "idle(A, X), idle(B, Y), !next(A, B) -o paired(A, X, Y), lent(B, X, Y).\n"


class Stop(Event):
    """No token is passed on any more."""

    def callback(self, simulation):
        for robot in (1, 2, 3, 4):
            simulation.insert(robot, "stop")


def lab_in(folder, *, new=NEW, loss=0.0, faults="[]", duration="10s", robots=""):
    (folder / "old.rmr").write_text(OLD)
    (folder / "new.rmr").write_text(new)
    path = folder / "lab.yaml"
    path.write_text(LAB.format(loss=loss, faults=faults, duration=duration, robots=robots))
    return path


def run(path, seed=0, stop_s=None):
    simulation = load(path, Options()).simulation(seed)
    if stop_s is not None:
        simulation.schedule(Stop(seconds(stop_s)))
    finished = simulation.run()
    return simulation, report_of(simulation, finished)


def digests(simulation):
    return {robot.robot: robot.programs.endpoint.loader.digest for robot in simulation.robots if robot.alive}


def tokens(report):
    return sorted(
        fact.partition(", ")[2] for part in report["robots"].values() for fact in part["facts"] if "token" in fact
    )


def test_all_robots_switch_at_one_instant_and_keep_their_facts(tmp_path):
    simulation, report = run(lab_in(tmp_path), stop_s=8)
    [entry] = report["loads"]
    assert entry["switched"]
    [instant] = {instant for _, instant, _, _ in simulation.switches}
    assert entry["at_s"] == round(instant / NS_PER_S, 3)
    assert sorted(robot for robot, *_ in simulation.switches) == [1, 2, 3, 4, 5]
    assert tokens(report) == ["1)", "2)", "3)"]
    facts = report["robots"]["5"]["facts"]
    # What both programs state holds once; what only the new one states is new; other types are not carried.
    assert facts == ["!at_start(@5, 1)", "!at_start(@5, 2)", "!extra(@5, fresh)", "go(@5)"]
    assert report["violations"] == []


def test_what_ends_is_listed_for_each_robot(tmp_path):
    _, report = run(lab_in(tmp_path))
    [entry] = report["loads"]
    assert entry["robots"]["5"] == {
        "ready": True,
        "problem": None,
        "carried": 2,
        "dropped": 2,
        "drops": "scrap(@5, 7); limit(@5, 3)",
    }


def test_a_dead_robot_keeps_the_old_program_everywhere(tmp_path):
    simulation, report = run(lab_in(tmp_path, faults="[{at: 0.5s, kill: 5}]", duration="16s"), stop_s=14)
    [entry] = report["loads"]
    assert not entry["switched"]
    assert "off, or out of reach" in entry["robots"]["5"]["problem"]
    assert simulation.switches == []
    assert tokens(report) == ["1)", "2)", "3)"]


def test_a_program_that_does_not_fit_is_refused_with_the_reason(tmp_path):
    new = NEW + "type action moveto(robot, area).\nstop(R), go(R) -o moveto(R, nowhere).\n"
    simulation, report = run(lab_in(tmp_path, new=new))
    [entry] = report["loads"]
    assert not entry["switched"]
    assert "area 'nowhere'" in entry["robots"]["3"]["problem"]
    assert simulation.switches == []


def test_a_program_without_handlers_is_refused_with_the_reason(tmp_path):
    new = NEW + "type action dance(robot).\nstop(R), go(R) -o dance(R).\n"
    _, report = run(lab_in(tmp_path, new=new))
    assert "no handler for action dance" in report["loads"][0]["robots"]["2"]["problem"]


def test_a_robot_that_is_not_to_get_the_program_keeps_its_own_after_a_restart(tmp_path):
    faults = "[{at: 0.2s, kill: 5}, {at: 9s, restart: 5}]"
    simulation, report = run(lab_in(tmp_path, faults=faults, duration="14s", robots=", robots: 1-4"), stop_s=8)
    assert report["loads"][0]["switched"]
    assert len({digest for robot, digest in digests(simulation).items() if robot != 5}) == 1
    assert digests(simulation)[5] != digests(simulation)[1]


def test_a_restarted_robot_gets_the_program_from_the_others_before_it_starts(tmp_path):
    faults = "[{at: 7s, kill: 5}, {at: 8s, restart: 5}]"
    simulation, report = run(lab_in(tmp_path, faults=faults, duration="14s", loss=0.2), stop_s=8)
    assert report["loads"][0]["switched"]
    assert len(set(digests(simulation).values())) == 1
    assert [(robot, late) for robot, _, _, late in simulation.switches][-1] == (5, True)
    # It has started with the new program alone: nothing that only the old one states.
    assert report["robots"]["5"]["facts"] == ["!at_start(@5, 2)", "!extra(@5, fresh)", "go(@5)"]


@pytest.mark.parametrize("seed", range(1, 9))
def test_under_loss_and_with_a_robot_that_dies_all_switch_or_none_does(tmp_path, seed):
    killed_s = 0.4 + 0.6 * seed  # before, during and after the load
    faults = f"[{{at: {killed_s:.1f}s, kill: 5}}]"
    check_all_or_none(lab_in(tmp_path, faults=faults, loss=0.3, duration="28s"), seed)


@pytest.mark.slow
@pytest.mark.parametrize("first", [1, 11, 21, 31])
def test_forty_seeds_under_loss_with_a_robot_that_dies_switch_all_or_none(tmp_path, first):
    # Killed from 0.5 s to 6.5 s: before the load, while fragments are sent, between readiness and the switch, after it.
    for seed in range(first, first + 10):
        faults = f"[{{at: {0.5 + 0.15 * seed:.2f}s, kill: 5}}]"
        check_all_or_none(lab_in(tmp_path, faults=faults, loss=0.3, duration="28s"), seed)


def check_all_or_none(path, seed):
    simulation, report = run(path, seed, stop_s=16)
    assert len(set(digests(simulation).values())) == 1, json.dumps(report["loads"])
    at = {(instant, late) for robot, instant, _, late in simulation.switches}
    assert len(at) <= 1, simulation.switches
    assert tokens(report) == ["1)", "2)", "3)"], json.dumps(report["loads"])
    assert report["violations"] == []
    return bool(at)


def test_a_replay_goes_over_the_switch(tmp_path):
    mind_run = MindRun(lab_in(tmp_path, loss=0.2))
    assert mind_run.simulation.switches
    for robot in (1, 5):
        replay = mind_run.replay(robot)
        assert replay.difference is None
        assert replay.node.machine.facts() == mind_run.simulation.robots[robot - 1].node.machine.facts()


def test_a_replay_goes_over_a_switch_with_offers_under_way(tmp_path):
    path = lab_in(tmp_path, new=PAIRS + OTHER_RULE, loss=0.2)
    (tmp_path / "old.rmr").write_text("type other(robot).\n" + PAIRS + RULE)
    mind_run = MindRun(path)
    assert mind_run.simulation.switches
    for robot in (1, 2):
        replay = mind_run.replay(robot)
        assert replay.difference is None
        assert replay.node.machine.facts() == mind_run.simulation.robots[robot - 1].node.machine.facts()


def test_a_replay_for_explanations_ends_at_the_switch(tmp_path):
    mind_run = MindRun(lab_in(tmp_path))
    [instant] = {instant for _, instant, _, _ in mind_run.simulation.switches}
    replay = mind_run.replay(1, provenance=ProvenanceLog(), one_program=True)
    assert replay.changed_at == instant
    assert 0 < replay.now <= instant
    assert replay.difference is None


def test_a_load_of_an_unknown_robot_or_file_is_an_error_of_the_lab_file(tmp_path):
    path = lab_in(tmp_path, robots=", robots: 8")
    path.write_text(path.read_text().replace("new.rmr", "none.rmr"))
    with pytest.raises(LabError) as caught:
        load(path, Options())
    assert "robot 8 is not in this lab" in str(caught.value)
    assert "there is no file" in str(caught.value)


@pytest.mark.parametrize(("old", "new"), [(RULE, ""), ("", RULE), (RULE, OTHER_RULE)])
@pytest.mark.parametrize("crash", [False, True])
def test_across_a_switch_no_fact_of_a_rule_over_several_robots_is_used_twice_or_lost(tmp_path, old, new, crash):
    # The switch is some 5 s after the beginning of the load; robot 2 dies a second before it, and returns after it.
    faults = "[{at: 5s, kill: 2}, {at: 9s, restart: 2}]" if crash else "[]"
    path = lab_in(tmp_path, new=PAIRS + new, loss=0.3, faults=faults, duration="30s")
    (tmp_path / "old.rmr").write_text("type other(robot).\n" + PAIRS + old)
    simulation, report = run(path, 1)
    [entry] = report["loads"]
    assert entry["switched"]
    assert len(set(digests(simulation).values())) == 1
    assert report["violations"] == []
    held = {robot.robot: [fact for fact in robot.node.machine.facts() if robot.alive] for robot in simulation.robots}
    firings = {
        name: {
            (robot, int(x), int(y))
            for robot, facts in held.items()
            for fact in facts
            for x, y in re.findall(rf"{name}\(@\d, (\d+), (\d+)\)", fact)
        }
        for name in ("paired", "lent")
    }
    assert firings["paired"]
    lost = {2} if crash else set()  # its second life makes its numbers again
    used = [number for _, x, y in firings["paired"] for number in (x, y) if number // 100 not in lost]
    assert len(set(used)) == len(used)
    for name, other in (("paired", "lent"), ("lent", "paired")):
        known = {(x, y) for _, x, y in firings[other]}
        partners = {(x, y) for robot, x, y in firings[name] if (y if name == "paired" else x) // 100 not in lost}
        assert partners <= known, "a firing is half"
    for robot in {1, 2, 3, 4} - lost:
        own = [int(x) for fact in held[robot] for x in re.findall(r"idle\(@\d, (\d+)\)", fact)]
        own += [number for pair in {(x, y) for each in firings.values() for _, x, y in each} for number in pair]
        assert sorted(number for number in own if number // 100 == robot) == [robot * 100 + n for n in range(40)]


def test_a_program_that_reads_shared_facts_is_loaded_and_hears_of_them(tmp_path):
    """What is heard of neighbours is known by the rules of one program, and heard anew under the next one."""
    shared = NEW + "type shared level(robot, int).\ntype seen(robot, robot, int).\nlevel(@2, 5).\nlevel(@3, 6).\n"
    shared += "next(R, S), level(S, L) -o seen(R, S, L).\n"
    simulation, report = run(lab_in(tmp_path, new=shared, loss=0.2))
    [entry] = report["loads"]
    assert entry["switched"]
    for robot, told in ((1, "seen(@1, @2, 5)"), (2, "seen(@2, @3, 6)")):
        assert told in simulation.robots[robot - 1].node.machine.facts()
