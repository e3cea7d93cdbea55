"""Simulated robots as robots of ROS 2: a node of rclpy that knows nothing of RMR looks at them, and drives them."""

import json
import math
import os
import signal
import subprocess
import sys
from collections import defaultdict
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from itertools import pairwise
from threading import Thread

import pytest
from launched import CORRIDOR, eventually
from process_tools import free_endpoint

from rmr_world.lab_file import load_lab

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("rclpy") is None, reason="no rclpy here: make ros2"),
]
DOMAIN = 101 + os.getpid() % 100
"""Of this process, so that tests beside each other do not see each other's robots."""
ENVIRONMENT = os.environ | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(DOMAIN)}
METRE = """\
lab: {name}
program: metre.rmr
duration: 40s
finish: at(R, there)
arena: {{size: [2.2, 1.2]}}
areas: {{there: {{at: [1.6, 0.6]}}}}
robots: [{{id: 4, pose: [0.6, 0.6, 0deg]}}]
"""
PROGRAM = """\
type action moveto(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
start(R).
start(R) -o moveto(R, there).
"""


class Watcher:
    """A node that subscribes to whatever it is told to."""

    def __init__(self, monkeypatch):
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        import rclpy
        from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.node = rclpy.create_node("watcher", context=self.context, start_parameter_services=False)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.got = defaultdict(list)

        def spin():
            with suppress(ExternalShutdownException):
                self.executor.spin()

        self.thread = Thread(target=spin)
        self.thread.start()

    def hear(self, topic, kind, quality=10):
        self.node.create_subscription(kind, topic, self.got[topic].append, quality)

    def graph(self):
        """Return (topic, type, reliability, durability) of what others publish and subscribe to."""
        lines = []
        for topic, _ in self.node.get_topic_names_and_types():
            for verb, infos in (
                ("publishes", self.node.get_publishers_info_by_topic(topic)),
                ("takes", self.node.get_subscriptions_info_by_topic(topic)),
            ):
                lines += [
                    f"{each.node_name} {verb} {topic} {each.topic_type} {each.qos_profile.reliability.name} "
                    f"{each.qos_profile.durability.name}"
                    for each in infos
                    if each.node_name != "watcher"
                ]
        return sorted(lines)

    def close(self):
        import rclpy

        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)
        self.thread.join()


@pytest.fixture
def watcher(monkeypatch):
    found = Watcher(monkeypatch)
    yield found
    found.close()


@contextmanager
def world(lab, folder):
    """Run `rmr-world --ros2`; yield what returns its log."""
    log = folder / "world.jsonl"
    listen = ["--listen", free_endpoint()]
    command = [sys.executable, "-m", "rmr_world.main", "--config", lab, "--ros2", "--log", log, *listen]
    with subprocess.Popen(command, env=ENVIRONMENT, stderr=subprocess.DEVNULL) as process:
        try:
            eventually(lambda: process.poll() is not None or (log.exists() and "lab time runs" in log.read_text()))
            assert process.poll() is None
            yield log.read_text
        finally:
            process.send_signal(signal.SIGINT)
            assert process.wait(60) == 0


