"""The library: what docs/library.md promises of each file, with loss and with a robot that dies."""

import os
import re
from collections import deque
from itertools import pairwise
from pathlib import Path

import pytest

from rmr.eval.api import evaluate
from rmr.lang.read.include import LIBRARY, library_files

PAGE = Path(__file__).parents[2] / "docs" / "library.md"
FAR = 1000000
SIZES = [4, 20, pytest.param(100, marks=pytest.mark.slow)]
LOSSES = [0.0, 0.2]


def grid(count):
    """The neighbours of each robot in `rmr eval --topology grid`."""
    side = next(each for each in range(count + 1) if each * each >= count)
    near = {robot: set() for robot in range(1, count + 1)}
    for index in range(count):
        if (index + 1) % side and index + 1 < count:
            near[index + 1].add(index + 2)
            near[index + 2].add(index + 1)
        if index + side < count:
            near[index + 1].add(index + side + 1)
            near[index + side + 1].add(index + 1)
    return near


def ways(count, source, dead=()):
    """Hops from the source to each live robot of a grid; none for those without a way."""
    near = grid(count)
    found = {} if source in dead else {source: 0}
    queue = deque(found)
    while queue:
        robot = queue.popleft()
        for each in sorted(near[robot] - found.keys() - set(dead)):
            found[each] = found[robot] + 1
            queue.append(each)
    return found


def held(run, predicate):
    """The arguments behind the owner of the facts of a predicate, by robot, live ones only."""
    found = {}
    for robot, each in run.report["robots"].items():
        if each.get("alive", True):
            facts = [re.fullmatch(r"!?(\w+)\(@\d+,? ?(.*)\)", fact) for fact in each["facts"]]
            found[int(robot)] = [fact[2].split(", ") for fact in facts if fact[1] == predicate]
    return found


def single(run, predicate):
    return {robot: facts for robot, [facts] in held(run, predicate).items()}


def run_of(name, count, loss, **more):
    options = {"robots": count, "loss": loss, "until": 600, "seed": 3, **more}
    run = evaluate(PROGRAMS[name], **{"topology": "grid", **options})
    assert run.quiescent
    return run


