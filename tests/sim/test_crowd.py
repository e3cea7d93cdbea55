"""A crowd at a door where a fifth of all frames is lost, as it is in real processes whose frames collide."""

from pathlib import Path

import pytest

from rmr.base.geometry import Pose, distance
from rmr.base.motion_scale import scale_of
from rmr.base.time import in_seconds, milliseconds, seconds
from rmr.node.crossing.approach import Approach
from rmr.node.motion.navigator import Navigator
from rmr.node.profile import CROWD_FROM
from rmr_sim.run_setup import prepare
from rmr_sim.simulation import Simulation
from rmr_world.lab_file import load_lab

pytestmark = pytest.mark.medium

HALL = Path(__file__).parents[2] / "deploy" / "labs" / "hall"
UNTIL = seconds(16)
ROBOTS = CROWD_FROM + 3


class Watched:
    """The first seconds of a hall, and what was promised in them."""

    def __init__(self) -> None:
        self.simulation: Simulation = prepare(HALL, robots=ROBOTS, loss=0.2)
        self.promised: dict[int, Pose] = {}
        """Where each of those stood that say that they stay."""
        self.promises = 0
        self.moved: list[tuple[float, int]] = []
        self.simulation.observers.append(self._look)
        self.simulation.run()
        self.entries = [event["t"] for event in self.simulation.trace() if event["what"] == "entered"]

    def _look(self, now: int) -> None:
        for robot in self.simulation.robots:
            assert robot.node.driver is not None
            at = self.simulation.world.pose(robot.robot)
            if now >= robot.node.driver.stays_until:
                self.promised.pop(robot.robot, None)
            elif robot.robot not in self.promised:
                self.promised[robot.robot], self.promises = at, self.promises + 1
            elif distance(at.x, at.y, *self.promised[robot.robot][:2]) > 0.001:
                self.moved.append((in_seconds(now), robot.robot))
        if now >= UNTIL:
            self.simulation.stop()


@pytest.fixture(scope="module")
def hall() -> Watched:
    return Watched()


def test_robot_that_announces_it_stays_does_not_move(hall: Watched) -> None:
    assert hall.promises > ROBOTS // 2
    assert hall.moved == []


def test_one_after_the_other_enters_a_headway_apart(hall: Watched) -> None:
    assert hall.simulation.world.collisions == 0
    first, last = hall.entries[0], hall.entries[-1]
    assert first < 8.0
    assert len(hall.entries) > 0.7 * (last - first) / in_seconds(milliseconds(1050))
    assert last > in_seconds(UNTIL) - 2.5


def test_a_crowd_follows_as_closely_as_hulls_may_and_others_finish_in_the_order_in_which_they_enter() -> None:
    arena = load_lab(HALL).arena
    area = arena.area("exit")
    assert area is not None
    few, many = (
        Approach(Navigator(arena, 1), in_order).headway(area, arena.passages[0], 0) for in_order in (True, False)
    )
    assert many == seconds((2 * arena.shape.radius + scale_of(arena.shape).headway_m) / arena.shape.speed)
    assert few > 1.4 * many
