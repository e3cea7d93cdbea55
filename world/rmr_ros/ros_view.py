"""The view: simulated robots and the floor of a lab, shown as ROS 2 has robots and maps.

    /clock                lab time
    /map, /scene          the floor as a map server has it, and with its areas as markers; kept for who comes later
    /tf                   map -> robot_N/odom -> robot_N/base_link, where tf2_msgs is installed
    /robot_N/odom         by the wheels, with their errors, from where the robot stood at first
    /robot_N/pose         where it truly is
    /robot_N/scan         a lidar in its centre, without noise: walls, obstacles, hulls
    /robot_N/cmd_vel      drives a robot that has no mind; the newest one holds for 0.5 s, as in controllers

Stamps are lab time. The world's loop publishes; rclpy's thread only notes the velocities that have come.
"""

import base64
import logging
import math
import time
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from geometry_msgs.msg import Point, PoseStamped, TransformStamped, TwistStamped, Vector3
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import Twist as TwistMessage
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from rmr.base.arena import Arena, Disc
from rmr.base.geometry import Pose, Twist, wrap
from rmr.base.time import NS_PER_S, Instant, milliseconds
from rmr.node.motion.ekf import TRACK_M
from rmr.record.foxglove_messages import MAP, grid, scene
from rmr_ros.ros_body import onward

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # it has no wheel
    TFMessage = None

RAYS: Final = 180
"""Of a scan, all around."""
RANGE_M: Final = 3.5
"""How far the lidar sees: that of a TurtleBot3."""
Motion = tuple[Pose, Twist, float, float]
"""Of one body: true pose, what its wheels do, and the ways of the left and the right wheel, metres."""

log = logging.getLogger("rmr")


class Lidar:
    """What rays meet on a floor: its walls and obstacles, and hulls."""

    def __init__(self, arena: Arena) -> None:
        outlines: list[tuple[tuple[float, float], ...]] = [
            ((0.0, 0.0), (arena.width, 0.0), (arena.width, arena.height), (0.0, arena.height))
        ]
        outlines += [tuple(each.corners) for each in arena.obstacles if not isinstance(each, Disc)]
        begins = np.array([corner for outline in outlines for corner in outline])
        ends = np.array([corner for outline in outlines for corner in (*outline[1:], outline[0])])
        self._begins = begins
        self._edges = ends - begins
        self._least = np.minimum(begins, ends) - RANGE_M
        self._most = np.maximum(begins, ends) + RANGE_M
        self._discs = [(*each.centre, each.radius) for each in arena.obstacles if isinstance(each, Disc)]

    def ranges(self, pose: Pose, hulls: Iterable[tuple[float, float, float]]) -> Any:
        """Return the ways of `RAYS` rays, the first one backwards and the others to its left; inf: they meet nothing.

        `hulls`: x, y and radius of other robots.
        """
        at = np.array([pose.x, pose.y])
        angles = pose.theta - math.pi + math.tau / RAYS * np.arange(RAYS)
        ways = np.column_stack((np.cos(angles), np.sin(angles)))
        near = np.all((self._least <= at) & (at <= self._most), axis=1)
        begins = self._begins[near] - at
        edges = self._edges[near]
        # A ray w * t meets an edge b + e * s where t = (b x e) / (w x e) and s = (b x w) / (w x e), within 0 and 1.
        with np.errstate(divide="ignore", invalid="ignore"):
            across = np.outer(ways[:, 0], edges[:, 1]) - np.outer(ways[:, 1], edges[:, 0])
            t = (begins[:, 0] * edges[:, 1] - begins[:, 1] * edges[:, 0]) / across
            s = (np.outer(ways[:, 1], begins[:, 0]) - np.outer(ways[:, 0], begins[:, 1])) / across
            found = np.where((t >= 0.0) & (s >= 0.0) & (s <= 1.0), t, np.inf).min(axis=1, initial=np.inf)
            for x, y, radius in (*self._discs, *hulls):
                middle = np.array([x, y]) - at
                along = ways @ middle
                t = along - np.sqrt(radius * radius - (middle @ middle - along * along))  # NaN: it passes by
                found = np.minimum(found, np.where(t >= 0.0, t, np.inf))
        return np.where(found <= RANGE_M, found, np.inf)