def test_a_node_of_ros_2_sees_the_floor_and_its_robots_and_drives_one(tmp_path, watcher):
    from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
    from nav_msgs.msg import OccupancyGrid, Odometry
    from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
    from rosgraph_msgs.msg import Clock
    from sensor_msgs.msg import LaserScan
    from visualization_msgs.msg import MarkerArray

    lab = load_lab(CORRIDOR / "lab.yaml")
    kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    got = watcher.got
    with world(CORRIDOR, tmp_path) as log:
        watcher.hear("/clock", Clock)
        watcher.hear("/map", OccupancyGrid, kept)
        watcher.hear("/scene", MarkerArray, kept)
        watcher.hear("/robot_1/odom", Odometry)
        watcher.hear("/robot_1/pose", PoseStamped)
        watcher.hear("/robot_1/scan", LaserScan, qos_profile_sensor_data)
        topics = ("/clock", "/map", "/scene", "/robot_1/odom", "/robot_1/pose", "/robot_1/scan")
        eventually(lambda: all(got[topic] for topic in topics))
        graph = watcher.graph()
        print("\n".join(graph))
        for robot in lab.roster:
            for end in (
                "odom nav_msgs/msg/Odometry",
                "pose geometry_msgs/msg/PoseStamped",
                "scan sensor_msgs/msg/LaserScan",
            ):
                assert f"rmr_world_corridor publishes /robot_{robot}/{end} RELIABLE VOLATILE" in graph
            taken = f"rmr_world_corridor takes /robot_{robot}/cmd_vel geometry_msgs/msg/Twist BEST_EFFORT VOLATILE"
            assert taken in graph
        assert "rmr_world_corridor publishes /map nav_msgs/msg/OccupancyGrid RELIABLE TRANSIENT_LOCAL" in graph
        assert (
            "rmr_world_corridor publishes /scene visualization_msgs/msg/MarkerArray RELIABLE TRANSIENT_LOCAL" in graph
        )
        assert "rmr_world_corridor publishes /clock rosgraph_msgs/msg/Clock RELIABLE VOLATILE" in graph

        (floor,) = got["/map"]
        assert (floor.info.width * floor.info.resolution, floor.info.height * floor.info.resolution) == pytest.approx(
            (lab.arena.width, lab.arena.height), abs=lab.arena.cell
        )
        assert {each.text for each in got["/scene"][0].markers} >= {"entry", "exit"}
        start = next(robot.pose for robot in lab.robots if robot.id == 1)
        at = got["/robot_1/pose"][-1].pose.position
        assert (at.x, at.y) == pytest.approx((start.x, start.y), abs=1e-6)
        scan = got["/robot_1/scan"][-1]
        assert all(scan.range_min < each < math.inf for each in scan.ranges), "a room of 3 m"

        publisher = watcher.node.create_publisher(Twist, "/robot_1/cmd_vel", 10)
        timer = watcher.node.create_timer(0.1, lambda: publisher.publish(command(Twist(), 0.1)))
        eventually(lambda: got["/robot_1/odom"][-1].pose.pose.position.x > 0.1)
        assert got["/robot_1/odom"][-1].twist.twist.linear.x == pytest.approx(0.1, abs=0.02)
        timer.destroy()
        eventually(lambda: got["/robot_1/odom"][-1].twist.twist.linear.x == 0.0)
        moved = got["/robot_1/pose"][-1].pose.position
        assert math.dist((moved.x, moved.y), (start.x, start.y)) > 0.1
        stamps = [each.clock.sec + each.clock.nanosec * 1e-9 for each in got["/clock"]]
        assert stamps == sorted(stamps)

        # Another node, whose velocities have stamps.
        stamped = watcher.node.create_publisher(TwistStamped, "/robot_2/cmd_vel", 10)
        watcher.hear("/robot_2/odom", Odometry)
        watcher.node.create_timer(0.1, lambda: stamped.publish(command(TwistStamped(), 0.1)))
        eventually(lambda: got["/robot_2/odom"] and got["/robot_2/odom"][-1].pose.pose.position.x > 0.02)
        if find_spec("tf2_msgs") is None:
            assert "ROS 2 sees no /tf, as tf2_msgs is not installed here" in log()


def command(message, v):
    """Return the message with this speed."""
    getattr(message, "twist", message).linear.x = v
    return message