PROGRAMS = {
    "gradient": 'include "std/gradient.rmr".\ngradient_source(@1, home).\n',
    "distance": 'include "std/distance.rmr".\ndistance_source(@1, home).\n',
    "tree": 'include "std/tree.rmr".\ngradient_source(@1, home).\n',
    "collect": 'include "std/collect.rmr".\ngradient_source(@1, home).\ncollect_value(R, home, 1.5).\n',
    "broadcast": 'include "std/broadcast.rmr".\nbroadcast_set(@1, speed, 2.5).\n',
    "leader": 'include "std/leader.rmr".\nhere(@1).\nhere(R) -o 1.\n',
    "barrier": """
        include "std/barrier.rmr".
        barrier_wait(R, 1).
        barrier_passed(R, K), K < 3 -o barrier_wait(R, K + 1).
    """,
    "handover": """
        include "std/handover.rmr".
        type action work(R: robot, A: robot, T: int) -o handover_report(R, A, T).
        type action drop(robot, robot, int).
        type begun(robot, int).
        handover_task(@1, 7).
        handover_task(@1, 8).
        peer(@1, W) -o handover_worker(@1, W).
        $handover_doing(R, A, T, _), not begun(R, T) -o begun(R, T), work(R, A, T).
        handover_lost(R, A, T), begun(R, T) -o drop(R, A, T).
    """,
    "gossip": 'include "std/gossip.rmr".\nid(R, N) -o gossip_value(R, heat, N).\n',
    "ordered": """
        include "std/ordered.rmr".
        type action got(robot, int, float).
        id(R, N), N < 5 -o ordered_send(R, mine, N).
        ordered_got(R, N, _, _, V) -o got(R, N, V).
    """,
    "snapshot": """
        include "std/snapshot.rmr".
        type action work(R: robot, N: int) -o step(R, N).
        type step(robot, int).
        neighbor(R, B) -o snapshot_link(R, B).
        snapshot_value(R, 10).
        step(R, 60).
        step(R, N),
        N > 0,
        snapshot_value(R, V),
        X = if(V >= 1, 1, 0),
        M = min((id(C) * 31 + N * 17) % 101, neighbor(R, C)),
        neighbor(R, B),
        M = (id(B) * 31 + N * 17) % 101
            -o snapshot_value(R, V - X), snapshot_message(B, R, X), work(R, N - 1),
               if N = 58 && R = @1 then snapshot_take(R, 1) end.
        snapshot_receive(R, _, X), snapshot_value(R, V) -o snapshot_value(R, V + X).
    """,
    "auction": """
        include "std/auction.rmr".
        type action work(R: robot, A: robot, T: int) -o handover_report(R, A, T).
        type action drop(robot, robot, int).
        type begun(robot, int).
        handover_task(@1, 7).
        handover_task(@1, 8).
        peer(@1, W) -o handover_worker(@1, W).
        auction_call(R, A, T, N), id(R, I) -o auction_bid(A, R, T, N, abs(I - T)).
        $handover_doing(R, A, T, _), not begun(R, T) -o begun(R, T), work(R, A, T).
        handover_lost(R, A, T), begun(R, T) -o drop(R, A, T).
    """,
    "channel": """
        include "std/channel.rmr".
        type leave(robot).
        gradient_source(@1, home).
        gradient_source(@20, goal).
        channel_width(R, home, goal, 0).
        leave(R), gradient_source(R, _) -o 1.
    """,
}


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("count", SIZES)
def test_hops_are_those_of_a_shortest_way_after_a_death_too(count, loss):
    run = run_of("gradient", count, loss, kill=["10s: @2"])
    expected = ways(count, 1, dead=[2])
    assert {robot: int(hops) for robot, (_, hops) in single(run, "gradient_hops").items()} == {
        robot: expected.get(robot, FAR) for robot in range(1, count + 1) if robot != 2
    }


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("count", SIZES)
def test_hops_follow_a_source_that_moves_and_end_with_the_last_one(count, loss):
    program = PROGRAMS["gradient"] + "type leave(robot).\nleave(R), gradient_source(R, _) -o 1.\n"
    options = {"robots": count, "topology": "grid", "loss": loss, "until": 600}
    moved = ["5s: leave(@1)", f"5s: gradient_source(@{count}, home)"]
    run = evaluate(program, **options, insert=moved)
    assert run.quiescent
    assert {robot: int(hops) for robot, (_, hops) in single(run, "gradient_hops").items()} == ways(count, count)
    run = evaluate(program, **options, insert=moved[:1])
    assert run.quiescent
    assert {int(hops) for _, hops in single(run, "gradient_hops").values()} == {FAR}


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("count", SIZES)
def test_distances_are_sums_of_ranges(count, loss):
    run = run_of("distance", count, loss, kill=["10s: @2"])  # all ranges are 1.0 here
    expected = ways(count, 1, dead=[2])
    assert {robot: float(far) for robot, (_, far) in single(run, "distance_to").items()} == {
        robot: float(expected.get(robot, FAR)) for robot in range(1, count + 1) if robot != 2
    }


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("count", SIZES)
def test_parents_are_neighbours_one_hop_nearer(count, loss):
    run = run_of("tree", count, loss, kill=["10s: @2"])
    expected, near = ways(count, 1, dead=[2]), grid(count)
    for robot, (_, parent) in single(run, "tree_parent").items():
        nearer = [each for each in near[robot] if expected.get(each, FAR) == expected.get(robot, FAR) - 1]
        assert parent == f"@{min(nearer, default=robot)}"


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("count", SIZES)
def test_each_value_with_a_way_is_in_the_total_once(count, loss):
    run = run_of("collect", count, loss, kill=["10s: @2"])
    live = len(ways(count, 1, dead=[2]))
    totals = {robot: facts for robot, facts in held(run, "collect_total").items() if facts}
    assert totals == {1: [["home", str(1.5 * live), str(live)]]}


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("count", SIZES)
def test_all_have_the_last_value_those_that_restarted_too(count, loss):
    more = ["10s: broadcast_set(@1, speed, 3.5)", "10.1s: broadcast_set(@1, speed, 4.5)"]
    run = run_of("broadcast", count, loss, insert=more, kill=["5s: @3"], restart=["20s: @3"])
    last = {robot: value for robot, (_, _, value) in single(run, "broadcast_value").items()}
    assert last == dict.fromkeys(range(1, count + 1), "4.5")


