"""Files of the library in labs: shared facts, deliveries and silence as frames on the air bring them about."""

import re

import pytest
from lab_maker import small_lab

CUTS = [f"{{from: 0s, to: 200s, link: [{a}, {b}], cut: true}}" for a, b in ((1, 3), (1, 4), (2, 4))]
LINE = ", ".join(CUTS)
"""Of four robots only 1 and 2, 2 and 3, 3 and 4 hear each other."""


def held(run, predicate, dead=()):
    """The arguments behind the owner of the facts of a predicate, by robot, live ones only."""
    found = {}
    for robot, each in enumerate(run.robots, 1):
        if robot not in dead:
            facts = [re.fullmatch(r"!?(\w+)\(@\d+,? ?(.*)\)", fact) for fact in each.node.machine.facts()]
            found[robot] = [fact[2].split(", ") for fact in facts if fact[1] == predicate]
    return found


def ran(folder, program, *, duration, loss, faults="", seed=1, **more):
    run = small_lab(folder, program, robots=4, loss=loss, faults=f"[{faults}]", duration=duration, seed=seed, **more)
    run.run()
    return run


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_all_know_the_mean_of_the_live_robots(tmp_path, loss):
    program = """
        include "std/gossip.rmr".
        id(R, N) -o gossip_value(R, heat, N).
    """
    run = ran(tmp_path, program, faults=LINE, duration="15s", loss=loss)
    assert held(run, "gossip_mean") == {robot: [["heat", "2.5"]] for robot in range(1, 5)}
    run = ran(tmp_path, program, faults=f"{LINE}, {{at: 15s, kill: 4}}", duration="30s", loss=loss)
    assert held(run, "gossip_mean", dead=[4]) == {robot: [["heat", "2.0"]] for robot in range(1, 4)}


@pytest.mark.parametrize("loss", [0.0, 0.2])
@pytest.mark.parametrize("seed", [1, 2])
def test_all_get_the_same_order_when_the_sequencer_dies_and_one_more_is_away(tmp_path, loss, seed):
    program = """
        include "std/ordered.rmr".
        type log(robot, list float).
        type action wait(R: robot, S: float) -o again(R).
        type again(robot).
        log(R, []).
        start(R).
        start(R), id(R, N) -o ordered_send(R, mine, N), wait(R, 12).
        again(R), id(R, N) -o ordered_send(R, mine, N + 0.5).
        ordered_got(R, _, _, _, V), log(R, L) -o log(R, L + [V]).
    """
    faults = "{at: 10s, kill: 4}"
    run = ran(tmp_path, program, faults=faults, duration="50s", loss=loss, seed=seed)
    logs = {tuple(log) for [log] in held(run, "log", dead=[4]).values()}
    assert len(logs) == 1
    assert sorted(float(each.strip("[]")) for each in logs.pop()) == [1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0]
    faults = "{at: 10s, kill: 4}, {at: 10s, kill: 3}"
    run = ran(tmp_path, program, faults=faults, duration="50s", loss=loss, seed=seed)
    assert {len(log) for [log] in held(run, "log", dead=[3, 4]).values()} == {4}, "two of four live"
    run = ran(tmp_path, program, faults=f"{faults}, {{at: 40s, restart: 3}}", duration="90s", loss=loss, seed=seed)
    logs = {tuple(log) for [log] in held(run, "log", dead=[3, 4]).values()}
    assert len(logs) == 1
    assert {float(each.strip("[]")) for each in logs.pop()} == {1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0}


@pytest.mark.parametrize("loss", [0.0, 0.2])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_total_of_a_snapshot_is_the_true_one(tmp_path, loss, seed):
    program = """
        include "std/snapshot.rmr".
        type action wait(R: robot, S: float) -o step(R).
        type step(robot).
        peer(R, B) -o snapshot_link(R, B).
        snapshot_value(R, 10).
        step(R).
        step(R), snapshot_value(R, V), N = 1 + id(R) % 4
            -o if V >= 1
                   then snapshot_value(R, V - 1), snapshot_message(robot(N), R, 1)
                   else snapshot_value(R, V)
               end,
               wait(R, 0.1).
        snapshot_receive(R, _, X), snapshot_value(R, V) -o snapshot_value(R, V + X).
        start(@1).
        start(@2).
        start(R) -o pause(R, 5, 1).
        type action pause(R: robot, S: float, D: int) -o snapshot_take(R, D), next(R, D + 1).
        next(R, D), D < 9 -o pause(R, 1, D).
    """
    actions = """
        from rmr import action

        @action("pause")
        async def pause(robot, seconds, number):
            await robot.sleep(seconds)
    """
    run = ran(tmp_path, program, duration="20s", loss=loss, seed=seed, actions=actions)
    totals = held(run, "snapshot_total")
    assert totals[1] == totals[2] == [[str(number), "40.0", "4"] for number in range(1, 9)]
    assert any(held(run, "snapshot_passed").values())


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_the_lowest_bidder_does_the_task_and_when_it_dies_the_next_one(tmp_path, loss):
    program = """
        include "std/auction.rmr".
        type begun(robot, int).
        peer(@1, W) -o handover_worker(@1, W).
        start(@1).
        start(R) -o handover_task(R, 7).
        auction_call(W, A, T, N), id(W, I) -o auction_bid(A, W, T, N, 5 - I).
        $handover_doing(W, A, T, _), not begun(W, T) -o begun(W, T), dig(W, A, T, 20).
        type action dig(R: robot, A: robot, T: int, S: float) -o handover_report(R, A, T).
    """
    actions = """
        from rmr import action

        @action("dig")
        async def dig(robot, auctioneer, task, seconds):
            await robot.sleep(seconds)
    """
    run = ran(tmp_path, program, duration="10s", loss=loss, actions=actions)
    assert [robot for robot, facts in held(run, "begun").items() if facts] == [4]
    run = ran(tmp_path, program, faults="{at: 10s, kill: 4}", duration="60s", loss=loss, actions=actions)
    assert [robot for robot, facts in held(run, "begun", dead=[4]).items() if facts] == [3]
    assert held(run, "handover_done", dead=[4])[1] == [["7"]]


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_channel_goes_around_a_dead_robot(tmp_path, loss):
    program = """
        include "std/channel.rmr".
        gradient_source(@1, home).
        gradient_source(@3, goal).
        channel_width(R, home, goal, 0).
    """
    square = ", ".join(f"{{from: 0s, to: 200s, link: [{a}, {b}], cut: true}}" for a, b in ((1, 3), (2, 4)))
    for faults, end, dead, expected in (
        (square, "10s", [], [1, 2, 3, 4]),
        (f"{square}, {{at: 10s, kill: 2}}", "20s", [2], [1, 3, 4]),
        (f"{square}, {{at: 10s, kill: 2}}, {{at: 10s, kill: 4}}", "25s", [2, 4], []),
    ):
        run = ran(tmp_path, program, faults=faults, duration=end, loss=loss)
        assert [robot for robot, facts in held(run, "channel_on", dead).items() if facts] == expected
