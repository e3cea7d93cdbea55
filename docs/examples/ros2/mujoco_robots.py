"""Robots of ROS 2 whose bodies MuJoCo computes: differential drives on the floor of a lab, with contacts and friction.

    python docs/examples/ros2/mujoco_robots.py LAB.yaml [--robots 1-6] [--report FILE]

Nothing of RMR drives or senses here: the program reads the floor, the starts and the names of topics from the lab file,
and is otherwise a robot driver as others write them. For each robot of the lab with a body in ROS 2 it publishes its
odometry at 50 Hz, from the turns of its wheels, and its pose at 5 Hz, with noise, as a localisation would; and it
drives as the last velocity that it was sent says. Messages are late and get lost, in both directions.
"""

import argparse
import heapq
import json
import math
import random
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from geometry_msgs.msg import Twist as TwistMessage
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import LaserScan

from rmr.base.arena import Arena, Disc
from rmr.base.ids import listed
from rmr_world.lab import Lab, Ros2Body
from rmr_world.lab_file import load_lab

STEP_S = 0.005
ODOMETRY_S = 0.02
POSE_S = 0.2
SCAN_S = 0.1
RAYS = 180
RANGE_M = 3.5
WHEEL_M = 0.033
HEIGHT_M = 0.06
GRIP = 0.9
"""Coefficient of friction of the wheels: what they drive beyond it slips."""
PUSH = 2.5
"""Greatest acceleration of the drive, m/s^2."""


def model_of(
    arena: Arena, starts: dict[int, tuple[float, float, float]], strangers: list[tuple[float, ...]]
) -> mujoco.MjModel:
    """Return the floor, walls and obstacles, a differential drive at each start, and what no map shows."""
    track = 1.5 * arena.shape.radius
    width, height = arena.width, arena.height
    walls = [(width / 2, -0.05, width / 2 + 0.1, 0.05), (width / 2, height + 0.05, width / 2 + 0.1, 0.05)]
    walls += [(-0.05, height / 2, 0.05, height / 2), (width + 0.05, height / 2, 0.05, height / 2)]
    fixed = [
        f'<geom name="wall{k}" type="box" pos="{x} {y} 0.1" size="{a} {b} 0.1"/>'
        for k, (x, y, a, b) in enumerate(walls)
    ]
    for k, each in enumerate(arena.obstacles):
        if isinstance(each, Disc):
            x, y = each.centre
            fixed.append(f'<geom name="wall{k + 4}" type="cylinder" pos="{x} {y} 0.1" size="{each.radius} 0.1"/>')
        else:  # a convex polygon is the hull of its corners below and above
            fixed.append(f'<geom name="wall{k + 4}" type="mesh" mesh="hull{k}"/>')
    fixed += [
        f'<geom name="stranger{k}" type="cylinder" pos="{x} {y} 0.1" size="{arena.shape.radius} 0.1"/>'
        for k, (x, y) in enumerate(strangers)
    ]
    meshes = [
        f'<mesh name="hull{k}" vertex="{" ".join(f"{x} {y} {z}" for z in (0.0, 0.2) for x, y in each.corners)}"/>'
        for k, each in enumerate(arena.obstacles)
        if not isinstance(each, Disc)
    ]
    robots, drives = [], []
    radius = arena.shape.radius
    for robot, (x, y, theta) in starts.items():
        wheels = "".join(
            f'<body pos="0 {side * track / 2} 0"><joint name="{name}{robot}" type="hinge" axis="0 1 0" damping="0.001" '
            f'armature="0.0005"/><geom type="ellipsoid" size="{WHEEL_M} 0.009 {WHEEL_M}" mass="0.05" '
            f'friction="{GRIP} 0.005 0.0001" condim="4" priority="1"/></body>'
            for name, side in (("left", 1), ("right", -1))
        )
        casters = "".join(
            f'<geom type="sphere" pos="{way * radius * 0.6} 0 -0.0225" size="0.01" mass="0.02" friction="0.01 0 0" '
            'condim="1" priority="2"/>'
            for way in (1, -1)
        )
        robots.append(
            f'<body name="robot{robot}" pos="{x} {y} {WHEEL_M + 0.0005}" euler="0 0 {math.degrees(theta)}"><freejoint '
            f'name="free{robot}"/><geom name="hull{robot}" type="cylinder" pos="0 0 {HEIGHT_M / 2}" size="{radius} '
            f'{HEIGHT_M / 2 - 0.005}" mass="1.0" friction="0.3 0.005 0.0001"/>{wheels}{casters}</body>'
        )
        drives += [f'<velocity joint="{name}{robot}" kv="0.2" forcerange="-0.6 0.6"/>' for name in ("left", "right")]
    newline = "\n"
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{STEP_S}" integrator="implicitfast" cone="elliptic"/>'
        f"<asset>{newline.join(meshes)}</asset><worldbody>"
        f'<geom name="floor" type="plane" size="20 20 0.1" friction="1 0.005 0.0001"/>{newline.join(fixed)}'
        f"{newline.join(robots)}</worldbody><actuator>{newline.join(drives)}</actuator></mujoco>"
    )