class _Shown:
    """The topics of one robot."""

    def __init__(self, node: Node, robot: int, first: Instant) -> None:
        self.name = f"robot_{robot}"
        """Its namespace, and what its frames begin with."""
        self.odom = node.create_publisher(Odometry, f"/{self.name}/odom", 10)
        self.pose = node.create_publisher(PoseStamped, f"/{self.name}/pose", 10)
        self.scan = node.create_publisher(LaserScan, f"/{self.name}/scan", 5)
        self.place = Pose(0.0, 0.0, 0.0)
        """By its wheels, from where it was at first."""
        self.ways: tuple[float, float] | None = None
        self.odom_due: Instant = 0
        self.scan_due = first
        self.subscription: Any = None
        self.commanded: tuple[Twist, int] | None = None
        """The newest velocity, and when it came."""
        self.refused = False

    def take(self, message: Any) -> None:
        """Take in a velocity."""
        twist = message.twist if isinstance(message, TwistStamped) else message
        self.commanded = Twist(twist.linear.x, twist.angular.z), time.monotonic_ns()

    def roll(self, left_m: float, right_m: float) -> None:
        """Bring its odometry up to the ways of its wheels."""
        left, right = self.ways or (left_m, right_m)
        self.ways = left_m, right_m
        way = 0.5 * (left_m - left + right_m - right)
        turned = (right_m - right - left_m + left) / TRACK_M
        x, y, theta = self.place
        middle = theta + 0.5 * turned
        self.place = Pose(x + way * math.cos(middle), y + way * math.sin(middle), wrap(theta + turned))


class RosView:
    """Shows a lab on the topics of a node."""

    def __init__(self, node: Node, arena: Arena, robots: Sequence[int]) -> None:
        """`robots`: those that are shown."""
        self._node = node
        self._radius = arena.shape.radius
        self._lidar = Lidar(arena)
        kept = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._map = node.create_publisher(OccupancyGrid, "/map", kept)
        self._scene = node.create_publisher(MarkerArray, "/scene", kept)
        self._clock = node.create_publisher(Clock, "/clock", 1)
        self._tf = None if TFMessage is None else node.create_publisher(TFMessage, "/tf", 100)
        # Scans one after the other, so that no tick of the world has the rays of all robots to cast.
        apart = NS_PER_S // 10 // max(1, len(robots))
        self._shown = {robot: _Shown(node, robot, k * apart) for k, robot in enumerate(robots)}
        self._listen()
        node.create_timer(0.5, self._listen)
        self._map.publish(_map_message(arena))
        self._scene.publish(MarkerArray(markers=list(_markers(scene(arena, ())["entities"]))))
        if self._tf is None:
            log.info("ROS 2 sees no /tf, as tf2_msgs is not installed here: poses are on /robot_N/pose")

    # -- in -----------------------------------------------------------------------------------------------------

    def _listen(self) -> None:
        """Subscribe to velocities, of the type that their publishers have; in rclpy's thread, again and again."""
        for shown in self._shown.values():
            topic = f"/{shown.name}/cmd_vel"
            kinds = {each.topic_type for each in self._node.get_publishers_info_by_topic(topic)}
            kind = TwistStamped if kinds == {"geometry_msgs/msg/TwistStamped"} else TwistMessage
            if shown.subscription is not None and (not kinds or shown.subscription.msg_type is kind):
                continue
            if shown.subscription is not None:
                self._node.destroy_subscription(shown.subscription)
            quality = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
            shown.subscription = self._node.create_subscription(kind, topic, shown.take, quality)

    def commanded(self, minds: Iterable[int]) -> Iterator[tuple[int, Twist]]:
        """Yield what ROS 2 wants of robots; those with `minds` are theirs to drive."""
        clock = time.monotonic_ns()
        for robot, shown in self._shown.items():
            if shown.commanded is None:
                continue
            twist, came = shown.commanded
            if robot in minds:
                shown.commanded = None
                if not shown.refused:
                    log.warning("robot %d: /%s/cmd_vel is not taken, since its mind drives it", robot, shown.name)
                    shown.refused = True
            elif clock - came <= milliseconds(500):
                yield robot, twist
            else:
                shown.commanded = None

    # -- out ----------------------------------------------------------------------------------------------------

    def show(self, now: Instant, bodies: Mapping[int, Motion]) -> None:
        """Publish what is due at lab time `now`; `bodies` has all robots on the floor, shown or not."""
        clock = Clock()
        _set_stamp(clock.clock, now)
        self._clock.publish(clock)
        transforms = []
        for robot, shown in self._shown.items():
            pose, twist, left_m, right_m = bodies[robot]
            if now >= shown.odom_due or not now:  # at 0 time may stand, and others may come
                shown.odom_due = now + NS_PER_S // 30
                shown.roll(left_m, right_m)
                shown.odom.publish(_odometry(now, shown, twist))
                transforms += _transforms(now, shown, pose)
            if now >= shown.scan_due or not now:
                shown.scan_due = now + NS_PER_S // 10
                message = PoseStamped(pose=_pose_message(pose))
                _set_header(message.header, now, MAP)
                shown.pose.publish(message)
                hulls = [(at.x, at.y, self._radius) for other, (at, *_) in bodies.items() if other != robot]
                shown.scan.publish(self._scan(now, shown, self._lidar.ranges(pose, hulls)))
        if self._tf is not None and transforms:
            self._tf.publish(TFMessage(transforms=transforms))

    def _scan(self, now: Instant, shown: _Shown, ranges: Any) -> LaserScan:
        step = math.tau / RAYS
        message = LaserScan(angle_min=-math.pi, angle_max=math.pi - step, angle_increment=step, scan_time=0.1)
        _set_header(message.header, now, f"{shown.name}/base_link")
        message.range_min = self._radius
        message.range_max = RANGE_M
        message.ranges = array("f", ranges)
        return message


