"""The bridge: the node of ROS 2 in the world's process, for bodies in ROS 2 and for the view of the simulated ones.

rclpy calls back in a thread of its own, which only puts messages into the inbox of their robot; the world's loop takes
them out at each tick. The same thread holds the watchdog of the commands, so that a world that is stopped in its loop
leaves no robot driving: 0.1 s after the last command of its mind a robot is told zero, and at the end of the world.

Types and qualities of service are taken as the graph has them: a robot that wants stamped velocities gets these.
"""

import asyncio
import contextlib
import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

import rclpy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TwistStamped
from geometry_msgs.msg import Twist as TwistMessage
from nav_msgs.msg import Odometry
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import LaserScan

from rmr.base.arena import Arena
from rmr.base.geometry import STILL, Pose, Twist
from rmr.base.time import NS_PER_S, Instant
from rmr.base.values import Value
from rmr.node.ports import SeenBody, Sensed
from rmr_ros.ros_actions import ActionCall, Asked, Nav2Drives, RosActions
from rmr_ros.ros_body import COMMAND_AGE_MAX, BodyTopics, RosBody, deviations, heading
from rmr_ros.ros_facts import FactTopics, TopicFactError, TopicReading
from rmr_ros.ros_view import RosView

READY_S_MAX: Final = 20.0
"""How long robots may take to show their topics and to send odometry and a pose."""
LOOK_S: Final = 0.25
"""Period of looking at the graph until then."""
WATCH_S: Final = 0.02
"""Period of the watchdog."""
ZEROS: Final = 5
"""How often zero is said: messages get lost."""
INBOX_MAX: Final = 256
"""Messages that wait for the world's loop, of each robot; the oldest are dropped."""

POSES: Final[Mapping[str, Any]] = {
    "geometry_msgs/msg/PoseWithCovarianceStamped": PoseWithCovarianceStamped,
    "geometry_msgs/msg/PoseStamped": PoseStamped,
}
TWISTS: Final[Mapping[str, Any]] = {
    "geometry_msgs/msg/Twist": TwistMessage,
    "geometry_msgs/msg/TwistStamped": TwistStamped,
}

log = logging.getLogger("rmr")


class BridgeError(Exception):
    """The robots of ROS 2 cannot be used as the lab says; a line for each reason, with what to do."""


class _Link:
    """The topics of one robot."""

    def __init__(self, spec: BodyTopics, arena: Arena, start: Pose) -> None:
        self.spec = spec
        self.body = RosBody(spec, arena, start)
        self.inbox: deque[tuple[Instant, Any]] = deque(maxlen=INBOX_MAX)
        self.publisher: Any = None
        self.stamped = False
        self.subscribed: set[str] = set()
        self.commanded_at: Instant = 0
        """When the last command was decided, by the bridge's clock."""
        self.zeros = ZEROS
        """How often zero has been said since the robot was last to drive."""
        self.said = ""