class Drive:
    """One robot: its topics, and its wheels in the model."""

    def __init__(self, fleet: "Fleet", body: Ros2Body, index: int) -> None:
        node, model = fleet.node, fleet.model
        self.body = body
        self.fleet = fleet
        self.wheels = [model.jnt_qposadr[model.joint(f"{name}{body.robot}").id] for name in ("left", "right")]
        self.at = model.jnt_qposadr[model.joint(f"free{body.robot}").id]
        self.actuators = [2 * index, 2 * index + 1]
        self.wanted = self.given = (0.0, 0.0)
        self.heard_at = -1.0
        self.turns = [0.0, 0.0]
        self.place = [0.0, 0.0, 0.0]
        """By odometry, which begins at its start."""
        self.set_out_at = math.inf
        """When it was first to move."""
        self.stopped: list[float] = []
        """When it was told to stop, or stopped by itself, each time."""
        self.odometry = node.create_publisher(Odometry, body.odom, qos_profile_sensor_data)
        self.poses = node.create_publisher(PoseWithCovarianceStamped, body.pose, 10)
        self.scans = node.create_publisher(LaserScan, body.scan, qos_profile_sensor_data) if body.scan else None
        self.own = model.body(f"robot{body.robot}").id
        kind = TwistStamped if fleet.options.stamped else TwistMessage
        node.create_subscription(
            kind, body.cmd_vel, lambda m: fleet.post(lambda: self.take(m)), qos_profile_sensor_data
        )

    def take(self, message: Any) -> None:
        """Take in a velocity."""
        twist = message.twist if isinstance(message, TwistStamped) else message
        self.wanted = (twist.linear.x, twist.angular.z)
        self.heard_at = self.fleet.now
        if self.wanted != (0.0, 0.0):
            self.set_out_at = min(self.set_out_at, self.fleet.now)

    @property
    def since(self) -> float:
        """Seconds since it was first to move; negative before."""
        return self.fleet.now - self.set_out_at

    def carry_off(self, x: float, y: float, theta: float) -> None:
        """Pick it up and put it down elsewhere."""
        height = self.fleet.data.qpos[self.at + 2]
        turned = [math.cos(theta / 2), 0.0, 0.0, math.sin(theta / 2)]
        self.fleet.data.qpos[self.at : self.at + 7] = [x, y, height, *turned]

    def drive(self, now: float) -> None:
        """Set the speeds of the wheels for the next step."""
        v, w = self.wanted if now - self.heard_at < self.fleet.options.silence else (0.0, 0.0)
        most = PUSH * STEP_S
        turn = 4.0 * most / self.fleet.arena.shape.radius
        v = max(self.given[0] - most, min(self.given[0] + most, v))
        w = max(self.given[1] - turn, min(self.given[1] + turn, w))
        if self.given != (0.0, 0.0) == (v, w):
            self.stopped.append(round(self.fleet.now, 3))
        self.given = (v, w)
        half = 0.5 * self.fleet.track * w
        slip = self.fleet.options.slip
        draw = self.fleet.chance.gauss
        for actuator, speed in zip(self.actuators, (v - half, v + half), strict=True):
            self.fleet.data.ctrl[actuator] = speed * (1.0 + slip * draw(0.0, 1.0)) / WHEEL_M

    @property
    def true(self) -> tuple[float, float, float]:
        """Where it is."""
        x, y, _, w, i, j, k = self.fleet.data.qpos[self.at : self.at + 7]
        return float(x), float(y), math.atan2(2 * (w * k + i * j), 1 - 2 * (j * j + k * k))

    def say_odometry(self) -> None:
        """Publish what the wheels have turned."""
        turned = [float(self.fleet.data.qpos[wheel]) for wheel in self.wheels]
        left, right = ((new - old) * WHEEL_M for new, old in zip(turned, self.turns, strict=True))
        self.turns = turned
        way, turn = (left + right) / 2, (right - left) / self.fleet.track
        middle = self.place[2] + turn / 2
        self.place[0] += way * math.cos(middle)
        self.place[1] += way * math.sin(middle)
        self.place[2] += turn
        message = Odometry()
        message.header.stamp = self.fleet.node.get_clock().now().to_msg()
        message.header.frame_id = "odom"
        set_pose(message.pose.pose, *self.place)
        message.twist.twist.linear.x = way / ODOMETRY_S
        message.twist.twist.angular.z = turn / ODOMETRY_S
        self.fleet.post(lambda: self.odometry.publish(message))

    def say_pose(self) -> None:
        """Publish where it is, as badly as a localisation knows."""
        options, draw = self.fleet.options, self.fleet.chance.gauss
        if any(robot == self.body.robot and begin <= self.since < end for robot, begin, end in options.lose):
            return
        x, y, theta = self.true
        message = PoseWithCovarianceStamped()
        message.header.stamp = self.fleet.node.get_clock().now().to_msg()
        message.header.frame_id = "map"
        noisy = (x + draw(0.0, options.noise), y + draw(0.0, options.noise), theta + draw(0.0, 0.03))
        set_pose(message.pose.pose, *noisy)
        covariance = np.zeros(36)
        covariance[[0, 7]] = options.noise**2
        covariance[35] = 0.03**2
        message.pose.covariance = covariance
        self.fleet.post(lambda: self.poses.publish(message))

    def say_scan(self) -> None:
        """Publish how far the rays of a lidar in its middle go, with 1 cm of noise."""
        scans = self.scans
        if scans is None:
            return
        x, y, theta = self.true
        step = math.tau / RAYS
        angles = theta - math.pi + step * np.arange(RAYS)
        ways = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(RAYS))).flatten()
        met = np.full(RAYS, -1, dtype=np.int32)
        far = np.zeros(RAYS)
        at = np.array([x, y, 0.075])  # above its wheels, which are bodies of their own, and below the rim of its hull
        model, data = self.fleet.model, self.fleet.data
        mujoco.mj_multiRay(model, data, at, ways, None, True, self.own, met, far, None, RAYS, RANGE_M)
        message = LaserScan(angle_min=-math.pi, angle_max=math.pi - step, angle_increment=step, scan_time=SCAN_S)
        message.header.stamp = self.fleet.node.get_clock().now().to_msg()
        message.header.frame_id = "base_scan"
        message.range_min = self.fleet.arena.shape.radius
        message.range_max = RANGE_M
        message.ranges = np.where(met < 0, math.inf, far + self.fleet.noise.normal(0.0, 0.01, RAYS)).tolist()
        self.fleet.post(lambda: scans.publish(message))


