"""The library's files for whole ensembles: what docs/library.md promises, with loss and while a robot dies."""

from itertools import pairwise

import pytest
from test_eval_library import LOSSES, PROGRAMS, SIZES, held, run_of, single, ways

from rmr.eval.api import evaluate

FILES = ["gossip", "ordered", "snapshot", "auction", "channel"]


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


# ---- ordered


def orders(run):
    """What each robot got: time, place and value, by robot."""
    return {
        robot: [(time, int(place), float(value)) for time, place, value in each]
        for robot, each in told(run, "got").items()
    }


@pytest.mark.parametrize(
    ("count", "loss", "seed"),
    [
        *((4, loss, seed) for loss in LOSSES for seed in range(3)),
        *((20, loss, 1) for loss in LOSSES),
        pytest.param(100, 0.0, 1, marks=pytest.mark.slow),
    ],
)
def test_all_get_the_same_messages_in_the_same_order_when_the_sequencer_dies(count, loss, seed):
    senders = sorted({1, 2, 3, count})
    insert = [f"{0.1 * k}s: ordered_send(@{each}, more, {each + 0.1 * k})" for k in range(1, 4) for each in senders]
    options = {"topology": "complete", "insert": insert, "seed": seed}
    run = run_of("ordered", count, loss, **options, kill=[f"1.5s: @{count}"])
    got = orders(run)
    dead = got.pop(count)
    lists = {tuple((place, value) for _, place, value in each) for each in got.values()}
    assert len(lists) == 1
    (order,) = lists
    assert [place for place, _ in order] == list(range(1, len(order) + 1))
    values = [value for _, value in order]
    for each in senders[:-1]:
        own = [each, *(each + 0.1 * k for k in range(1, 4))]
        assert [value for value in values if int(value) == each] == pytest.approx(own)
    told_to_dead = [(place, value) for _, place, value in dead]
    assert 0 < len(told_to_dead) < len(order)
    assert tuple(told_to_dead)[:-1] == order[: len(told_to_dead) - 1]
    for before, after in pairwise(zip(*got.values(), strict=True)):
        assert max(time for time, _, _ in before) <= min(time for time, _, _ in after), "one message more at most"


@pytest.mark.parametrize("seed", range(6))
def test_nobody_is_left_behind_when_most_frames_are_lost(seed):
    insert = [f"{0.5 * k}s: ordered_send(@{1 + k % 4}, more, {10 + k})" for k in range(20)]
    run = run_of("ordered", 4, 0.7, topology="complete", insert=insert, seed=seed)
    got = orders(run)
    assert {tuple((place, value) for _, place, value in each) for each in got.values()} == {
        tuple((place, value) for _, place, value in got[1])
    }
    assert sorted(value for _, _, value in got[1]) == [1, 2, 3, 4, *range(10, 30)]
    for before, after in pairwise(zip(*got.values(), strict=True)):
        assert max(time for time, _, _ in before) <= min(time for time, _, _ in after)


def test_a_robot_that_is_back_gets_the_later_messages_in_the_order_of_all_others():
    insert = [f"{4 + 2 * k}s: ordered_send(@{1 + k % 3}, more, {10 + k})" for k in range(20)]
    for dies in (2, 4):
        run = run_of(
            "ordered", 4, 0.2, topology="complete", insert=insert, kill=[f"5s: @{dies}"], restart=[f"30s: @{dies}"]
        )
        got = {robot: [(place, value) for _, place, value in each] for robot, each in orders(run).items()}
        whole = got.pop(1)
        own = got.pop(dies)
        assert set(map(tuple, got.values())) == {tuple(whole)}
        places = [place for place, _ in own]
        assert places == sorted(set(places))
        assert [each for each in whole if each in own] == own
        assert own[-1] == whole[-1]


