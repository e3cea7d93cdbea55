"""Durable robots with snapshots: what goes on from one is what executes the whole journal, killed at any instant."""

from pathlib import Path

import pytest
from durable_campaign import campaign
from lab_maker import small_lab
from test_sim_durable import RING, facts, with_kills
from test_sim_durable_actions import killed

from rmr.mind.journal import read_journal
from rmr.mind.mind_versions import is_compiled
from rmr.mind.segments import find_state
from rmr.mind.snapshot import shadow_of
from rmr_sim.disk import SNAPSHOT_KEY
from rmr_sim.run_setup import prepare
from rmr_sim.simulation import Simulation

pytestmark = [
    pytest.mark.medium,
    pytest.mark.skipif(is_compiled(), reason="where rmr is compiled there are no snapshots"),
]

LABS = Path(__file__).parents[2] / "deploy" / "labs"
SEGMENT_OCTETS = 1700
HANDLERS = """
from rmr import action

@action("tour", wheels=True)
async def tour(robot, n):
    robot.state["tours"] = robot.state.get("tours", 0) + 1
    await robot.goto(1.0, 0.5)
    await robot.until(lambda: robot.now() > 2.0)
    await robot.face(90)
    await robot.sleep(0.5)
    await robot.goto(0.3, 0.9)
"""


def with_snapshots(simulation: Simulation, octets: int = SEGMENT_OCTETS) -> dict[int, dict[int, bytes]]:
    """Let all robots close segments at `octets`; return the closed segments of each robot."""
    archives = {}
    for robot in simulation.robots:
        disk = robot._disk
        disk.segment_octets = robot.node._journal._segment_octets = octets
        archive = archives[robot.robot] = {}

        def begin(number, data, disk=disk, archive=archive, begun=disk.begin_segment):
            archive.update(disk.segments)
            begun(number, data)

        disk.begin_segment = begin
    return archives


def states(simulation, robot, archive):
    """Return the graph states of a robot at the end: behind its snapshot, and behind its whole journal."""
    disk = robot._disk
    found = find_state(disk.segments, disk.snapshots, SNAPSHOT_KEY)
    whole = find_state({**archive, **disk.segments}, {}, SNAPSHOT_KEY)
    assert whole.last == found.last
    program = robot.node.program
    both = []
    for each in (found, whole):
        state = None if each.snapshot is None else each.snapshot.state
        node, skeleton = shadow_of(program, each.header, each.records, state)
        node.settle()
        both.append(skeleton.state())
    return found, both


@pytest.mark.parametrize("seed", range(1, 4))
def test_snapshot_and_the_journal_behind_it_are_the_whole_journal(tmp_path, seed):
    simulation = small_lab(
        tmp_path, RING, robots=3, facts='["token(@1, 0)"]', loss=0.2, seed=seed, duration="20s", durable=True
    )
    archives = with_snapshots(simulation)
    with_kills(simulation, seed, [1, 2, 3], 8)
    simulation.run()
    assert simulation.violations == []
    assert sorted(int(number) for _, number in facts(simulation, "passed")) == list(range(30))
    used = 0
    for robot in simulation.robots:
        found, (behind, whole) = states(simulation, robot, archives[robot.robot])
        assert behind == whole
        used += found.snapshot is not None
        assert len(robot._disk.snapshots) <= 3
    assert used


def test_a_lab_of_driving_robots_goes_on_from_snapshots(tmp_path):
    simulation = prepare(LABS / "corridor", robots=3, seed=4, durable=True)
    archives = with_snapshots(simulation, 30_000)
    with_kills(simulation, 4, [1, 2, 3], 12, kills=4)
    assert simulation.run()
    assert simulation.violations == []
    for robot in simulation.robots:
        assert robot._disk.number > 1
        found, (behind, whole) = states(simulation, robot, archives[robot.robot])
        assert behind == whole
        assert len(found.records) < sum(len(read_journal(data).records) for data in archives[robot.robot].values())


def test_handlers_and_what_they_remember_go_on_from_snapshots(tmp_path):
    program = "type action tour(R: robot, N: int) -o toured(R, N).\ngo(R).\ngo(R) -o tour(R, 7).\n"
    simulation = small_lab(tmp_path, program, actions=HANDLERS, duration="30s", finish="toured(R, 7)", durable=True)
    archives = with_snapshots(simulation, 6000)
    for at_s in (1.5, 4.1, 6.7):
        killed(simulation, at_s, at_s + 0.3)
    assert simulation.run()
    [robot] = simulation.robots
    assert robot.node.resumed == 3
    assert robot.node.services.state == {"tours": 4}
    found, (behind, whole) = states(simulation, robot, archives[1])
    assert found.snapshot is not None
    assert behind == whole


def test_a_campaign_of_kills_and_torn_snapshots_counts_nothing_wrong():
    counts = campaign(range(1, 4))
    assert [counts[f"{case}: right"] for case in ("ring", "coins", "bank")] == [3, 3, 3]
    assert counts["restarts from a snapshot"] > 10
    assert counts["snapshots passed over"] > 0
