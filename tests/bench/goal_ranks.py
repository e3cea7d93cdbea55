"""Re-ranking for a changed door, beside a shortest-path search of networkx over the whole map.

    python tests/bench/goal_ranks.py [--rooms 100] [--doors 400] [--changes 2000]

A map of rooms and one-way doors, a robot with one goal. A door shuts, ranks are brought up to date, it opens, ranks are
brought up to date: the CPU time of both, for each change. networkx computes all distances to the goal, as a robot would
have to that keeps none; without networkx that column is missing.
"""

import argparse
from random import Random
from statistics import mean, median
from time import process_time_ns

from rmr.base.streams import Choices
from rmr.base.values import Symbol
from rmr.lang.compiler import compile_source
from rmr.vm.engines import Engine, new_machine

PROGRAM = """
type at(robot, area).
type sensor door(robot, area, area).
at(R, r0).
?at(R, goal).
at(R, A), door(R, A, B) -o at(R, B).
"""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rooms", type=int, default=100)
    parser.add_argument("--doors", type=int, default=400)
    parser.add_argument("--changes", type=int, default=2000)
    options = parser.parse_args()
    rng = Random(1)
    rooms = [Symbol("goal"), *[Symbol(f"r{number}") for number in range(options.rooms - 1)]]
    pairs = [(one, other) for one in rooms for other in rooms if one != other]
    doors = rng.sample(pairs, options.doors)
    program = compile_source(PROGRAM).program
    assert program is not None
    machine = new_machine(program, 1, Choices("bench"), engine=Engine.GENERATED, firing_budget=0)
    door = program.index("door")
    assert door is not None
    for pair in doors:
        machine.insert(0, door, pair)
    machine.start(0)
    goals = machine._goals
    goals.begin(0)
    first = process_time_ns()
    goals.settle()
    first = process_time_ns() - first
    times = []
    for change in range(options.changes):
        pair = rng.choice(doors)
        for act in (machine.withdraw, machine.insert):
            act(change, door, pair)
            goals.begin(0)
            begun = process_time_ns()
            goals.settle()
            times.append((process_time_ns() - begun) / 1000)
    times.sort()
    print(f"{options.rooms} rooms, {options.doors} doors: first ranking {first / 1000:.0f} us")
    print(
        f"a changed door: mean {mean(times):.1f} us, median {median(times):.1f} us, "
        f"99 % {times[len(times) * 99 // 100]:.1f} us, worst {times[-1]:.1f} us (target: at most 50 us)"
    )
    _networkx(rooms, doors, rng)


def _networkx(rooms: list[Symbol], doors: list[tuple[Symbol, Symbol]], rng: Random) -> None:
    try:
        import networkx
    except ImportError:
        print("networkx is not installed: no comparison")
        return
    graph = networkx.DiGraph()
    graph.add_nodes_from(rooms)
    graph.add_edges_from((other, one) for one, other in doors)
    times = []
    for _ in range(300):
        one, other = rng.choice(doors)
        graph.remove_edge(other, one)
        begun = process_time_ns()
        networkx.single_source_shortest_path_length(graph, rooms[0])
        times.append((process_time_ns() - begun) / 1000)
        graph.add_edge(other, one)
    print(f"networkx, all distances anew: mean {mean(times):.1f} us, median {median(times):.1f} us")


if __name__ == "__main__":
    main()