def test_a_robot_with_a_mind_is_shown_and_not_driven_by_others(tmp_path, watcher):
    from geometry_msgs.msg import PoseStamped, Twist

    (tmp_path / "lab.yaml").write_text(METRE.format(name="metre"))
    (tmp_path / "metre.rmr").write_text(PROGRAM)
    watcher.hear("/robot_4/pose", PoseStamped)
    publisher = watcher.node.create_publisher(Twist, "/robot_4/cmd_vel", 10)
    watcher.node.create_timer(0.1, lambda: publisher.publish(command(Twist(), -0.2)))
    run = tmp_path / "run"
    words = [sys.executable, "-m", "rmr", "up", tmp_path, "--ros2", "--run", run]
    ended = subprocess.run(words, capture_output=True, text=True, env=ENVIRONMENT, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert json.loads((run / "report.json").read_text())["finished"]
    places = [each.pose.position.x for each in watcher.got["/robot_4/pose"]]
    assert all(after > before - 0.005 for before, after in pairwise(places)), "nobody drives it backwards"
    assert places[-1] == pytest.approx(1.6, abs=0.08)
    said = "robot 4: /robot_4/cmd_vel is not taken, since its mind drives it"
    assert (run / "logs" / "world.jsonl").read_text().count(said) == 1


CHARGED = """\
type action moveto(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
type sensor charge(robot, float).
start(R).
start(R), charge(R, C), C > 0.5 -o full(R).
full(R), charge(R, C), C < 0.2 -o moveto(R, there).
"""
FACT = "facts: [{topic: battery_state, type: sensor_msgs/BatteryState, fact: 'charge(R, percentage)', every: 200ms}]\n"


def test_a_fact_holds_with_the_newest_message_of_a_topic(tmp_path, watcher):
    from sensor_msgs.msg import BatteryState

    (tmp_path / "lab.yaml").write_text(METRE.format(name="metre") + FACT)
    (tmp_path / "metre.rmr").write_text(CHARGED)
    level = [0.9]
    publisher = watcher.node.create_publisher(BatteryState, "/robot_4/battery_state", 10)
    watcher.node.create_timer(0.1, lambda: publisher.publish(BatteryState(percentage=level[0])))
    run = tmp_path / "run"
    words = [sys.executable, "-m", "rmr", "up", tmp_path, "--run", run]

    def held():
        command = [sys.executable, "-m", "rmr", "facts", "4", "--run", run]
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout

    with subprocess.Popen(words, env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as up:
        eventually(lambda: up.poll() is not None or "full(@4)" in held())
        level[0] = 0.1
        said = up.communicate(timeout=100)[0]
    assert up.returncode == 0, said
    assert json.loads((run / "report.json").read_text())["finished"]


@pytest.mark.parametrize(
    ("was", "written", "said"),
    [
        ("percentage", "percent", "facts.0: sensor_msgs/BatteryState has no field percent; did you mean percentage?"),
        ("BatteryState", "Batery", "facts.0: sensor_msgs has no messages Batery; did you mean BatteryState?"),
        ("percentage", "present", "facts.0: argument 2 of 'charge' is a float, and the field present a boolean"),
        ("percentage", "header", "facts.0: the field header is a std_msgs/Header; name a field of it: header.stamp"),
        ("percentage", "header.stamp.sec.x", "facts.0: int32 has no field x"),
        ("R, percentage", "R, percentage, voltage", "facts.0.fact: 'charge' has 2 arguments in the program, here 3"),
        ("charge", "chrge", "facts.0.fact: the program knows no fact 'chrge'; did you mean 'charge'?"),
    ],
)
def test_a_fact_that_cannot_be_had_is_named_before_the_lab_begins(tmp_path, was, written, said):
    (tmp_path / "lab.yaml").write_text(METRE.format(name="metre") + FACT.replace(was, written))
    (tmp_path / "metre.rmr").write_text(CHARGED)
    words = [sys.executable, "-m", "rmr", "up", tmp_path, "--run", tmp_path / "run"]
    ended = subprocess.run(words, capture_output=True, text=True, env=ENVIRONMENT, check=False)
    assert ended.returncode != 0
    assert said in ended.stdout + ended.stderr
    assert "Traceback" not in ended.stdout + ended.stderr


GRIPS = """\
type action grip(R: robot, B: bool) -o gripped(R, B) else slipped(R, B).
type action glow(R: robot, L: float) -o glowing(R).
start(R).
start(R) -o grip(R, false).
slipped(R, false) -o grip(R, true).
gripped(R, true) -o glow(R, 0.5).
"""
ACTIONS = """\
actions:
  - {action: "grip(R, data)", service: gripper/close, type: std_srvs/SetBool, within: 1s}
  - {action: "glow(R, r)", topic: led, type: std_msgs/ColorRGBA, fields: {a: 1.0}}
"""


def grip_lab(folder, actions=ACTIONS):
    """Write a lab that grips, and grips again when that has failed."""
    lab = METRE.format(name="grips").replace("metre.rmr", "grips.rmr").replace("at(R, there)", "glowing(R)")
    (folder / "lab.yaml").write_text(lab + actions)
    (folder / "grips.rmr").write_text(GRIPS)
    return [sys.executable, "-m", "rmr", "up", folder, "--run", folder / "run"]


def test_an_action_calls_a_service_fails_by_its_answer_and_another_one_publishes(tmp_path, watcher):
    from std_msgs.msg import ColorRGBA
    from std_srvs.srv import SetBool

    asked = []

    def close(request, answer):
        asked.append(request.data)
        answer.success, answer.message = request.data, "nothing between the jaws"
        return answer

    watcher.node.create_service(SetBool, "/robot_4/gripper/close", close)
    watcher.hear("/robot_4/led", ColorRGBA)
    words = grip_lab(tmp_path)
    ended = subprocess.run(words, capture_output=True, text=True, env=ENVIRONMENT, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    report = json.loads((tmp_path / "run" / "report.json").read_text())
    assert report["finished"]
    robot = report["robots"]["4"]
    assert [action for _, action in robot["actions"]] == ["grip(@4, false)", "grip(@4, true)", "glow(@4, 0.5)"]
    assert robot["actions_failed"] == 1
    assert robot["first_failure"][1:] == ["grip(@4, false)", "/robot_4/gripper/close: nothing between the jaws"]
    assert asked == [False, True], "each was called once"
    assert [(each.r, each.a) for each in watcher.got["/robot_4/led"]] == [(0.5, 1.0)]


def test_a_service_that_does_not_answer_in_time_fails_the_action(tmp_path, watcher):
    from std_msgs.msg import ColorRGBA
    from std_srvs.srv import SetBool

    def late(request, answer):
        eventually(lambda: request.data or (tmp_path / "over").exists())
        answer.success = True
        return answer

    watcher.node.create_service(SetBool, "/robot_4/gripper/close", late)
    watcher.hear("/robot_4/led", ColorRGBA)
    with subprocess.Popen(grip_lab(tmp_path), env=ENVIRONMENT, stdout=subprocess.PIPE, text=True) as up:
        log = tmp_path / "run" / "logs" / "robot-4.jsonl"
        eventually(lambda: log.exists() and "no answer of /robot_4/gripper/close within 1 s" in log.read_text())
        (tmp_path / "over").touch()
        up.communicate(timeout=100)
    assert up.returncode == 0
    assert json.loads((tmp_path / "run" / "report.json").read_text())["robots"]["4"]["facts"].count("glowing(@4)") == 1


@pytest.mark.parametrize(
    ("was", "written", "said"),
    [
        ("SetBool", "SetBol", "actions.0: std_srvs has no services SetBol; did you mean SetBool?"),
        ("std_srvs", "grip_srvs", "actions.0: the services of grip_srvs are not installed here"),
        ("R, data", "R, date", "actions.0: std_srvs/SetBool has no field date; did you mean data?"),
        ("R, r)", "R, a, r)", "actions.1.action: 'glow' has 2 arguments in the program, here 3"),
        ("a: 1.0", "a: true", "actions.1: the field a is a float, not true"),
        ("grip(R", "grop(R", "actions.0.action: the program declares no action 'grop'; did you mean 'grip'?"),
    ],
)
def test_an_action_that_cannot_be_carried_out_is_named_before_the_lab_begins(tmp_path, was, written, said):
    words = grip_lab(tmp_path, ACTIONS.replace(was, written))
    ended = subprocess.run(words, capture_output=True, text=True, env=ENVIRONMENT, check=False)
    assert ended.returncode != 0
    assert said in ended.stdout + ended.stderr
    assert "Traceback" not in ended.stdout + ended.stderr


def test_services_and_subscribers_that_do_not_come_are_named_and_the_lab_does_not_begin(tmp_path):
    ended = subprocess.run(grip_lab(tmp_path), capture_output=True, text=True, env=ENVIRONMENT, check=False)
    assert ended.returncode == 1
    said = ended.stdout + ended.stderr
    assert "robot 4: nobody serves /robot_4/gripper/close (std_srvs/srv/SetBool): start its node, or correct" in said
    assert "robot 4: nobody subscribes to /robot_4/led (std_msgs/msg/ColorRGBA): start its node, or correct" in said
    assert "Traceback" not in said


def test_one_lab_drives_the_simulated_robot_of_another_one_over_topics(tmp_path):
    for name, bodies in (("simulated", ""), ("driven", "bodies: [{ros2: {namespace: '/robot_{id}', pose: pose}}]\n")):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "lab.yaml").write_text(METRE.format(name=name) + bodies)
        (folder / "metre.rmr").write_text(PROGRAM)
    run = tmp_path / "run"
    with world(tmp_path / "simulated", tmp_path):
        words = [sys.executable, "-m", "rmr", "up", tmp_path / "driven", "--run", run]
        ended = subprocess.run(words, capture_output=True, text=True, env=ENVIRONMENT, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    report = json.loads((run / "report.json").read_text())
    assert report["finished"]
    assert report["ros2"]["4"]["refused"] == 0
