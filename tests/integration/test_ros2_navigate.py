"""Nav2 drives: minds order goals in pieces, by turns, from an action server that we did not get from Nav2.

The package nav2_msgs has no wheel; the one action is built here from its definition by the generators of ROS 2.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
from importlib.util import find_spec
from pathlib import Path

import pytest
from launched import eventually
from test_ros2_bodies import ENVIRONMENT, Robots

HERE = Path(__file__).parent
LACKS = [name for name in ("rclpy", "mujoco", "ament_package", "catkin_pkg") if find_spec(name) is None]
LACKS += [name for name in ("cmake", "c++") if shutil.which(name) is None]
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(LACKS), reason=f"no {' and no '.join(LACKS)} here: make ros2, and a compiler"),
]
METRE = """\
lab: metre
program: metre.rmr
duration: 40s
finish: over(R)
arena: {size: [2.2, 1.2]}
areas: {there: {at: [1.6, 0.6]}}
robots: [{id: 4, pose: [0.6, 0.6, 0deg]}]
robot: {radius: 0.105, speed: 0.2, turn: 120deg}
bodies: [{ros2: {namespace: "/tb3_{id}", navigate: navigate_to_pose}}]
"""
PROGRAM = """\
type action navigate(R: robot, A: area) -o over(R), there(R, A) else over(R), stuck(R, A).
start(R).
start(R) -o navigate(R, there).
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """Return the environment of processes that find nav2_msgs, built if it is not installed."""
    if find_spec("nav2_msgs") is not None:
        return ENVIRONMENT
    folder = tmp_path_factory.mktemp("nav2")
    prefix = folder / "prefix"
    shutil.copytree(Path(sys.prefix, "share"), prefix / "share", symlinks=True)
    for name in ("lib", "include", "bin"):
        if Path(sys.prefix, name).exists():
            (prefix / name).symlink_to(Path(sys.prefix, name))
    # The wheels name folders of the machine that built them.
    import numpy

    for file in prefix.glob("share/*/cmake/*.cmake"):
        text = file.read_text()
        if "/opt/python/" in text:
            text = text.replace("/opt/python/cp311-cp311/include/python3.11", sysconfig.get_path("include"))
            built = "/opt/python/cp311-cp311/lib/python3.11/site-packages/numpy/_core/include"
            file.write_text(text.replace(built, numpy.get_include()))
    shutil.copytree(HERE / "nav2_interface", folder / "source")
    path = os.pathsep.join([str(prefix / "bin"), os.environ["PATH"]])
    made = os.environ | {"PATH": path, "AMENT_PREFIX_PATH": str(prefix), "CMAKE_PREFIX_PATH": str(prefix)}
    build = [
        "cmake",
        "-S",
        folder / "source",
        "-B",
        folder / "build",
        f"-DCMAKE_INSTALL_PREFIX={folder / 'installed'}",
    ]
    build += [f"-DPython3_EXECUTABLE={sys.executable}", "-DBUILD_TESTING=OFF"]
    for command in (build, ["cmake", "--build", folder / "build", "--target", "install"]):
        done = subprocess.run(command, capture_output=True, text=True, env=made, check=False)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    packages = next((folder / "installed").glob("lib/python*/site-packages"))
    found = os.environ.get("PYTHONPATH", "")
    libraries = os.environ.get("LD_LIBRARY_PATH", "")
    return ENVIRONMENT | {
        "PYTHONPATH": os.pathsep.join([str(packages), *filter(None, [found])]),
        "LD_LIBRARY_PATH": os.pathsep.join([str(folder / "installed" / "lib"), *filter(None, [libraries])]),
    }


@pytest.fixture
def nav2(environment, tmp_path):
    """Return a function that starts robots over MuJoCo and their Nav2; it returns the robots and the log of goals."""
    started = []
    log = tmp_path / "goals.jsonl"
    log.touch()

    def start(lab, robots, *options, serves=True):
        fleet = Robots(lab, tmp_path)
        started.append(fleet)
        if serves:
            words = [sys.executable, HERE / "nav2_standin.py", *map(str, robots), "--log", log, *options]
            server = subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True)
            started.append(server)
            assert server.stdout.readline() == "serves\n"
        return fleet, lambda: [json.loads(line) for line in log.read_text().splitlines()]

    yield start
    for each in started:
        if isinstance(each, Robots):
            each.end()
        else:
            each.kill()
            each.wait()
            each.stdout.close()


def written(folder, lab=METRE, program=PROGRAM):
    (folder / "lab.yaml").write_text(lab)
    (folder / "metre.rmr").write_text(program)
    return folder / "lab.yaml"


def up(lab, environment):
    """Run `rmr up`; return its exit code, report and output."""
    run = lab.parent / "run"
    words = [sys.executable, "-m", "rmr", "up", lab, "--run", run]
    ended = subprocess.run(words, capture_output=True, text=True, env=environment, check=False)
    report = json.loads((run / "report.json").read_text()) if (run / "report.json").exists() else {}
    return ended.returncode, report, ended.stdout + ended.stderr


def test_a_drive_of_nav2_ends_as_its_goal_does(tmp_path, nav2, environment):
    lab = written(tmp_path)
    fleet, goals = nav2(lab, [4])
    code, report, said = up(lab, environment)
    assert code == 0, said
    assert "there(@4, there)" in report["robots"]["4"]["facts"]
    assert [(each["what"], each.get("x")) for each in goals()] == [("goal", 1.6), ("succeeded", None)]
    x, y, _ = fleet.now()["poses"]["4"]
    assert abs(x - 1.6) < 0.1
    assert abs(y - 0.6) < 0.1
    assert fleet.now()["contacts"] == []


