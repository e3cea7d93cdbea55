"""Bodies that RMR did not make: ROS 2 nodes over MuJoCo, processes of their own, driven by `rmr up` over topics."""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from launched import eventually

from rmr_world.lab_file import load_lab

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples" / "ros2"
LACKS = [name for name in ("rclpy", "mujoco") if find_spec(name) is None]
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(LACKS), reason=f"no {' and no '.join(LACKS)} here: make ros2"),
]
PAGE = EXAMPLES.parents[1] / "ros2.md"
DOMAIN = 1 + os.getpid() % 100
"""Of this process, so that tests beside each other do not drive each other's robots."""
ENVIRONMENT = os.environ | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(DOMAIN)}


class Robots:
    """A process with robots over MuJoCo."""

    def __init__(self, lab, folder, *options):
        self._report = folder / "robots.json"
        self._errors = folder / "robots.err"
        command = [sys.executable, EXAMPLES / "mujoco_robots.py", lab, "--report", self._report, *options]
        with self._errors.open("w") as errors:
            self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, env=ENVIRONMENT)
        assert self._process.stdout.readline(), self._errors.read_text()

    def now(self):
        """Return what has truly happened so far."""
        return eventually(lambda: json.loads(self._report.read_text()) if self._report.exists() else None)

    def send(self, number):
        self._process.send_signal(number)

    def end(self):
        """End them; return what has truly happened."""
        self._process.send_signal(signal.SIGCONT)
        self._process.send_signal(signal.SIGINT)
        self._process.wait(120)
        self._process.stdout.close()
        return json.loads(self._report.read_text())


@pytest.fixture
def robots(tmp_path):
    started = []

    def start(lab, *options):
        started.append(Robots(lab, tmp_path, *options))
        return started[-1]

    yield start
    for each in started:
        if each._process.poll() is None:
            each.end()


def up(lab, folder, *options):
    """Run `rmr up`; return its exit code, report and output."""
    run = folder / "run"
    command = [sys.executable, "-m", "rmr", "up", lab, "--run", run, *options]
    ended = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, check=False)
    report = json.loads((run / "report.json").read_text()) if (run / "report.json").exists() else {}
    return ended.returncode, report, ended.stdout + ended.stderr


@pytest.mark.parametrize("options", [(), ("--stamped",)], ids=["Twist", "TwistStamped"])
def test_a_robot_of_ros_2_drives_a_metre(tmp_path, robots, options):
    fleet = robots(EXAMPLES / "metre.yaml", *options)
    code, report, said = up(EXAMPLES / "metre.yaml", tmp_path)
    assert code == 0, said
    assert report["finished"]
    truth = fleet.end()
    assert truth["contacts"] == []
    x, y, _ = truth["poses"]["4"]
    assert abs(x - 1.6) < 0.08
    assert abs(y - 0.6) < 0.08
    assert truth["speeds"]["4"] == [0.0, 0.0]


@pytest.mark.timeout(400)
def test_six_robots_of_ros_2_pass_the_corridor_within_their_deadlines_and_touch_nothing(tmp_path, robots):
    fleet = robots(EXAMPLES / "corridor.yaml")
    code, report, said = up(EXAMPLES / "corridor.yaml", tmp_path)
    truth = fleet.end()
    assert code == 0, said
    assert truth["contacts"] == []
    exits = load_lab(EXAMPLES / "corridor.yaml").arena.area("exit").places
    for x, y, _ in truth["poses"].values():
        assert min(((x - slot.x) ** 2 + (y - slot.y) ** 2) ** 0.5 for slot in exits) < 0.1
    assert report["deadlines"]["met"] == 6
    assert {entry["estimates_dropped"] for entry in report["robots"].values()} == {0}
    for counts in report["ros2"].values():  # odometry at 50 Hz and poses at 5 Hz, of which 2 % are lost
        assert 40 * report["time_s"] < counts["odometry"]
        assert 4 * report["time_s"] < counts["poses"]


def test_robots_that_are_not_there_are_named_with_what_to_do_before_the_lab_begins(tmp_path, robots):
    lab = tmp_path / "lab.yaml"
    text = (EXAMPLES / "metre.yaml").read_text()
    (tmp_path / "metre.rmr").write_text((EXAMPLES / "metre.rmr").read_text())
    lab.write_text(text.replace("/tb3_{id}", "/other"))
    robots(EXAMPLES / "metre.yaml")
    code, _, said = up(lab, tmp_path)
    assert code == 1
    assert "robot 4: nobody publishes /other/odom (nav_msgs/msg/Odometry): start the robot, or correct" in said
    assert "; of its type are /tb3_4/odom" in said


@pytest.mark.timeout(400)
def test_three_simulated_and_three_robots_of_ros_2_pass_the_corridor_together(tmp_path, robots):
    fleet = robots(EXAMPLES / "mixed.yaml")
    code, report, said = up(EXAMPLES / "mixed.yaml", tmp_path)
    truth = fleet.end()
    assert code == 0, said
    assert truth["poses"].keys() == report["ros2"].keys() == {"4", "5", "6"}
    assert (truth["contacts"], report["collisions"]) == ([], 0)
    assert report["deadlines"]["met"] == 6


def test_a_robot_that_gets_no_pose_for_five_seconds_stands_and_goes_on(tmp_path, robots):
    fleet = robots(EXAMPLES / "metre.yaml", "--lose", "4:1.5:6.5")
    code, report, said = up(EXAMPLES / "metre.yaml", tmp_path)
    truth = fleet.end()
    assert code == 0, said
    assert report["robots"]["4"]["estimates_dropped"] == 1
    stood = truth["stopped"]["4"][0] - truth["set_out"]["4"]
    assert 2.0 < stood < 4.5, "a second after the last pose, which came up to 0.2 s before"
    assert report["robots"]["4"]["finish_s"] > 6.5
    logged = (tmp_path / "run" / "logs" / "world.jsonl").read_text()
    assert "robot 4: no pose on /tb3_4/amcl_pose agrees: it stands" in logged
    assert "robot 4: located at (" in logged


