"""Stands for Nav2 in tests: an action server for each robot that drives it over ROS 2, straight or by one via point.

As Nav2 does, it takes a newer goal in place of an older one, which is aborted, and stops when a goal is cancelled. It
writes a line of JSON for each goal and for each end.
"""

import argparse
import json
import math
import sys
import time
from pathlib import Path
from threading import Lock

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node

PERIOD_S = 0.05


class Driver:
    """One robot's Nav2."""

    def __init__(self, node, robot, options):
        self.robot, self.options, self.others = robot, options, []
        self.at = None
        self.current = None
        self.lock = Lock()
        group = ReentrantCallbackGroup()
        space = f"/tb3_{robot}"
        self.velocity = node.create_publisher(Twist, f"{space}/cmd_vel", 10)
        node.create_subscription(PoseWithCovarianceStamped, f"{space}/amcl_pose", self.pose, 10, callback_group=group)
        self.server = ActionServer(
            node,
            NavigateToPose,
            f"{space}/navigate_to_pose",
            self.execute,
            goal_callback=lambda _: GoalResponse.REJECT if options.reject else GoalResponse.ACCEPT,
            handle_accepted_callback=self.accepted,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            callback_group=group,
        )

    def note(self, what, **more):
        with self.lock, self.options.log.open("a") as log:
            log.write(json.dumps({"at": time.time(), "robot": self.robot, "what": what, **more}) + "\n")

    def pose(self, message):
        pose = message.pose.pose
        self.at = pose.position.x, pose.position.y, 2 * math.atan2(pose.orientation.z, pose.orientation.w)

    def accepted(self, handle):
        self.current = handle
        handle.execute()

    def execute(self, handle):
        goal = handle.request.pose.pose.position
        self.note("goal", x=round(goal.x, 3), y=round(goal.y, 3))
        began = time.monotonic()
        result = NavigateToPose.Result()
        while True:
            if self.current is not handle:
                handle.abort()
                self.note("preempted")
                return result
            if handle.is_cancel_requested:
                self.velocity.publish(Twist())
                handle.canceled()
                self.note("cancelled")
                return result
            if self.options.fail and time.monotonic() - began > 1.0:
                self.velocity.publish(Twist())
                result.error_code, result.error_msg = 103, self.options.fail
                handle.abort()
                self.note("failed")
                return result
            if self.at is not None and self.drive(goal.x, goal.y):
                handle.succeed()
                self.note("succeeded", at=[round(each, 3) for each in self.at])
                return result
            time.sleep(PERIOD_S)  # the period of its control

    def drive(self, x, y):
        """Say one command; return whether it is there."""
        via = self.options.via
        if via and self.at[0] < via[0] - 0.1 < x:
            x, y = via
        command = Twist()
        away = math.hypot(x - self.at[0], y - self.at[1])
        there = away < 0.025
        if not there:
            error = (math.atan2(y - self.at[1], x - self.at[0]) - self.at[2] + math.pi) % math.tau - math.pi
            command.angular.z = max(-1.0, min(1.0, 2.0 * error))
            free = not any(map(self.is_ahead, self.others))
            command.linear.x = min(0.15, 0.8 * away + 0.02) if abs(error) < 0.4 and free else 0.0
        self.velocity.publish(command)
        return there

    def is_ahead(self, other):
        """Return whether another robot stands or drives right ahead, as Nav2 sees it by its lidar."""
        if other.at is None:
            return False
        dx, dy = other.at[0] - self.at[0], other.at[1] - self.at[1]
        along = dx * math.cos(self.at[2]) + dy * math.sin(self.at[2])
        return along > 0.0 and math.hypot(dx, dy) < 0.4 and abs(along) > 0.6 * math.hypot(dx, dy)


def main():
    """Serve until SIGINT."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", type=int, nargs="+")
    parser.add_argument("--log", type=Path, required=True)
    parser.add_argument("--via", type=lambda text: tuple(map(float, text.split(":"))))
    parser.add_argument("--fail", default="")
    parser.add_argument("--reject", action="store_true")
    options = parser.parse_args()
    rclpy.init()
    node = Node("nav2_standin", start_parameter_services=False)
    kept = [Driver(node, robot, options) for robot in options.robots]
    for each in kept:
        each.others = [other for other in kept if other is not each]
    executor = MultiThreadedExecutor(num_threads=2 + 3 * len(kept))
    executor.add_node(node)
    print("serves", flush=True)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    return 0


if __name__ == "__main__":
    sys.exit(main())