def test_without_more_than_half_of_the_robots_nothing_more_is_ordered():
    options = {"robots": 4, "topology": "complete", "loss": 0.2, "until": 100}
    insert = ["6s: ordered_send(@1, more, 7.0)"]
    run = evaluate(PROGRAMS["ordered"], **options, insert=insert, kill=["5s: @3,@4"])
    assert [value for _, _, value in orders(run)[1]].count(7.0) == 0
    run = evaluate(PROGRAMS["ordered"], **options, insert=insert, kill=["5s: @3,@4"], restart=["50s: @4"])
    got = orders(run)
    for each in (1, 2, 4):
        assert [value for _, _, value in got[each]].count(7.0) == 1


# ---- snapshot


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("count", SIZES)
def test_the_total_of_each_snapshot_is_the_true_one(count, loss):
    passed = 0
    for seed in range(10 if count == 4 else 1):
        takes = ["1s: snapshot_take(@1, 2)", "1.01s: snapshot_take(@3, 1)", "2s: snapshot_take(@1, 3)"]
        run = run_of("snapshot", count, loss, insert=takes, action_times={"work": 0.05}, seed=seed)
        totals = {robot: facts for robot, facts in held(run, "snapshot_total").items() if facts}
        whole = [str(10.0 * count), str(count)]
        assert totals == {1: [["1", *whole], ["2", *whole], ["3", *whole]], 3: [["1", *whole]]}
        passed += sum(map(len, held(run, "snapshot_passed").values()))
    assert passed, "something was under way"


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("count", [4, 20])
def test_a_snapshot_has_what_is_left_when_a_robot_has_died(count, loss):
    options = {"kill": ["20s: @3"], "action_times": {"work": 0.05}}
    run = run_of("snapshot", count, loss, insert=["60s: snapshot_take(@1, 2)"], **options)
    left = sum(float(value) for [value] in single(run, "snapshot_value").values())
    assert left < 10 * count
    assert held(run, "snapshot_total")[1][1:] == [["2", str(left), str(count - 1)]]
    run = run_of("snapshot", count, loss, insert=["19.995s: snapshot_take(@1, 2)"], **options)
    assert held(run, "snapshot_total")[1][1:] == [["2", str(left), str(count - 1)]], "not waited for longer than 16 s"


@pytest.mark.parametrize("seed", range(8))
def test_what_has_arrived_and_not_been_taken_in_is_in_the_picture_once(seed):
    program = """
        include "std/snapshot.rmr".
        peer(R, B) -o snapshot_link(R, B).
        snapshot_value(R, 10).
        snapshot_message(@1, @2, 5.0).
        snapshot_receive(@2, @1, 3.0).
        snapshot_link(R, B) -o go(R).
        go(@1) -o snapshot_take(@1, 1).
        go(@2) -o 1.
    """
    run = evaluate(program, robots=2, loss=0.2, seed=seed)
    assert held(run, "snapshot_total")[1] == [["1", "28.0", "2"]]
    program = """
        include "std/snapshot.rmr".
        snapshot_value(R, 10).
        snapshot_message(@1, @2, 5.0).
        snapshot_marker(@1, @2, @2, 1).
    """
    run = evaluate(program, robots=2, loss=0.2, seed=seed)
    assert held(run, "snapshot_cut")[1] == [["@2", "1", "@2", "15.0"]], "it was sent before the marker"


def test_what_was_long_ago_goes():
    takes = [f"{at}s: snapshot_take(@1, {number})" for at, number in ((1, 5), (2, 6), (3, 15))]
    run = run_of("snapshot", 4, 0.2, insert=takes, action_times={"work": 0.05})
    for facts in held(run, "snapshot_cut").values():
        assert {number for _, number, _, _ in facts} == {"6", "15"}
    assert {number for facts in held(run, "snapshot_passed").values() for _, number, *_ in facts} <= {"6", "15"}
    assert [each[1:] for each in held(run, "snapshot_total")[1]] == [["40.0", "4"]] * 4


