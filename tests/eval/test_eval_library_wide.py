"""The library's files for whole ensembles: what docs/library.md promises, with loss and while a robot dies."""

import pytest
from test_eval_library import LOSSES, PROGRAMS, SIZES, held, run_of, single

from rmr.eval.api import evaluate

FILES = ["gossip"]


def told(run, action):
    """Time and arguments behind the executor of each action of a name, by robot."""
    return {
        int(robot): [
            (time, *text.removesuffix(")").split(", ")[1:])
            for time, text in each["actions"]
            if text.startswith(f"{action}(")
        ]
        for robot, each in run.report["robots"].items()
    }


@pytest.mark.parametrize("name", FILES)
def test_both_engines_do_the_same(name):
    options = {"robots": 5, "loss": 0.2, "seed": 7, "until": 60, "kill": ["3s: @3"], "restart": ["30s: @3"]}
    one, other = [evaluate(PROGRAMS[name], **options, engine=each).report for each in ("interpreter", "generated")]
    assert {**one, "engine": ""} == {**other, "engine": ""}


# ---- gossip


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("count", SIZES)
def test_all_know_the_mean_of_the_live_robots(count, loss):
    run = run_of("gossip", count, loss, kill=[f"10s: @{count}"], insert=["20s: gossip_value(@1, heat, 100.0)"])
    expected = (sum(range(1, count)) + 100) / count
    means = {robot: float(mean) for robot, (_, mean) in single(run, "gossip_mean").items()}
    assert means == pytest.approx(dict.fromkeys(range(1, count), expected))


@pytest.mark.parametrize("seed", range(4))
def test_each_mean_lies_between_the_values_whatever_dies(seed):
    program = PROGRAMS["gossip"] + "type action told(robot, float).\n$gossip_mean(R, _, M) -o told(R, M).\n"
    down = {"kill": ["3s: @9", "3.3s: @5"], "restart": ["6s: @9"]}
    run = evaluate(program, robots=9, topology="grid", loss=0.5, seed=seed, until=60, **down)
    means = [float(mean) for each in told(run, "told").values() for _, mean in each]
    assert len(set(means)) > 9
    assert 1 <= min(means) <= max(means) <= 9


def test_robots_without_a_way_have_a_mean_of_their_own_and_none_without_values():
    run = run_of("gossip", 5, 0.2, topology="line", kill=["10s: @3"])
    assert {robot: mean for robot, (_, mean) in single(run, "gossip_mean").items()} == {
        1: "1.5",
        2: "1.5",
        4: "4.5",
        5: "4.5",
    }
    program = 'include "std/gossip.rmr".\ngossip_value(@2, heat, 3.5).\n'
    run = evaluate(program, robots=4, topology="line", loss=0.2, until=60)
    assert {mean for _, mean in single(run, "gossip_mean").values()} == {"3.5"}
    run = evaluate(program, robots=4, topology="line", loss=0.2, until=60, kill=["10s: @2"])
    assert run.quiescent
    assert not any(held(run, "gossip_mean").values())
