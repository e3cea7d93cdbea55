"""The key space: one table, valid in zenoh, and readable back."""

import pytest
import zenoh

from rmr.bus.keys import ANY_LAB, ROBOT_ROLE, WORLD, Keys, last_id
from rmr.radio.cells import CELL_MAX

KEYS = Keys("corridor-2.1_b")


def all_keys(keys):
    return [
        keys.radio(0, 0),
        keys.radio(-1, 2),
        keys.radio(CELL_MAX, -CELL_MAX),
        keys.call(4),
        keys.sense(4),
        keys.act(65533),
        keys.acts,
        keys.clock,
        keys.map(4),
        keys.disturbances,
        keys.truth,
        keys.status(4),
        keys.status(WORLD),
        keys.statuses,
        keys.stop(WORLD),
        keys.alive(ROBOT_ROLE, 4),
        keys.alive(ROBOT_ROLE, "*"),
    ]


@pytest.mark.parametrize("key", all_keys(KEYS))
def test_every_key_is_a_canonical_zenoh_key(key):
    assert str(zenoh.KeyExpr(key)) == key
    assert key.startswith("rmr/corridor-2.1_b/")


def test_no_two_keys_are_the_same():
    keys = all_keys(KEYS)
    assert len(set(keys)) == len(keys)


def test_any_lab_matches_the_keys_of_every_lab():
    assert zenoh.KeyExpr(Keys(ANY_LAB).map(4)).intersects(zenoh.KeyExpr(KEYS.map(4)))


def test_one_subscription_matches_all_wheel_commands_and_all_statuses():
    assert zenoh.KeyExpr(KEYS.acts).includes(zenoh.KeyExpr(KEYS.act(3)))
    assert zenoh.KeyExpr(KEYS.statuses).includes(zenoh.KeyExpr(KEYS.status(WORLD)))
    assert zenoh.KeyExpr(KEYS.statuses).includes(zenoh.KeyExpr(KEYS.status(3)))


@pytest.mark.parametrize("name", ["", "a/b", "a*", "$x", "a b", "#", "?", "-x", ".", "x" * 65, "ä"])
def test_a_lab_whose_name_would_break_a_key_is_refused(name):
    with pytest.raises(ValueError, match="cannot name a lab"):
        Keys(name)


def test_the_robot_of_a_liveliness_key_is_read_back():
    assert last_id(KEYS.alive(ROBOT_ROLE, 17)) == 17
    assert last_id("rmr/x/alive/robot/*") is None
    assert last_id("rmr/x/alive/robot/²") is None
