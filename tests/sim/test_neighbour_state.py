"""Shared facts in the simulator: a gradient heals when a robot dies, moves or comes, at loss 0 and 0.2."""

from textwrap import dedent

import pytest
from lab_maker import small_lab

from rmr_sim.run_setup import prepare

GRADIENT = """
    type shared hops(robot, int).
    type !source(robot).
    const far = 12.
    source(@1).
    hops(R, far).

    source(R), hops(R, H), H > 0 -o hops(R, 0).
    hops(R, H), not source(R), N = min(X + 1, neighbor(R, B), hops(B, X)), H != min(N, far) -o hops(R, min(N, far)).
"""
RING = ((1, 2), (2, 3), (3, 4), (4, 5), (1, 5))


def ring(*more: str) -> str:
    """Return the faults that leave the links of a ring of five robots."""
    apart = [(a, b) for a in range(1, 6) for b in range(a + 1, 6) if (a, b) not in RING]
    cuts = [f"{{from: 0s, to: 100s, link: [{a}, {b}], cut: true}}" for a, b in apart]
    return f"[{', '.join([*cuts, *more])}]"


def hops(run) -> list[int]:
    found = []
    for each in run.robots:
        (fact,) = [fact for fact in each.node.machine.facts() if fact.startswith("hops")]
        found.append(int(fact.partition(", ")[2].rstrip(")")))
    return found


@pytest.mark.parametrize("loss", [0.0, 0.2])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_gradient_heals_within_four_seconds_when_a_robot_dies_and_is_back_when_it_lives(tmp_path, loss, seed):
    faults = ring("{at: 20s, kill: 2}", "{at: 40s, restart: 2}")
    ends = {"19s": [0, 1, 2, 2, 1], "24s": [0, 1, 3, 2, 1], "46s": [0, 1, 2, 2, 1]}
    for end, expected in ends.items():
        run = small_lab(tmp_path, GRADIENT, robots=5, faults=faults, loss=loss, seed=seed, duration=end)
        run.run()
        assert hops(run) == expected, end


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_gradient_follows_links_that_come_and_go(tmp_path, loss):
    """What a robot that moves out of range of one and into that of another changes."""
    faults = ring("{from: 15s, to: 30s, link: [1, 5], cut: true}")
    for end, expected in {"14s": [0, 1, 2, 2, 1], "26s": [0, 1, 2, 3, 4], "34s": [0, 1, 2, 2, 1]}.items():
        run = small_lab(tmp_path, GRADIENT, robots=5, faults=faults, loss=loss, duration=end)
        run.run()
        assert hops(run) == expected, end


@pytest.mark.parametrize("seed", range(1, 5))
def test_a_durable_robot_goes_on_and_is_heard_again(tmp_path, seed):
    faults = ring("{at: 12s, kill: 2}", "{at: 17s, restart: 2}", "{at: 21s, kill: 1}", "{at: 21.5s, restart: 1}")
    for end, expected in {"16.5s": [0, 1, 3, 2, 1], "30s": [0, 1, 2, 2, 1]}.items():
        run = small_lab(tmp_path, GRADIENT, robots=5, faults=faults, loss=0.2, seed=seed, duration=end, durable=True)
        run.run()
        assert hops(run) == expected, end


def test_when_the_source_dies_nobody_counts_beyond_the_bound(tmp_path):
    run = small_lab(tmp_path, GRADIENT, robots=5, faults=ring("{at: 10s, kill: 1}"), loss=0.2, duration="30s")
    run.run()
    assert hops(run)[1:] == [12, 12, 12, 12]


FLOOR = """
lab: moves
program: moves.rmr
seed: 1
duration: {duration}
arena: {{size: [7.0, 1.5], cell: 0.05}}
robots:
  - {{id: 1, pose: [0.5, 0.4, 0deg]}}
  - {{id: 2, pose: [2.0, 0.4, 0deg]}}
  - {{id: 3, pose: [3.5, 0.4, 0deg]}}
  - {{id: 4, pose: [5.0, 0.4, 0deg]}}
  - {{id: 5, pose: [0.5, 1.0, 0deg]}}
radio: {{loss: {loss}, tx_power_dbm: -30}}
localisation: {{beacons: [[0, 0], [7, 0], [0, 1.5], [7, 1.5]], rate: 10, sigma: 0.005}}
"""
"""Robots 1 to 4 hear those beside them: the radio reaches for 1.9 m. Robot 5 drives along them."""
DRIVES = """
    type action goto(robot, float, float).
    go(@5).
    go(R) -o goto(R, 6.2, 1.0).
"""


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_robot_that_drives_along_the_others_has_their_distances_one_after_the_other(tmp_path, loss):
    (tmp_path / "moves.rmr").write_text(dedent(GRADIENT + DRIVES))
    for duration, expected in {"3s": [0, 1, 2, 3, 1], "40s": [0, 1, 2, 3, 4]}.items():
        (tmp_path / "lab.yaml").write_text(FLOOR.format(duration=duration, loss=loss))
        run = prepare(tmp_path, seed=1)
        run.run()
        assert hops(run) == expected
