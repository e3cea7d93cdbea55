"""Programs with rules over several robots have their results at every loss, and cost what the documentation says."""

import json
import os
import re
from pathlib import Path

import pytest
from eval_command import facts

from rmr.bytecode.codec import decode, encode
from rmr.bytecode.layout import FLAG_ENSEMBLE
from rmr.lang.compiler import compile_source
from rmr.lang.explain.explained_rules import FRAMES

PROGRAMS = Path(__file__).parents[1] / "programs" / "ensemble"
SEEDS = range(int(os.environ.get("RMR_SEEDS", "20")))
"""Seeds of each program at each loss; ``RMR_SEEDS=200 pytest -m slow`` on this file runs ten times as many."""
LOSSES = (0.0, 0.2, 0.4)


def program(name):
    return (PROGRAMS / f"{name}.rmr").read_text("utf-8")


def runs(bench, text, loss, *arguments):
    """Yield each seed with the report of a run; the program is compiled once."""
    compiled = compile_source(text).program
    assert compiled is not None
    path = bench.folder / "p.rbc"
    path.write_bytes(encode(compiled, debug=False))
    for seed in SEEDS:
        result = bench.call(str(path), *arguments, "--loss", str(loss), "--seed", str(seed))
        assert result.exit_code == 0, result.stderr
        yield seed, json.loads(result.stdout)


def all_facts(report):
    return {robot: [each for each in facts(report, robot) if "edge" not in each] for robot in report["robots"]}


def settled(report):
    """Whether a run is over and nothing is set aside."""
    return report["quiescent"] and not any("set_aside" in each for each in report["robots"].values())


@pytest.mark.slow
@pytest.mark.parametrize("loss", LOSSES)
def test_one_of_two_that_wait_gets_the_one_that_is_free(bench, loss):
    for seed, report in runs(bench, program("waiting-and-free"), loss, "--robots", "3", "--edges", "edge"):
        held = all_facts(report)
        assert settled(report), seed
        assert sorted([held["1"], held["2"]]) in (
            [["on(@1, west)"], ["waiting(@2, west)"]],
            [["on(@2, west)"], ["waiting(@1, west)"]],
        ), seed
        assert held["3"] == ["free(@3, east)"], seed


@pytest.mark.slow
@pytest.mark.parametrize("loss", LOSSES)
def test_pairs_are_mutual_and_no_two_neighbours_are_left(bench, loss):
    arguments = ("--robots", "9", "--topology", "grid", "--edges", "edge")
    for seed, report in runs(bench, program("pairs"), loss, *arguments):
        assert settled(report), seed
        text = json.dumps(all_facts(report))
        pairs = {(int(a), int(b)) for a, b in re.findall(r"paired\(@(\d+), @(\d+)\)", text)}
        idle = {int(a) for a in re.findall(r"idle\(@(\d+)\)", text)}
        edges = {(int(a), int(b)) for a, b in re.findall(r"edge\(@(\d+), @(\d+)\)", json.dumps(report["robots"]))}
        assert all((b, a) in pairs for a, b in pairs), seed
        assert len({a for a, _ in pairs}) == len(pairs) == 9 - len(idle), seed
        assert not any(a in idle and b in idle for a, b in edges), seed


@pytest.mark.slow
@pytest.mark.parametrize("loss", LOSSES)
def test_a_line_is_sorted_by_exchanges(bench, loss):
    for seed, report in runs(bench, program("sorted-line"), loss, "--robots", "6"):
        assert settled(report), seed
        held = [[each for each in facts(report, robot) if each.startswith("val")] for robot in range(1, 7)]
        assert held == [[f"val(@{robot}, {robot - 1})"] for robot in range(1, 7)], seed