def set_pose(pose: Any, x: float, y: float, theta: float) -> None:
    """Write a pose on the floor into a message."""
    pose.position.x, pose.position.y = x, y
    pose.orientation.z, pose.orientation.w = math.sin(theta / 2), math.cos(theta / 2)


class Fleet:
    """All robots, on one floor and in one process."""

    def __init__(self, lab: Lab, bodies: list[Ros2Body], options: argparse.Namespace) -> None:
        self.options = options
        self.arena = lab.arena
        self.track = 1.5 * lab.arena.shape.radius
        self.chance = random.Random(options.seed)
        self.noise = np.random.default_rng(options.seed)
        self.now = 0.0
        self.late: list[tuple[float, int, Callable[[], None]]] = []
        self.posted = 0
        self.node = Node("mujoco_robots", start_parameter_services=False, enable_rosout=False)
        starts = {each.id: tuple(each.pose) for each in lab.robots}
        self.model = model_of(lab.arena, {body.robot: starts[body.robot] for body in bodies}, options.stranger)
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        self.hulls = {self.model.geom(f"hull{body.robot}").id: body.robot for body in bodies}
        self.drives = [Drive(self, body, index) for index, body in enumerate(bodies)]
        self.touching: set[tuple[str, str]] = set()
        self.contacts: list[tuple[float, str, str]] = []
        self.least_gap = math.inf

    def post(self, deliver: Callable[[], None]) -> None:
        """Let a message arrive later, or not at all."""
        self.posted += 1
        if self.chance.random() >= self.options.loss:
            heapq.heappush(self.late, (self.now + self.options.latency, self.posted, deliver))

    def step(self) -> None:
        """Advance by one step of the physics."""
        self.now += STEP_S
        while self.late and self.late[0][0] <= self.now:
            heapq.heappop(self.late)[2]()
        for drive in self.drives:
            drive.drive(self.now)
        mujoco.mj_step(self.model, self.data)
        touching = set(self.touches())
        self.contacts += [(round(self.now, 3), *pair) for pair in sorted(touching - self.touching)]
        self.touching = touching
        for carried in [each for each in self.options.kidnap if self.drive_of(each[0]).since >= each[1]]:
            self.options.kidnap.remove(carried)
            self.drive_of(carried[0]).carry_off(*carried[2:])
        ticks = round(self.now / STEP_S)
        for k, drive in enumerate(self.drives):
            if (ticks + k) % round(ODOMETRY_S / STEP_S) == 0:
                drive.say_odometry()
            if (ticks + 7 * k) % round(POSE_S / STEP_S) == 0:
                drive.say_pose()
            if (ticks + 3 * k) % round(SCAN_S / STEP_S) == 0:
                drive.say_scan()

    def drive_of(self, robot: float) -> Drive:
        """Return the drive of a robot."""
        return next(drive for drive in self.drives if drive.body.robot == robot)

    def touches(self) -> Iterator[tuple[str, str]]:
        """Yield the pairs of which one is the hull of a robot; a hull never touches the floor."""
        for contact in self.data.contact[: self.data.ncon]:
            pair = [int(contact.geom1), int(contact.geom2)]
            robots = [self.hulls.get(geom) for geom in pair]
            names = [
                f"robot {robot}" if robot is not None else self.model.geom(geom).name
                for robot, geom in zip(robots, pair, strict=True)
            ]
            if robots != [None, None] and "floor" not in names and "" not in names:
                yield names[0], names[1]

    def report(self) -> dict[str, Any]:
        """Return what has truly happened."""
        return {
            "seconds": round(self.now, 3),
            "contacts": self.contacts[:100],
            "poses": {drive.body.robot: [round(value, 4) for value in drive.true] for drive in self.drives},
            "speeds": {drive.body.robot: list(drive.given) for drive in self.drives},
            "stopped": {drive.body.robot: drive.stopped for drive in self.drives},
            "set_out": {drive.body.robot: drive.set_out_at for drive in self.drives if drive.since > 0.0},
        }