# ---- auction


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("count", [4, 20, 100])
def test_the_lowest_bidder_does_the_task_and_when_it_dies_the_next_one(count, loss):
    options = {"robots": count, "loss": loss, "action_times": {"work": 20.0}, "until": 200}
    run = evaluate(PROGRAMS["auction"], **options)
    assert held(run, "handover_done")[1] == [["7"], ["8"]]
    works = {robot: [task for _, _, task in each] for robot, each in told(run, "work").items() if each}
    assert sorted(task for each in works.values() for task in each) == ["7", "8"]
    assert sorted(works) == ([3, 4] if count == 4 else [7, 8])
    if count > 4:
        assert works == {7: ["7"], 8: ["8"]}
    dies = max(works)
    run = evaluate(PROGRAMS["auction"], **options, kill=[f"8s: @{dies}"])
    assert sorted(held(run, "handover_done")[1]) == [["7"], ["8"]]
    later = [(robot, time, task) for robot, each in told(run, "work").items() for time, _, task in each if time > 8]
    assert [(robot, [task]) for robot, _, task in later] == [(2 if count == 4 else 9, works[dies])]
    assert 16.5 < later[0][1] < 25, "12 seconds after the last lease, and 2 for the bids"


@pytest.mark.parametrize("loss", LOSSES)
def test_a_worker_that_is_back_is_called_again_and_may_bid_late(loss):
    program = """
        include "std/auction.rmr".
        type action work(R: robot, A: robot, T: int) -o handover_report(R, A, T).
        type begun(robot).
        type ready(robot).
        handover_task(@1, 7).
        handover_worker(@1, @2).
        auction_call(R, A, T, N), ready(R) -o auction_bid(A, R, T, N, 1).
        $handover_doing(R, A, T, _), not begun(R) -o begun(R), work(R, A, T).
    """
    options = {"robots": 3, "loss": loss, "action_times": {"work": 20.0}, "until": 200}
    run = evaluate(program, **options, kill=["5s: @2"], restart=["12s: @2"], insert=["30s: ready(@2)"])
    assert run.quiescent
    assert held(run, "handover_done")[1] == [["7"]]
    assert [31.9 < time < 34 for each in told(run, "work").values() for time, *_ in each] == [True]


# ---- channel


def in_channel(count, ends, width, dead=()):
    one, other = [ways(count, end, dead) for end in ends]
    if ends[1] not in one:
        return set()
    return {robot for robot in one if robot in other and one[robot] + other[robot] <= one[ends[1]] + width}


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("count", SIZES)
def test_the_channel_is_the_shortest_ways_and_those_near_them(count, loss):
    side = len([each for each in range(count) if each * each < count])
    program = PROGRAMS["channel"].replace("@20", f"@{side}")
    options = {"robots": count, "topology": "grid", "loss": loss, "until": 600, "seed": 3}
    dead = [] if side == 2 else [2]
    for width in (0, 2):
        wide = program.replace("goal, 0)", f"goal, {width})")
        run = evaluate(wide, **options, kill=[f"10s: @{each}" for each in dead])
        assert run.quiescent
        assert {robot for robot, facts in held(run, "channel_on").items() if facts} == in_channel(
            count, (1, side), width, dead
        )
    for before, after in ((side, count), (count, side)):
        moves = [f"10s: leave(@{before})", f"10s: gradient_source(@{after}, goal)"]
        run = evaluate(program.replace(f"@{side}", f"@{before}"), **options, insert=moves)
        assert run.quiescent
        on = {robot for robot, facts in held(run, "channel_on").items() if facts}
        assert on == in_channel(count, (1, after), 0)


def test_there_is_no_channel_between_ends_without_a_way():
    program = PROGRAMS["channel"].replace("@20", "@5")
    run = evaluate(program, robots=5, topology="line", loss=0.2, until=100)
    assert all(held(run, "channel_on").values())
    run = evaluate(program, robots=5, topology="line", loss=0.2, until=100, kill=["10s: @3"])
    assert run.quiescent
    assert not any(held(run, "channel_on").values())
