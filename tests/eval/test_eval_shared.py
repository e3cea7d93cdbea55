"""Shared facts in an evaluation: gradients that heal, values over neighbours, both engines, quiescence."""

import pytest

from rmr.eval.api import evaluate
from rmr.vm.engines import Engine

GRADIENT = """
type shared hops(robot, int).
type !source(robot).
const far = 20.
source(@1).
hops(R, far).

source(R), hops(R, H), H > 0 -o hops(R, 0).
hops(R, H), not source(R), N = min(X + 1, neighbor(R, B), hops(B, X)), H != min(N, far) -o hops(R, min(N, far)).
"""


def hops(report):
    return [each["facts"][-1].partition(", ")[2].rstrip(")") for each in report["robots"].values()]


@pytest.mark.parametrize("loss", [0.0, 0.2, 0.5])
@pytest.mark.parametrize("engine", [Engine.GENERATED, Engine.INTERPRETER])
def test_a_gradient_of_three_lines_heals_around_a_dead_robot(loss, engine):
    options = {"robots": 6, "topology": "ring", "loss": loss, "engine": engine.value, "seed": 3}
    run = evaluate(GRADIENT, **options)
    assert run.quiescent
    assert hops(run.report) == ["0", "1", "2", "3", "2", "1"]
    run = evaluate(GRADIENT, **options, kill=["20s: @2"])
    assert run.quiescent
    assert hops(run.report) == ["0", "1", "4", "3", "2", "1"]
    assert run.report["robots"]["2"]["alive"] is False
    run = evaluate(GRADIENT, **options, kill=["20s: @2"], restart=["30s: @2"])
    assert hops(run.report) == ["0", "1", "2", "3", "2", "1"], "back in the ring"


def test_both_engines_do_the_same():
    options = {"robots": 9, "topology": "grid", "loss": 0.3, "kill": ["9s: @5"]}
    one, other = [evaluate(GRADIENT, **options, engine=each).report for each in ("interpreter", "generated")]
    assert one == other


def test_when_the_source_dies_the_gradient_counts_up_to_its_bound_and_stops():
    run = evaluate(GRADIENT, robots=5, topology="line", kill=["5s: @1"])
    assert run.quiescent
    assert hops(run.report) == ["0", "20", "20", "20", "20"]


def test_without_loss_each_change_is_one_frame_for_each_neighbour():
    report = evaluate(GRADIENT, robots=6, topology="line").report
    assert report["messages"]["sent"] <= 3 * 10


def test_counts_sums_means_and_lists_over_neighbours_are_one_expression_each():
    program = """
        type shared temp(robot, float).
        type mean(robot, float).
        type count_of(robot, int).
        type warmest(robot, robot, float).
        type all_of(robot, list float).
        type go(robot).
        temp(@1, 10.0).  temp(@2, 20.0).  temp(@3, 40.0).
        go(@1), N = count(neighbor(@1, B), temp(B, _)), N = 2,
            S = sum(T, neighbor(@1, B), temp(B, T)) -o mean(@1, S / N), count_of(@1, N), look(@1).
        look(R) -o [max T => M | neighbor(R, B), temp(B, T) | warmest(R, B, M)],
                   [collect T => L | neighbor(R, B), temp(B, T) | all_of(R, L)].
        go(@1).
    """
    report = evaluate(program, robots=3).report
    assert report["robots"]["1"]["facts"] == [
        "all_of(@1, [20.0, 40.0])",
        "count_of(@1, 2)",
        "mean(@1, 30.0)",
        "temp(@1, 10.0)",
        "warmest(@1, @3, 40.0)",
    ]


def test_nobody_hears_of_a_robot_that_is_out_of_range():
    program = """
        type shared level(robot, int).
        type heard(robot, robot).
        level(@3, 1).
        peer(R, N), level(N, _) -o heard(R, N).
    """
    report = evaluate(program, robots=3, topology="line").report
    assert [each["facts"] for each in report["robots"].values()] == [[], ["heard(@2, @3)"], ["level(@3, 1)"]]


def test_facts_without_room_in_a_frame_are_warned_of(bench):
    many = "\n".join(f"level(@1, {1000 + k})." for k in range(20))
    program = f"type shared level(robot, int).\ntype seen(robot, int).\n{many}\n"
    program += "neighbor(R, N), level(N, L) -o seen(R, L).\n"
    assert "robot 1: neighbours are not told 9 facts level/...: no frame has room for them" in bench.told(
        program, "--robots", "2"
    )
    assert "seen(@2, 1019)" in evaluate(program, robots=2).report["robots"]["2"]["facts"]


def test_a_shared_fact_that_never_stops_changing_keeps_its_rate():
    program = """
        type shared level(robot, int).
        type seen(robot, int).
        type action wait(R: robot, S: float) -o tick(R).
        type tick(robot).
        level(@1, 0).
        tick(@1).
        tick(R), level(R, N) -o level(R, N + 1), wait(R, 0.01).
        seen(R, _), neighbor(R, B), level(B, N) -o seen(R, N).
        seen(@2, 0).
    """
    run = evaluate(program, robots=2, until=10.0, action_time=0.01)
    assert not run.quiescent
    assert run.report["messages"]["sent"] <= 10 / 0.2 + 1


@pytest.mark.parametrize("latency", [0.0, 0.005])
def test_a_robot_that_is_back_is_heard_at_once_whatever_the_latency(latency):
    program = """
        type shared level(robot, int).
        type tick(robot).
        type total(robot, int).
        level(R, 4).
        tick(@1), N = sum(X, neighbor(@1, B), level(B, X)) -o total(@1, N).
    """
    more = {"kill": ["2s: @2"], "restart": ["5s: @2"], "insert": ["8s: tick(@1)"], "until": 20}
    run = evaluate(program, robots=3, latency=latency, **more)
    assert "total(@1, 8)" in run.report["robots"]["1"]["facts"]