def numbers(count: int) -> Callable[[str], tuple[float, ...]]:
    """Return what reads so many numbers with colons between them."""

    def read(text: str) -> tuple[float, ...]:
        found = tuple(map(float, text.split(":")))
        if len(found) != count:
            raise ValueError
        return found

    return read


def main() -> None:
    """Run until SIGINT or SIGTERM."""
    parser = argparse.ArgumentParser(description="Robots of ROS 2 over MuJoCo, on the floor of a lab.")
    parser.add_argument("lab", type=Path)
    parser.add_argument("--robots", type=listed, help="these alone: 1-3; several processes may share a lab")
    parser.add_argument("--report", type=Path, help="write contacts and poses there, twice a second and at the end")
    parser.add_argument("--noise", type=float, default=0.02, help="of a pose, metres (0.02)")
    parser.add_argument("--latency", type=float, default=0.03, help="of each message, seconds (0.03)")
    parser.add_argument("--loss", type=float, default=0.02, help="share of messages lost (0.02)")
    parser.add_argument("--slip", type=float, default=0.02, help="noise of a wheel's speed, as a share of it (0.02)")
    parser.add_argument("--silence", type=float, default=0.2, help="it brakes when nothing comes for so long (0.2 s)")
    more = {"action": "append", "default": []}
    parser.add_argument("--lose", type=numbers(3), help="ROBOT:FROM:TO: no poses, in seconds since it set out", **more)
    parser.add_argument("--kidnap", type=numbers(5), help="ROBOT:AT:X:Y:THETA: put it there, likewise", **more)
    parser.add_argument("--stranger", type=numbers(2), help="X:Y: something as wide as a robot stands there", **more)
    parser.add_argument("--stamped", action="store_true", help="take TwistStamped in place of Twist")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    lab = load_lab(options.lab)
    bodies = [body for body in lab.bodies if not options.robots or body.robot in options.robots]
    if not bodies:
        parser.error(f"{options.lab} has no such robots with bodies in ROS 2")
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda got, _frame: ended.append(got))
    fleet = Fleet(lab, bodies, options)
    executor = SingleThreadedExecutor()
    executor.add_node(fleet.node)
    print(f"{len(bodies)} robots", flush=True)
    begun = time.monotonic()
    written = 0.0
    while not ended:
        behind = time.monotonic() - begun - fleet.now
        if behind > 0.2:  # a machine that was held up: the physics does not hurry after it
            begun += behind
        for _ in range(round(0.1 / STEP_S)):
            if time.monotonic() - begun > fleet.now:
                fleet.step()
        if options.report is not None and fleet.now >= written + 0.5:
            written = fleet.now
            write(options.report, fleet.report())
        executor.spin_once(timeout_sec=max(0.0, fleet.now - (time.monotonic() - begun)))
    if options.report is not None:
        write(options.report, fleet.report())
    fleet.node.destroy_node()
    rclpy.shutdown()


def write(path: Path, report: dict[str, Any]) -> None:
    """Replace the report."""
    new = path.with_suffix(".new")
    new.write_text(json.dumps(report))
    new.replace(path)


if __name__ == "__main__":
    sys.exit(main())