def test_a_writer_that_has_restarted_is_heard():
    more = ["1s: broadcast_set(@1, speed, 3.5)", "2s: broadcast_set(@1, speed, 4.5)"]
    run = run_of("broadcast", 4, 0.2, insert=more, kill=["5s: @1"], restart=["9s: @1"])
    values = {value for _, _, value in single(run, "broadcast_value").values()}
    assert values == {"2.5"}, "its initial fact is the last value that it has set"


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize(("first", "second"), [("1.0", "2.0"), ("2.0", "1.0")])
def test_values_of_two_lives_that_have_one_number_do_not_stay_beside_each_other(loss, first, second):
    """The writer sets the first value of each life before it hears of the other one; its neighbour restarts, too."""
    insert = [f"1s: broadcast_set(@1, speed, {first})", f"8s: broadcast_set(@1, speed, {second})"]
    down = {"kill": ["5s: @1", "5s: @2"], "restart": ["8s: @1", "8s: @2"]}
    run = evaluate(
        'include "std/broadcast.rmr".', robots=4, topology="line", loss=loss, insert=insert, until=60, **down
    )
    assert run.quiescent
    assert {robot: facts[2] for robot, facts in single(run, "broadcast_value").items()} == dict.fromkeys(
        range(1, 5), second
    )


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("count", SIZES)
def test_the_live_robot_with_the_largest_number_leads_all(count, loss):
    run = run_of("leader", count, loss, kill=[f"10s: @{count}"])
    assert {leader for [leader] in single(run, "leader_is").values()} == {f"@{count - 1}"}
    run = run_of("leader", count, loss, kill=[f"10s: @{count}"], restart=[f"40s: @{count}"])
    assert {leader for [leader] in single(run, "leader_is").values()} == {f"@{count}"}


def test_robots_that_are_cut_off_have_a_leader_of_their_own():
    run = run_of("leader", 5, 0.2, topology="line", kill=["10s: @3"])
    assert {robot: leader for robot, [leader] in single(run, "leader_is").items()} == {
        1: "@2",
        2: "@2",
        4: "@5",
        5: "@5",
    }


@pytest.mark.parametrize(
    ("count", "loss"), [(4, 0.0), (4, 0.2), (20, 0.0), pytest.param(100, 0.0, marks=pytest.mark.slow)]
)
def test_nobody_passes_a_barrier_before_all_live_robots_are_there(count, loss):
    program = PROGRAMS["barrier"].replace("barrier_wait(R, 1).", "type go(robot).\ngo(R) -o barrier_wait(R, 1).")
    options = {"robots": count, "loss": loss, "until": 600}
    but_one = [f"1s: go(@{each})" for each in range(2, count + 1)]
    run = evaluate(program, **options, insert=but_one)
    assert not any(held(run, "barrier_passed").values())
    assert {at for [at] in single(run, "barrier_at").values()} == {"0", "1"}
    run = evaluate(program, **options, insert=[*but_one, "30s: go(@1)"])
    assert {at for [at] in single(run, "barrier_at").values()} == {"3"}
    assert set(map(len, held(run, "barrier_passed").values())) == {1}
    assert run.report["time_s"] > 30
    run = evaluate(program, **options, insert=but_one, kill=["5s: @1"])
    assert {at for [at] in single(run, "barrier_at").values()} == {"3"}
    assert run.report["time_s"] > 20, "15 seconds after the death"


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("count", [4, 20, 100])
def test_the_task_of_a_dead_robot_is_done_by_another_one(count, loss):
    options = {"robots": count, "loss": loss, "action_times": {"work": 20.0}, "until": 200}
    run = evaluate(PROGRAMS["handover"], **options)
    assert held(run, "handover_done")[1] == [["7"], ["8"]]
    first = {robot for robot, each in run.report["robots"].items() if each["actions"]}
    assert len(first) == 2, "each task is done once while nobody dies"
    dies = min(first)
    run = evaluate(PROGRAMS["handover"], **options, kill=[f"5s: @{dies}"])
    assert held(run, "handover_done")[1] == [["7"], ["8"]]
    started = [time for robot, each in run.report["robots"].items() for time, _ in each["actions"] if time > 5]
    assert len(started) == 1
    assert 13.5 < started[0] < 20, "12 seconds after the last lease"


