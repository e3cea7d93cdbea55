"""The body of one robot in the world: its state, and its motion in a tick without contact.

`physics` decides each tick whether a body may touch anything. If it may, the contact engine moves it, else `roll` does,
bitwise as the engine would.
"""

import math
from typing import Final

from rmr.base.geometry import STILL, Pose, Twist
from rmr.base.streams import Normals, stream
from rmr.base.time import NS_PER_MS, TICK_S, Instant
from rmr_world.sensors import Sensors

SUBSTEPS: Final = 2
"""Sub-steps per tick. At 0.2 m/s a robot moves 1.7 mm in one, far less than its radius."""
COMMAND_AGE_MAX: Final = 100 * NS_PER_MS
"""Age at which a command is dropped: it was decided in another situation."""
WATCHDOG: Final = 100 * NS_PER_MS
"""Time from the decision of the last command, however late it arrived, until the wheels brake. A robot whose process
dies or stalls at full speed drives another 2 cm until then, and 2.5 cm while it brakes. A shorter gap between commands
has no effect, a slightly longer one costs a little speed."""
STEP_S: Final = TICK_S / SUBSTEPS
"""Length of a sub-step, seconds."""


class RobotBody:
    """One robot's body and its last command."""

    __slots__ = (
        "active", "contacts", "cos", "decided", "distance_m", "free_until_m", "goes_vx", "goes_vy", "goes_w", "id",
        "near", "rolled", "sensors", "sin", "slip", "stamp", "steered", "target", "theta", "v", "view", "vx", "vy", "w",
        "x", "y",
    )  # fmt: skip

    def __init__(self, robot: int, pose: Pose, seed: int, sensors: Sensors) -> None:
        self.id = robot
        self.slip = Normals(stream(f"{seed}/robot{robot}/wheels"))
        self.view = Normals(stream(f"{seed}/robot{robot}/view"))
        self.sensors = sensors
        self.x, self.y, self.theta = pose
        self.cos = math.cos(pose.theta)
        self.sin = math.sin(pose.theta)
        self.vx = self.vy = self.v = self.w = 0.0
        self.goes_vx = self.goes_vy = self.goes_w = 0.0
        """Velocity that the wheels give the body in this tick: m/s in world axes, and rad/s."""
        self.steered = False
        """Whether the wheels drive the body in this tick."""
        self.rolled = False
        """Whether the body has been integrated here since the engine last ran, so that the engine's copy is stale."""
        self.target: Twist = STILL
        self.stamp: Instant = -COMMAND_AGE_MAX
        self.decided: Instant = -WATCHDOG
        """When the last command was decided; for a stamp in the future, when it arrived."""
        self.contacts = 0
        self.active = False
        """Whether the body may move in this tick."""
        self.distance_m = 0.0
        self.free_until_m = 0.0
        """Value of `distance_m` up to which the body cannot have come near a wall or an obstacle."""
        self.near: list[RobotBody] = []

    def put(self, x: float, y: float, theta: float, distance_m: float) -> None:
        """Let the body stand at a pose, after a path of `distance_m` metres."""
        self.x = x
        self.y = y
        self.theta = theta
        self.cos = math.cos(theta)
        self.sin = math.sin(theta)
        self.distance_m = self.free_until_m = distance_m

    @property
    def motion(self) -> tuple[Pose, Twist, float, float]:
        """Its true pose, what its wheels do, and their ways by the encoders, left and right."""
        pose = Pose(self.x, self.y, math.remainder(self.theta, math.tau))
        return pose, Twist(self.v, self.w), self.sensors.left_m, self.sensors.right_m


def roll(robot: RobotBody) -> None:
    """Integrate a body that can touch nothing for one tick, in the engine's order of additions: bitwise the same."""
    x = robot.x
    y = robot.y
    theta = robot.theta
    dx = robot.goes_vx * STEP_S
    dy = robot.goes_vy * STEP_S
    turn = robot.goes_w * STEP_S
    for _ in range(SUBSTEPS):
        x = x + dx
        y = y + dy
        theta = theta + turn
    robot.rolled = True
    moved(robot, x, y, theta)


def moved(robot: RobotBody, x: float, y: float, theta: float) -> None:
    """Set the pose of a body after a tick; its velocity and its encoders follow from the displacement."""
    dx = x - robot.x
    dy = y - robot.y
    turned = theta - robot.theta
    if dx == 0.0 == dy and turned == 0.0:
        robot.vx = robot.vy = robot.v = robot.w = 0.0
        return
    # Odometry measures the displacement along the mean heading; a sideways push turns no wheel.
    middle = robot.theta + 0.5 * turned
    way = dx * math.cos(middle) + dy * math.sin(middle)
    robot.sensors.moved(way, turned)
    robot.distance_m += math.sqrt(dx * dx + dy * dy)
    robot.x = x
    robot.y = y
    robot.theta = theta
    robot.vx = dx / TICK_S
    robot.vy = dy / TICK_S
    robot.cos = math.cos(theta)
    robot.sin = math.sin(theta)
    robot.v = way / TICK_S
    robot.w = turned / TICK_S