def test_a_robot_that_is_carried_off_stands_until_it_is_located_and_drives_from_there(tmp_path, robots):
    fleet = robots(EXAMPLES / "metre.yaml", "--kidnap", "4:2:0.4:0.9:2.5")
    code, report, said = up(EXAMPLES / "metre.yaml", tmp_path)
    truth = fleet.end()
    assert code == 0, said
    assert report["robots"]["4"]["estimates_dropped"] >= 1
    assert truth["contacts"] == []
    x, y, _ = truth["poses"]["4"]
    assert abs(x - 1.6) < 0.08
    assert abs(y - 0.6) < 0.08


@pytest.mark.parametrize(
    ("process", "number", "options"),
    [
        ("robot-4", signal.SIGSTOP, ("--silence", "60")),
        ("robot-4", signal.SIGKILL, ("--silence", "60")),
        ("world", signal.SIGTERM, ("--silence", "60")),
        ("world", signal.SIGKILL, ()),
    ],
    ids=["its mind stalls", "its mind dies", "the world ends", "the world is killed"],
)
def test_a_robot_stops_by_the_word_of_the_bridge_and_by_itself_where_that_is_killed(
    tmp_path, robots, process, number, options
):
    """A robot with a patience of 60 s stops since the bridge says zero."""
    fleet = robots(EXAMPLES / "metre.yaml", *options)
    run = tmp_path / "run"
    command = [sys.executable, "-m", "rmr", "up", EXAMPLES / "metre.yaml", "--run", run]
    with subprocess.Popen(command, env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as launcher:
        eventually(lambda: fleet.now().get("set_out"))
        victim = json.loads((run / "processes.json").read_text())["processes"][process]
        os.kill(victim, number)
        eventually(lambda: fleet.now()["speeds"]["4"] == [0.0, 0.0])
        truth = fleet.now()
        launcher.send_signal(signal.SIGINT)
        os.kill(victim, signal.SIGCONT) if number == signal.SIGSTOP else None
        launcher.wait(60)
    assert truth["stopped"]["4"]
    assert truth["poses"]["4"][0] < 1.55, "it was on its way"


def test_a_robot_with_a_lidar_drives_around_what_no_map_shows_and_no_radio_tells(tmp_path, robots):
    fleet = robots(EXAMPLES / "scan.yaml", "--stranger", "1.3:0.8")
    code, report, said = up(EXAMPLES / "scan.yaml", tmp_path)
    truth = fleet.end()
    assert code == 0, said
    assert truth["contacts"] == []
    x, y, _ = truth["poses"]["4"]
    assert abs(x - 2.1) < 0.08
    assert abs(y - 0.8) < 0.08
    assert report["ros2"]["4"]["scans"] > 5 * report["time_s"]


def test_without_the_lidar_it_drives_into_it(tmp_path, robots):
    """What the test above shows is not the floor's doing."""
    text = (EXAMPLES / "scan.yaml").read_text()
    (tmp_path / "blind.yaml").write_text(text.replace(", scan: scan", ""))
    (tmp_path / "metre.rmr").write_text((EXAMPLES / "metre.rmr").read_text())
    fleet = robots(tmp_path / "blind.yaml", "--stranger", "1.3:0.8")
    up(tmp_path / "blind.yaml", tmp_path, "--timeout", "40")
    assert ["robot 4", "stranger0"] in [sorted(pair) for _, *pair in fleet.end()["contacts"]]


def commands_of_the_page(section):
    """Return the indented lines of a section of the page, as a shell gets them, without those that are set-up."""
    text = PAGE.read_text().split(f"\n## {section}\n")[1].split("\n## ")[0]
    lines = [line.strip() for line in text.splitlines() if line.startswith("    ")]
    exports = [line for line in lines if line.startswith("export ")]
    assert set(exports) == {"export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST"}
    return [line for line in lines if line not in exports]


TRIED = commands_of_the_page("Try it without robots")
ROBOTS = [line for line in TRIED if line.startswith("python ")]


def test_the_page_has_a_command_for_the_lab_and_some_for_robots():
    assert [line for line in TRIED if line not in ROBOTS] == ["rmr up docs/examples/ros2/corridor.yaml"]
    assert len(ROBOTS) == 4


@pytest.mark.timeout(400)
@pytest.mark.parametrize("line", ROBOTS)
def test_what_the_page_says_to_try_without_robots_works_word_by_word(tmp_path, line):
    """In the folder of a clone, with the programs of its environment first on the path, in two terminals."""
    (tmp_path / "docs").symlink_to(PAGE.parent)
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    terminal = {"cwd": tmp_path, "env": ENVIRONMENT | {"PATH": path}, "text": True}
    lab = re.search(r"docs/\S+\.yaml", line)[0]
    words = shlex.split(line, comments=True)
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **terminal) as fleet:
        try:
            assert re.fullmatch(r"\d robots\n", fleet.stdout.readline()), fleet.stderr.read()
            up = subprocess.run(["rmr", "up", lab], capture_output=True, check=False, **terminal)
        finally:
            fleet.send_signal(signal.SIGINT)
            errors = fleet.communicate(timeout=60)[1]
    assert up.returncode == 0, up.stdout + up.stderr
    assert "every robot holds the finish fact" in up.stdout + up.stderr
    assert "Traceback" not in errors + up.stderr
