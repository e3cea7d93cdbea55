"""A lab with bodies in ROS 2 where there is no rclpy: one sentence."""

import asyncio
import sys
from pathlib import Path

from rmr.bus.process import Ending
from rmr.entry import ExitCode
from rmr_world.lab_file import load_lab
from rmr_world.world_process import _bridge

LAB = Path(__file__).parents[3] / "docs" / "examples" / "ros2" / "corridor.yaml"


def test_without_rclpy_the_world_ends_with_a_sentence_that_says_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    monkeypatch.delitem(sys.modules, "rmr_ros.ros_bridge", raising=False)
    ending = Ending()
    assert asyncio.run(_bridge(load_lab(LAB), ending)) is None
    assert ending.code == ExitCode.FAILED
    assert ending.reason.startswith("robots 1-6 have bodies in ROS 2: install rclpy by pip install 'rmr-robots[ros2]'")