@pytest.mark.parametrize("name", ["handover", "auction"])
@pytest.mark.parametrize("seed", range(6))
def test_two_robots_never_hold_a_task_at_one_instant(seed, name):
    options = {"robots": 4, "loss": 0.8, "seed": seed, "action_times": {"work": 1000.0}, "until": 300}
    run = evaluate(PROGRAMS[name], **options)
    spans = []
    for robot, each in run.report["robots"].items():
        for task in ("7", "8"):
            told = [(time, text.split("(")[0]) for time, text in each["actions"] if text.endswith(f"@1, {task})")]
            assert [what for _, what in told] == [("work", "drop")[index % 2] for index in range(len(told))]
            times = [time for time, _ in told] + [float("inf")] * (len(told) % 2)
            spans += [(task, *times[index : index + 2], robot) for index in range(0, len(times), 2)]
    spans.sort()
    assert len({robot for _, _, _, robot in spans}) > 1
    assert len(spans) > 2, "some lease ran out"
    for one, other in pairwise(spans):
        assert one[0] != other[0] or one[2] <= other[1], (one, other)


def lines_of(name, counted):
    """Lines with more than a comment or an include of a file of the library, and of those that it includes."""
    counted.add(name)
    text = (LIBRARY / f"{name}.rmr").read_text("utf-8")
    code = [each for each in text.splitlines() if each.partition("//")[0].strip()]
    included = [match[1] for each in code if (match := re.fullmatch(r'include "std/(\w+)\.rmr"\.', each))]
    more = [lines_of(each, counted) for each in included if each not in counted]
    return len(code) - len(included) + sum(more)


def test_the_page_has_the_lines_of_the_files_beside_other_languages():
    table = PAGE.read_text("utf-8").partition("<!-- lines: begin -->")[2].partition("<!-- lines: end -->")[0]
    rows = re.findall(r"^\| [a-z ]+ \| (\d+) \(`(\w+)`\) \|", table, re.MULTILINE)
    assert [name for _, name in rows] == ["distance", "channel", "leader", "collect"]
    assert [(int(lines), name) for lines, name in rows] == [(lines_of(name, set()), name) for _, name in rows]


def test_the_page_has_a_section_for_each_file_and_what_it_costs():
    page = PAGE.read_text("utf-8")
    assert [f"std/{each}.rmr" for each in re.findall(r"^## (\w+)\n", page, re.MULTILINE)] == [
        f"std/{each}.rmr" for each in PROGRAMS
    ]
    assert {f"std/{each}.rmr" for each in PROGRAMS} == set(library_files())
    begin, end = "<!-- cost: begin -->\n", "<!-- cost: end -->"
    head, _, rest = page.partition(begin)
    table, _, tail = rest.partition(end)
    rows = ["| file | loss 0: seconds | frames | loss 0.2: seconds | frames |", "| --- | --- | --- | --- | --- |"]
    for name, program in PROGRAMS.items():
        cells = [name]
        for loss in LOSSES:
            near = name in ("barrier", "handover", "ordered", "auction")
            where = {"robots": 4, "topology": "complete"} if near else {"robots": 20, "topology": "grid"}
            report = evaluate(program, **where, loss=loss, until=600).report
            cells += [f"{report['time_s']:.2f}", str(report["messages"]["sent"])]
        rows.append(f"| {' | '.join(cells)} |")
    measured = "\n".join(rows) + "\n"
    if os.environ.get("RMR_REWRITE") == "1":
        PAGE.write_text(head + begin + measured + end + tail, "utf-8")
    else:
        assert table == measured
