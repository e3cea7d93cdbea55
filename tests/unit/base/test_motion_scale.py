"""The derived quantities of motion: what was measured at the reference robot, else what radius and speed demand."""

from dataclasses import asdict

import pytest

from rmr.base.arena import BRAKE, RobotShape
from rmr.base.motion_scale import LAG_S, REACTION_BRAKE, least_view_depth, scale_of, view_depth, way_to_stand
from rmr.base.time import milliseconds
from rmr.node.profile import profile_of

RADII = (0.05, 0.07, 0.15, 0.3, 0.5)
SPEEDS = (0.1, 0.2, 0.4, 0.7, 1.0, 2.0)
SHAPES = [RobotShape(radius, speed) for radius in RADII for speed in SPEEDS]


def test_the_reference_robot_has_the_margins_that_were_measured_to_the_bit():
    assert asdict(scale_of(RobotShape())) == {
        "radius": 0.07,
        "speed": 0.2,
        "size": 1.0,
        "pace": 1.0,
        "tempo": 1.0,
        "astray_m": 0.0,
        "stop_s": 0.4,
        "conflict_gap_m": 0.04,
        "near_m": 0.5,
        "update": milliseconds(200),
        "unwatched": milliseconds(50),
        "start_s": 0.15,
        "headway_m": 0.07,
        "ramp": milliseconds(500),
        "step_s": 0.25,
        "steps": 17,
    }
    assert view_depth(0.07, 0.2) == 0.25


@pytest.mark.parametrize(
    ("radius", "speed", "depth", "near", "tempo", "update_ms"),
    [
        (0.05, 0.1, 0.25, 0.5, 1.43, 200),
        (0.07, 0.5, 0.70, 1.22, 1.0, 80),
        (0.15, 0.5, 0.78, 1.38, 1.0, 80),
        (0.3, 1.0, 2.19, 3.39, 1.0, 40),
        (0.5, 0.1, 0.68, 1.36, 14.29, 200),
        (0.5, 2.0, 6.77, 9.07, 1.0, 20),
    ],
)
def test_what_follows_from_some_shapes(radius, speed, depth, near, tempo, update_ms):
    scale = scale_of(RobotShape(radius, speed))
    assert view_depth(radius, speed) == pytest.approx(depth, abs=0.005)
    assert scale.near_m == pytest.approx(near, abs=0.005)
    assert scale.tempo == pytest.approx(tempo, abs=0.005)
    assert scale.update == milliseconds(update_ms)


@pytest.mark.parametrize("shape", SHAPES)
def test_what_is_seen_heard_and_predicted_is_enough_to_stop(shape):
    scale = scale_of(shape)
    two_ways = way_to_stand(shape.speed) + way_to_stand(shape.speed, REACTION_BRAKE)
    assert view_depth(shape.radius, shape.speed) > max(shape.radius + two_ways, least_view_depth(*shape_of(shape)))
    assert scale.near_m > 2.0 * shape.radius + two_ways + 2.0 * shape.speed * scale.update / 1e9
    assert scale.stop_s > 0.99 * (LAG_S + shape.speed / REACTION_BRAKE)
    assert scale.step_s * shape.speed < shape.radius
    assert scale.horizon_s > LAG_S + shape.speed / BRAKE


def shape_of(shape: RobotShape) -> tuple[float, float]:
    return shape.radius, shape.speed


def test_faster_robots_say_hello_as_often_on_the_same_way_as_the_channel_bears():
    assert [profile_of(4, pace).moving for pace in (1.0, 2.0, 10.0)] == [milliseconds(t) for t in (200, 100, 80)]
    assert profile_of(20, 10.0).moving == milliseconds(160)
    assert profile_of(20, 10.0).moving_beside(5) == milliseconds(80)