class RosBridge:
    """A lab in ROS 2. Making it opens a node; `close` ends it. Raises BridgeError."""

    def __init__(
        self,
        lab: str,
        bodies: Sequence[BodyTopics],
        arena: Arena,
        starts: Mapping[int, Pose],
        readings: Sequence[TopicReading] = (),
        calls: Sequence[ActionCall] = (),
        *,
        shows: bool = False,
    ) -> None:
        """`starts` has all robots; those without a body of `bodies` are shown to ROS 2 if it `shows` them."""
        self._links = {spec.robot: _Link(spec, arena, starts[spec.robot]) for spec in bodies}
        self._context = Context()
        try:
            rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
            self._node = Node(
                f"rmr_world_{lab.replace('-', '_')}",
                context=self._context,
                start_parameter_services=False,
                enable_rosout=False,
            )
        except Exception as error:  # rclpy has a kind of its own for each; what they tell is the environment
            raise BridgeError(f"ROS 2 does not start here, look at its environment variables: {error}") from None
        try:
            self._facts = FactTopics(self._node, readings, _quality)
            self._actions = RosActions(self._node, calls, _quality)
            drives = {spec.robot: (spec.navigate, spec.origin) for spec in bodies if spec.navigate}
            self._nav2 = Nav2Drives(drives, lambda kind, name: ActionClient(self._node, kind, name))
        except TopicFactError as error:
            raise BridgeError(str(error)) from None
        if readings:
            self._node.create_timer(0.5, lambda: self._facts.look(time.monotonic_ns()))
        self.view = RosView(self._node, arena, sorted(starts.keys() - self._links.keys())) if shows else None
        """Of the other robots."""
        self._begun = False
        """Whether all robots have been there; before, what is missing is no news."""
        self._lock = threading.Lock()
        """Held for each command, so that a late zero does not follow a new command."""
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._node.create_timer(WATCH_S, self._watch)
        self._thread = threading.Thread(target=self._spin, name="rclpy", daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            self._executor.spin()

    @property
    def robots(self) -> tuple[int, ...]:
        """The robots whose bodies these are."""
        return tuple(sorted(self._links))

    # -- start --------------------------------------------------------------------------------------------------

    async def ready(self, wait_s: float = READY_S_MAX) -> None:
        """Return when all robots are there and have said where they are. Raises BridgeError after `wait_s`."""
        end = time.monotonic() + wait_s
        while True:
            self.step(0)
            missing = list(self._missing())
            if not missing:
                self._begun = True
                return
            if time.monotonic() > end:
                raise BridgeError("\n".join(missing))
            await asyncio.sleep(LOOK_S)

    def _missing(self) -> Iterator[str]:
        """Yield what is missing, a sentence for each; subscribe to what is there."""
        for robot, link in sorted(self._links.items()):
            found = [*self._look(link)]
            if not found and not link.body.counts["odometry"]:
                found = [f"nothing has come on {link.spec.odom} yet"]
            if not found and not link.body.located:
                found = [link.body.trouble or f"no pose has come on {link.spec.pose} that its odometry agrees with"]
            yield from (f"robot {robot}: {why}" for why in found)
        yield from self._actions.missing()
        yield from self._nav2.missing()

    def _look(self, link: _Link) -> Iterator[str]:
        """Subscribe to the topics of a robot, and find out what it is driven by; yield what is wrong with them."""
        node = self._node
        spec = link.spec
        for topic, known, take in (
            (spec.odom, {"nav_msgs/msg/Odometry": Odometry}, self._odometry),
            (spec.pose, POSES, self._pose),
            *([(spec.scan, {"sensor_msgs/msg/LaserScan": LaserScan}, self._scan)] if spec.scan else []),
        ):
            infos = node.get_publishers_info_by_topic(topic)
            wrong = _wrong(topic, infos, known, "publishes", self._alike(known))
            if wrong:
                yield wrong
            elif len(infos) > 1:
                nodes = sorted(f"{each.node_namespace.rstrip('/')}/{each.node_name}" for each in infos)
                yield f"{len(infos)} nodes publish {topic} ({' and '.join(nodes)}): one of them has to end"
            elif topic not in link.subscribed:
                link.subscribed.add(topic)
                kind = known[infos[0].topic_type]
                node.create_subscription(kind, topic, self._putter(link, take), _quality(infos))
        infos = node.get_subscriptions_info_by_topic(spec.cmd_vel)
        wrong = _wrong(spec.cmd_vel, infos, TWISTS, "subscribes to", "")
        if wrong:
            yield wrong
        elif link.publisher is None:
            kind = infos[0].topic_type
            link.stamped = kind.endswith("Stamped")
            link.publisher = node.create_publisher(TWISTS[kind], spec.cmd_vel, _quality(infos, out=True))

    def _alike(self, known: Iterable[str]) -> str:
        """Return the topics of such types that there are, in words."""
        found = [name for name, kinds in self._node.get_topic_names_and_types() if not set(known).isdisjoint(kinds)]
        return f"; of its type are {', '.join(sorted(found)[:8])}" if found else "; no topic here has its type"

    def _putter(self, link: _Link, take: Callable[[_Link, Instant, Any], None]) -> Callable[[Any], None]:
        def put(message: Any) -> None:
            arrived = time.monotonic_ns()
            link.inbox.append((arrived, lambda: take(link, arrived, message)))

        return put

    # -- in -----------------------------------------------------------------------------------------------------

    def _odometry(self, link: _Link, arrived: Instant, message: Any) -> None:
        pose = message.pose.pose
        theta = heading(pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w)
        at = Pose(pose.position.x, pose.position.y, float("nan") if theta is None else theta)
        twist = message.twist.twist
        link.body.odometry(arrived, _instant(message) or arrived, at, Twist(twist.linear.x, twist.angular.z))

    def _pose(self, link: _Link, _arrived: Instant, message: Any) -> None:
        spec = link.spec
        sigma_m = spec.sigma_m
        sigma_rad = spec.sigma_rad
        pose = message.pose
        if isinstance(message, PoseWithCovarianceStamped):
            sigma_m, sigma_rad = deviations(pose.covariance, sigma_m, sigma_rad)
            pose = pose.pose
        theta = heading(pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w)
        at = Pose(pose.position.x, pose.position.y, float("nan") if theta is None else theta)
        link.body.measured(_instant(message), at, sigma_m, sigma_rad)

    def _scan(self, link: _Link, arrived: Instant, message: Any) -> None:
        ranges = [one if message.range_min <= one <= message.range_max else math.inf for one in message.ranges]
        link.body.scan(arrived, _instant(message), message.angle_min, message.angle_increment, ranges)

    def step(self, now: Instant) -> None:
        """Take in what has arrived, and bring the estimates up to lab time `now`."""
        clock = time.monotonic_ns()
        for robot, link in self._links.items():
            while link.inbox:
                link.inbox.popleft()[1]()
            link.body.step(now, clock)
            self._say(robot, link, clock)
        self._facts.step(clock)
        self._actions.step(clock)
        self._nav2.step(clock)

    def _say(self, robot: int, link: _Link, clock: Instant) -> None:
        """Log what is wrong with a robot when that changes."""
        body = link.body
        why = "" if body.heard(clock) else f"nothing comes on {link.spec.odom}: it stands"
        why = why or ("" if body.located else body.trouble or f"no pose on {link.spec.pose} agrees: it stands")
        why = why or ("" if body.sees(clock) else f"nothing comes on {link.spec.scan}: it sees robots of the lab alone")
        if why == link.said or not self._begun:
            return
        link.said = why
        if why:
            log.warning("robot %d: %s", robot, why)
        else:
            log.info("robot %d: located at (%.2f, %.2f)", robot, body.pose.x, body.pose.y)

    def told(self, robot: int) -> tuple[tuple[str, tuple[Value, ...]], ...] | None:
        """Return all facts of `robot` that hold by its topics; None if it knows them."""
        clock = time.monotonic_ns()
        if self._nav2.is_news(robot):
            self._facts.touch(robot, clock)
        facts = self._facts.told(robot, clock)
        return None if facts is None else facts + self._nav2.told(robot)

    def body(self, robot: int) -> RosBody:
        """Return the body of `robot`."""
        return self._links[robot].body

    def sense(self, robot: int, now: Instant, bodies: tuple[SeenBody, ...]) -> Sensed | None:
        """Return a sample for the mind of `robot`, with the other robots in view; None if its odometry has stopped."""
        return self._links[robot].body.sense(now, time.monotonic_ns(), bodies)

    # -- out ----------------------------------------------------------------------------------------------------

    def act(self, robot: int, twist: Twist, stamp: Instant, now: Instant) -> None:
        """Command the wheels of `robot` to `twist`, which its mind decided at `stamp`."""
        link = self._links[robot]
        limited = link.body.command(twist, stamp, now)
        if limited is None or link.publisher is None:
            return
        with self._lock:
            link.commanded_at = time.monotonic_ns() - max(0, now - stamp)
            link.zeros = 1 if limited == STILL else 0
            self._publish(link, limited)

    def _publish(self, link: _Link, twist: Twist) -> None:
        message = link_message = TwistMessage()
        if link.stamped:
            link_message = TwistStamped()
            link_message.header.stamp = self._node.get_clock().now().to_msg()
            message = link_message.twist
        message.linear.x = twist.v
        message.angular.z = twist.w
        link.publisher.publish(link_message)

    def _watch(self) -> None:
        """Say zero to each robot whose mind has said nothing for `COMMAND_AGE_MAX`; in rclpy's thread."""
        clock = time.monotonic_ns()
        for link in self._links.values():
            with self._lock:
                said_zero = link.zeros > 0
                if link.zeros < ZEROS and (said_zero or clock - link.commanded_at > COMMAND_AGE_MAX):
                    link.zeros += 1
                    self._publish(link, STILL)

    def perform(self, asked: Asked, name: str | None, args: Sequence[Value]) -> None:
        """Begin an action that ROS 2 carries out; break it off if the name is None."""
        if name == "navigate" and self._nav2.drives(asked[0]):
            self._nav2.go(asked, args, time.monotonic_ns())
        elif name is None:
            self._actions.cancel(asked)
        else:
            self._actions.perform(asked, name, args, time.monotonic_ns())

    def performed(self) -> Iterator[tuple[Asked, str]]:
        """Yield the actions that have ended since, each with why it failed or an empty text."""
        return self._actions.ended()

    def report(self) -> dict[str, Any]:
        """Return what has come of each robot's topics, for the report of the world."""
        return {str(robot): dict(self._links[robot].body.counts) for robot in self.robots}

    def close(self) -> None:
        """Tell all robots zero, and leave."""
        self._nav2.close()
        for _ in range(ZEROS if self._links else 0):
            with self._lock:
                for link in self._links.values():
                    if link.publisher is not None:
                        link.zeros = ZEROS
                        self._publish(link, STILL)
            time.sleep(WATCH_S)
        self._executor.shutdown(timeout_sec=1.0)
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)
        self._thread.join(timeout=1.0)


def _instant(message: Any) -> Instant:
    stamp = message.header.stamp
    return int(stamp.sec * NS_PER_S + stamp.nanosec)


def _wrong(topic: str, infos: Sequence[Any], known: Iterable[str], verb: str, alike: str) -> str:
    """Return what is wrong with the ends of a topic; empty if nothing is."""
    kinds = sorted({each.topic_type for each in infos})
    wanted = " or ".join(known)
    if not infos:
        return f"nobody {verb} {topic} ({wanted}): start the robot, or correct its names under bodies{alike}"
    foreign = [kind for kind in kinds if kind not in known]
    if foreign or len(kinds) > 1:
        return f"{topic} has the type {' and '.join(kinds)}, and should have one: {wanted}"
    return ""


def _quality(infos: Sequence[Any], *, out: bool = False) -> QoSProfile:
    """Return a quality of service that goes with all the other ends of a topic."""
    profiles = [each.qos_profile for each in infos]
    reliable = out or all(each.reliability == ReliabilityPolicy.RELIABLE for each in profiles)
    kept = any if out else all
    durable = kept(each.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in profiles)
    return QoSProfile(
        depth=1 if out else 10,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if durable else DurabilityPolicy.VOLATILE,
    )