@pytest.mark.slow
@pytest.mark.parametrize("loss", LOSSES)
def test_reachability_is_the_transitive_closure(bench, loss):
    reached = {"0": "01234", "1": "24", "2": "24", "3": "01234", "4": "24"}
    for seed, report in runs(bench, program("reachability"), loss, "--robots", "0-4"):
        assert settled(report), seed
        for robot, others in reached.items():
            assert all_facts(report)[robot] == [f"!path(@{robot}, @{other})" for other in others], seed


@pytest.mark.slow
@pytest.mark.parametrize("loss", LOSSES)
def test_each_job_is_done_by_one_idle_robot(bench, loss):
    for seed, report in runs(bench, program("jobs"), loss, "--robots", "5"):
        held = [each for found in all_facts(report).values() for each in found]
        assert settled(report), seed
        assert sorted(re.findall(r"does\(@[123], (\d)\)", " ".join(held))) == ["1", "2", "7"], seed
        assert sorted(each for each in held if each.startswith(("idle", "job"))) == ["idle(@4)", "idle(@5)"], seed


@pytest.mark.slow
@pytest.mark.parametrize("loss", LOSSES)
def test_no_two_neighbours_eat_at_the_same_time_and_all_are_fed(bench, loss):
    for seed, report in runs(bench, program("philosophers"), loss, "--robots", "10", "--action-time", "1s"):
        assert settled(report), seed
        held = " ".join(each for robot in report["robots"] for each in facts(report, robot))
        assert (held.count("fed("), held.count("fork("), held.count("hungry(")) == (5, 5, 0), seed
        ends = [report["robots"][str(robot)]["actions"][0][0] for robot in range(1, 6)]
        # A fork returns when the action has ended: two that share one end a second apart at least.
        assert all(abs(ends[k] - ends[(k + 1) % 5]) >= 1.0 for k in range(5)), (seed, ends)


@pytest.mark.slow
@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize(("robots", "teams", "left"), [(10, 3, 1), (8, 2, 1)])
def test_teams_are_disjoint_and_who_is_left_is_free(bench, loss, robots, teams, left):
    text = program("teams")
    for gone in range(robots + 1, 11):
        text = text.replace(f"free(@{gone}).\n", "")
    for seed, report in runs(bench, text, loss, "--robots", str(robots)):
        assert settled(report), seed
        held = " ".join(each for robot in report["robots"] for each in facts(report, robot))
        found = re.findall(r"team\(@(\d+), @(\d+), @(\d+)\)", held)
        members = {(int(b), int(a)) for a, b in re.findall(r"member\(@(\d+), @(\d+)\)", held)}
        assert len(found) == teams, seed
        assert members == {(int(one[0]), int(each)) for one in found for each in one[1:]}, seed
        assert len({each for one in found for each in one}) == 3 * teams, seed
        assert (held.count("free("), held.count("leader(")) == (left, 3 - teams), seed


ONE = """
type waiting(robot, int).
type free(robot).
type !done(robot, robot, int).
free(@2).
waiting(A, X), free(B), peer(A, B) -o done(A, B, X).
"""


def test_a_firing_takes_two_frames_once_the_robots_know_each_other(bench):
    first = bench.run(ONE, "--robots", "2", "--insert", "0s: waiting(@1, 1)")
    again = bench.run(
        ONE.replace("free(@2).", "free(@2). free(@2)."),
        "--robots",
        "2",
        "--insert",
        "0s: waiting(@1, 1)",
        "--insert",
        "1s: waiting(@1, 2)",
    )
    assert facts(first) == ["!done(@1, @2, 1)"]
    assert facts(again) == ["!done(@1, @2, 1)", "!done(@1, @2, 2)"]
    assert (first["messages"]["sent"], again["messages"]["sent"]) == (4, 6)
    assert again["time_s"] == pytest.approx(1.01)


ROUND = """
type !left(robot, robot).
type !right(robot, robot).
type !third(robot, robot).
left(@1, @2).
right(@1, @3).
third(@1, @4).
free(@2, 1). free(@2, 2). free(@3, 1). free(@3, 2). free(@4, 1). free(@4, 2).
"""


