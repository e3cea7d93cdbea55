"""Poses, twists and bodies in view are read like the tuples that they are not."""

import copy
import pickle

import pytest

from rmr.base.geometry import Pose, Twist
from rmr.node.ports import SeenBody


def test_a_pose_is_unpacked_indexed_and_cut_like_a_tuple():
    pose = Pose(1.0, 2.0, 0.5)
    x, y, theta = pose
    assert (x, y, theta) == (pose.x, pose.y, pose.theta) == (1.0, 2.0, 0.5)
    assert (pose[0], pose[1], pose[-1]) == (1.0, 2.0, 0.5)
    assert (pose[:2], pose[1:]) == ((1.0, 2.0), (2.0, 0.5))
    with pytest.raises(IndexError):
        pose[3]


def test_twists_and_bodies_in_view_can_be_unpacked():
    v, w = Twist(0.1, -0.2)
    ahead, left, *velocity = SeenBody(0.3, 0.1, 0.0, 0.2)
    assert (v, w, ahead, left, velocity) == (0.1, -0.2, 0.3, 0.1, [0.0, 0.2])


@pytest.mark.parametrize("value", [Pose(1.0, 2.0, 0.5), Twist(0.1, -0.2), SeenBody(0.3, 0.1, 0.0, 0.2)])
def test_equal_values_are_equal_and_hash_alike_and_print_what_makes_them(value):
    for again in (eval(repr(value)), copy.deepcopy(value), pickle.loads(pickle.dumps(value))):
        assert (again, hash(again)) == (value, hash(value))
    assert value != tuple(value)
