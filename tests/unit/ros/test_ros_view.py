"""What the view shows of a simulated robot: rays, odometry, frames, the map and markers. No node is opened."""

import math

import pytest

from rmr.base.arena import Area, Arena, Disc, Polygon, RobotShape
from rmr.base.geometry import Point, Pose

pytest.importorskip("rclpy", reason="no rclpy here: make ros2")
from rmr.record.foxglove_messages import scene
from rmr_ros import ros_view
from rmr_ros.ros_view import RAYS, Lidar, _map_message, _markers, _Shown, _transforms

BOX = Polygon((Point(2.0, 0.5), Point(2.5, 0.5), Point(2.5, 1.5), Point(2.0, 1.5)))
ARENA = Arena(3.0, 2.0, 0.05, (BOX, Disc(Point(0.5, 1.5), 0.2)), shape=RobotShape(radius=0.1))
AHEAD = RAYS // 2


def ray(degrees):
    return (AHEAD + round(degrees / 360 * RAYS)) % RAYS


@pytest.mark.parametrize(
    ("theta", "degrees", "metres"),
    [(0.0, 0, 1.5), (0.0, -90, 1.0), (0.0, 180, 0.5), (math.pi / 2, -90, 1.5), (math.pi, 0, 0.5), (math.pi, 90, 1.0)],
)
def test_a_ray_ends_at_the_first_wall_or_obstacle(theta, degrees, metres):
    assert Lidar(ARENA).ranges(Pose(0.5, 1.0, theta), ())[ray(degrees)] == pytest.approx(metres)


def test_rays_meet_hulls_and_round_obstacles_and_what_is_too_far_is_not_met():
    lidar = Lidar(ARENA)
    at = Pose(0.5, 1.0, 0.0)
    assert lidar.ranges(at, ())[ray(90)] == pytest.approx(0.3)
    assert lidar.ranges(at, [(1.0, 1.0, 0.1)])[ray(0)] == pytest.approx(0.4)
    assert lidar.ranges(at, [(0.0, 1.0, 0.1)])[ray(0)] == pytest.approx(1.5)  # behind it
    hall = Lidar(Arena(20.0, 20.0, 0.05)).ranges(Pose(10.0, 10.0, 0.3), ())
    assert hall.tolist() == [math.inf] * RAYS


def test_every_ray_agrees_with_small_steps_along_it():
    lidar = Lidar(ARENA)
    at = Pose(1.2, 0.7, 0.4)
    hulls = [(1.6, 1.3, 0.1)]
    for k, found in enumerate(lidar.ranges(at, hulls)):
        angle = at.theta - math.pi + math.tau / RAYS * k
        metres = 0.0
        while True:
            x, y = at.x + metres * math.cos(angle), at.y + metres * math.sin(angle)
            if ARENA.clearance(x, y) <= 0.0 or math.dist((x, y), hulls[0][:2]) <= 0.1:
                break
            metres += 0.001
        assert found == pytest.approx(metres, abs=0.002)


class Node:
    """Where publishers come from; what they publish is not asked for."""

    def create_publisher(self, *_words):
        return None


def test_odometry_begins_at_nought_and_the_frames_lead_to_the_true_pose():
    shown = _Shown(Node(), 4, 0)
    shown.roll(7.0, 9.0)
    assert shown.place == Pose(0.0, 0.0, 0.0)
    shown.roll(7.2, 9.2)
    assert shown.place.x == pytest.approx(0.2)
    shown.roll(7.2 - 0.05 * math.pi / 2, 9.2 + 0.05 * math.pi / 2)  # wheels 0.1 m apart, a quarter to the left
    shown.roll(7.5 - 0.05 * math.pi / 2, 9.5 + 0.05 * math.pi / 2)
    assert tuple(shown.place) == pytest.approx((0.2, 0.3, math.pi / 2))
    first, second = _transforms(1_500_000_000, shown, Pose(2.0, 1.0, 0.5))
    assert (first.header.frame_id, first.child_frame_id) == ("map", "robot_4/odom")
    assert (second.header.frame_id, second.child_frame_id) == ("robot_4/odom", "robot_4/base_link")
    assert (first.header.stamp.sec, first.header.stamp.nanosec) == (1, 500_000_000)
    origin, own = (
        (each.transform.translation.x, each.transform.translation.y, 2 * math.atan2(q.z, q.w))
        for each, q in ((each, each.transform.rotation) for each in (first, second))
    )
    x, y, theta = origin
    cos, sin = math.cos(theta), math.sin(theta)
    there = (x + cos * own[0] - sin * own[1], y + sin * own[0] + cos * own[1], theta + own[2])
    assert there == pytest.approx((2.0, 1.0, 0.5))


def test_the_map_has_the_cells_of_the_floor_and_markers_its_areas():
    message = _map_message(ARENA)
    assert (message.info.width, message.info.height) == (60, 40)
    at = {(x, y): message.data[y * 60 + x] for x in range(60) for y in range(40)}
    assert (at[45, 20], at[10, 30], at[20, 20]) == (100, 100, 0)
    arena = Arena(3.0, 2.0, 0.05, areas=(Area("exit", (Point(1.0, 1.0),), box=(0.5, 0.5, 1.5, 1.5)),))
    markers = list(_markers(scene(arena, ())["entities"]))
    mine = [each for each in markers if each.ns == "area/exit"]
    assert len({(each.ns, each.id) for each in markers}) == len(markers)
    assert {each.type for each in mine} == {
        ros_view.Marker.LINE_STRIP,
        ros_view.Marker.CYLINDER,
        ros_view.Marker.TEXT_VIEW_FACING,
    }
    (outline,) = (each for each in mine if each.type == ros_view.Marker.LINE_STRIP)
    assert [(each.x, each.y) for each in outline.points] == [(0.5, 0.5), (1.5, 0.5), (1.5, 1.5), (0.5, 1.5), (0.5, 0.5)]
    assert [each.text for each in mine if each.text] == ["exit"]