@pytest.mark.parametrize("others", [1, 2, 3])
def test_a_firing_costs_the_frames_that_are_explained(bench, others):
    remotes = (("left", "B"), ("right", "C"), ("third", "D"))[:others]
    body = ", ".join(f"{link}(A, {robot}), free({robot}, X)" for link, robot in remotes)
    text = f"{ROUND}waiting(A, X), {body} -o got(A, X), gave(B, X).\n"
    inserts = ("--insert", "0s: waiting(@1, 1)", "--insert", "1s: waiting(@1, 2)")
    first, both = (bench.run(text, "--robots", "4", *inserts[:many]) for many in (2, 4))
    assert "got(@1, 2)" in facts(both)
    assert both["messages"]["sent"] - first["messages"]["sent"] == FRAMES[others]


def test_robots_that_are_always_hungry_take_turns(bench):
    text = re.sub(r"fed\(A\)", "hungry(A)", program("philosophers"))
    report = bench.run(text, "--robots", "10", "--action-time", "100ms", "--until", "3s")
    ends = [[at for at, _ in report["robots"][str(robot)]["actions"]] for robot in range(1, 6)]
    assert min(map(len, ends)) >= max(map(len, ends)) / 3
    assert max(map(len, ends)) >= 4


def test_a_trace_has_meanings_in_place_of_names_that_the_compiler_has_made(bench):
    notes = bench.notes(ONE, "--robots", "2", "--insert", "0s: waiting(@1, 7)")
    assert "__" not in json.dumps(notes)
    assert "offered to @2 by @1, rule p.rmr:6" in [each.get("fact") for each in notes]
    assert "offer of rule p.rmr:6" in [each.get("predicate") for each in notes]


def test_a_rule_that_cannot_fire_lets_the_program_become_quiet_and_fires_later(bench):
    arguments = ("--robots", "2", "--insert", "0s: waiting(@1, 1)", "--insert", "9s: free(@2)")
    report = bench.run(ONE.replace("free(@2).\n", ""), *arguments)
    assert report["quiescent"]
    assert facts(report) == ["!done(@1, @2, 1)"]
    assert report["time_s"] == pytest.approx(9.015)


def test_what_is_offered_to_a_dead_robot_stays_set_aside(bench):
    arguments = ("--robots", "2", "--insert", "1s: waiting(@1, 2)", "--until", "90s")
    text = ONE.replace("free(@2).", "free(@2). free(@2). waiting(@1, 1).")
    report = bench.run(text, *arguments, "--kill", "0.5s: @2")
    assert not report["quiescent"]
    assert report["robots"]["1"]["set_aside"] == ["waiting(@1, 2)"]
    assert facts(report) == ["!done(@1, @2, 1)"]
    assert "waiting(@1, 2) is set aside" in bench.told(text, *arguments, "--kill", "0.5s: @2")


def test_what_was_offered_to_an_earlier_life_is_offered_to_the_next_one(bench):
    text = ONE.replace("free(@2).", "free(@2). free(@2). waiting(@1, 1).")
    report = bench.run(
        text, "--robots", "2", "--insert", "1s: waiting(@1, 2)", "--kill", "0.5s: @2", "--restart", "40s: @2"
    )
    assert settled(report)
    assert facts(report) == ["!done(@1, @2, 1)", "!done(@1, @2, 2)"]
    assert facts(report, 2) == ["free(@2)"]


def test_only_programs_with_ensemble_rules_have_their_table():
    plain = compile_source("p(@1).\np(R), peer(R, B) -o q(B).\n").program
    joint = compile_source("p(@1).\np(R), peer(R, B), p(B) -o q(B).\n").program
    assert plain is not None
    assert joint is not None
    assert (plain.ensemble, encode(plain, debug=True)[5] & FLAG_ENSEMBLE) == ((), 0)
    octets = encode(joint, debug=True)
    assert octets[5] & FLAG_ENSEMBLE
    assert decode(octets) == joint