@pytest.mark.parametrize(
    ("option", "why"),
    [
        (("--fail", "no valid path"), "Nav2 has given up: no valid path"),
        (("--reject",), "Nav2 refuses the goal"),
    ],
)
def test_a_goal_that_nav2_gives_up_or_refuses_fails_the_action(tmp_path, nav2, environment, option, why):
    lab = written(tmp_path)
    nav2(lab, [4], *option)
    code, report, said = up(lab, environment)
    assert code == 0, said
    robot = report["robots"]["4"]
    assert "stuck(@4, there)" in robot["facts"]
    assert robot["first_failure"][1:] == ["navigate(@4, there)", why]


def test_a_stopped_drive_cancels_its_goal(tmp_path, nav2, environment):
    program = PROGRAM.replace(
        "start(R) -o",
        "type action stop(robot).\ntype action wait(R: robot, S: float) -o late(R).\nstart(R) -o wait(R, 3.0),",
    )
    lab = written(tmp_path, program=program + "late(R) -o stop(R).\n")
    fleet, goals = nav2(lab, [4])
    code, report, said = up(lab, environment)
    assert code == 0, said
    assert "stuck(@4, there)" in report["robots"]["4"]["facts"]
    eventually(lambda: [each["what"] for each in goals()] == ["goal", "cancelled"])
    assert 0.65 < fleet.now()["poses"]["4"][0] < 1.5


def test_the_goal_of_a_mind_that_dies_is_cancelled(tmp_path, nav2, environment):
    lab = written(tmp_path)
    fleet, goals = nav2(lab, [4])
    run = tmp_path / "run"
    words = [sys.executable, "-m", "rmr", "up", lab, "--run", run]
    with subprocess.Popen(words, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as launcher:
        eventually(lambda: fleet.now().get("set_out"))
        os.kill(json.loads((run / "processes.json").read_text())["processes"]["robot-4"], signal.SIGKILL)
        eventually(lambda: [each["what"] for each in goals()] == ["goal", "cancelled"])
        launcher.send_signal(signal.SIGINT)
        launcher.wait(60)
    assert fleet.now()["poses"]["4"][0] < 1.5


def test_a_nav2_that_is_not_there_is_named_before_the_lab_begins(tmp_path, nav2, environment):
    lab = written(tmp_path)
    nav2(lab, [4], serves=False)
    code, _, said = up(lab, environment)
    assert code == 1
    why = "robot 4: nobody serves /tb3_4/navigate_to_pose (nav2_msgs/action/NavigateToPose): start its Nav2, or correct"
    assert why in said


CORRIDOR = """\
lab: corridor
program: metre.rmr
duration: 120s
finish: at(R, exit)
arena: {size: [4.5, 2.25], cell: 0.05}
obstacles:
  - {box: [1.8, 0.0, 2.7, 0.9]}
  - {box: [1.8, 1.35, 2.7, 2.25]}
areas:
  entry: {at: [1.65, 1.125], queue: {path: [[1.65, 1.125], [0.15, 1.125]], spacing: 0.3}}
  exit: {slots: [[3.9, 1.725], [3.9, 0.525]]}
bottleneck: entry
robots:
  - {id: 1, pose: [0.9, 1.8, 0deg]}
  - {id: 2, pose: [0.9, 0.45, 0deg]}
facts: ["due(@1, 70)", "due(@2, 40)"]
robot: {radius: 0.105, speed: 0.2, turn: 120deg}
bodies: [{ros2: {namespace: "/tb3_{id}", navigate: navigate_to_pose}}]
"""
TURNS = """\
type action navigate(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
type !due(robot, float).
start(R).
start(R), due(R, D) -o crossing(R, D).
crossing: assert(crossing(R, D), at(R, exit), D, broadcast(R)).
crossing(R, _) -o navigate(R, exit).
"""


@pytest.mark.timeout(300)
def test_two_robots_of_nav2_pass_a_corridor_in_turns(tmp_path, nav2, environment):
    lab = written(tmp_path, CORRIDOR, TURNS)
    fleet, goals = nav2(lab, [1, 2], "--via", "3.0:1.125")
    code, report, said = up(lab, environment)
    assert code == 0, said
    assert fleet.now()["contacts"] == []
    assert report["deadlines"]["met"] == 2
    assert report["schedule"][-1]["order"] == [2, 1]
    ordered = [(each["robot"], each["x"] > 2.0) for each in goals() if each["what"] == "goal"]
    second = [through for robot, through in ordered if robot == 2]
    assert second == [False, True], "the first in turn drives to the hold line, then on"
    assert ordered.index((2, True)) < ordered.index((1, True)), "the other one waits for its turn before the corridor"
    words = [sys.executable, "-m", "rmr", "why", tmp_path / "run", "crossing@1", "--missed"]
    said = subprocess.run(words, capture_output=True, text=True, check=False).stdout
    assert re.search(r"turn +behind robot 2", said), said
    assert re.search(r"drive +navigate\(@1, exit\)", said), said
    words = [sys.executable, "-m", "rmr", "replay", tmp_path / "run"]
    assert "2 of 2 minds equal" in subprocess.run(words, capture_output=True, text=True, check=False).stdout