# -- messages: only numbers become fields here


def _set_stamp(stamp: Any, now: Instant) -> None:
    stamp.sec, stamp.nanosec = divmod(max(0, now), NS_PER_S)


def _set_header(header: Any, now: Instant, frame: str) -> None:
    _set_stamp(header.stamp, now)
    header.frame_id = frame


def _pose_message(pose: Pose) -> PoseMessage:
    message = PoseMessage()
    message.position.x = pose.x
    message.position.y = pose.y
    message.orientation.z = math.sin(0.5 * pose.theta)
    message.orientation.w = math.cos(0.5 * pose.theta)
    return message


def _odometry(now: Instant, shown: _Shown, twist: Twist) -> Odometry:
    message = Odometry(child_frame_id=f"{shown.name}/base_link")
    _set_header(message.header, now, f"{shown.name}/odom")
    message.pose.pose = _pose_message(shown.place)
    message.twist.twist.linear.x = twist.v
    message.twist.twist.angular.z = twist.w
    return message


def _transforms(now: Instant, shown: _Shown, pose: Pose) -> list[TransformStamped]:
    """Return where the origin of the odometry is in the map, and the robot in its odometry."""
    origin = onward(pose, shown.place, Pose(0.0, 0.0, 0.0))
    frames = ((MAP, f"{shown.name}/odom", origin), (f"{shown.name}/odom", f"{shown.name}/base_link", shown.place))
    found = []
    for parent, child, at in frames:
        message = TransformStamped(child_frame_id=child)
        _set_header(message.header, now, parent)
        message.transform.translation.x = at.x
        message.transform.translation.y = at.y
        message.transform.rotation = _pose_message(at).orientation
        found.append(message)
    return found


def _map_message(arena: Arena) -> OccupancyGrid:
    cells = grid(arena)
    message = OccupancyGrid()
    message.header.frame_id = MAP
    message.info.resolution = arena.cell
    message.info.width = columns = cells["column_count"]
    occupied = base64.b64decode(cells["data"])
    message.info.height = len(occupied) // columns
    message.info.origin.orientation.w = 1.0
    message.data = array("b", [100 * each for each in occupied])
    return message


def _markers(entities: Iterable[Mapping[str, Any]]) -> Iterator[Marker]:
    """Yield the primitives of a scene as the recordings have it."""
    for entity in entities:
        kinds = {
            "lines": Marker.LINE_STRIP,
            "triangles": Marker.TRIANGLE_LIST,
            "cylinders": Marker.CYLINDER,
            "spheres": Marker.SPHERE,
            "texts": Marker.TEXT_VIEW_FACING,
        }
        parts = [(kind, part) for key, kind in kinds.items() for part in entity[key]]
        for k, (kind, part) in enumerate(parts):
            marker = Marker(ns=entity["id"], id=k, type=kind, action=Marker.ADD)
            marker.header.frame_id = entity["frame_id"]
            marker.pose.position = Point(**{axis: float(value) for axis, value in part["pose"]["position"].items()})
            size = part.get("size", {"x": part.get("thickness", 1.0), "y": 1.0, "z": part.get("font_size", 1.0)})
            marker.scale = Vector3(**size)
            marker.color = ColorRGBA(**part["color"])
            points = part.get("points", [])
            closed = points[:1] if part.get("type") == 1 else []
            marker.points = [Point(**point) for point in (*points, *closed)]
            marker.text = part.get("text", "")
            yield marker
