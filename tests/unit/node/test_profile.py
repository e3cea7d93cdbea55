"""The behaviour by size of the group: periods grow with it, and a crowd begins at one size."""

from rmr.node.profile import CROWD_FROM, profile_of

PERIODS = ("moving", "parked", "waiting", "eager", "first_spread", "change_spread")
DIFFERENCES = ("promises_to_stay", "listens_first", "late_goes_next", "finishes_in_order", "overhears_passing")


def test_no_period_falls_with_the_number_of_robots() -> None:
    for name in PERIODS:
        periods = [getattr(profile_of(robots), name) for robots in range(1, 101)]
        assert periods == sorted(periods), name


def test_what_a_crowd_does_differently_begins_at_one_size() -> None:
    few, many = profile_of(CROWD_FROM - 1), profile_of(CROWD_FROM)
    assert all(getattr(few, name) is not getattr(many, name) for name in DIFFERENCES)
    assert all(getattr(profile_of(1), name) is getattr(few, name) for name in DIFFERENCES)
    assert all(getattr(profile_of(1000), name) is getattr(many, name) for name in DIFFERENCES)


def test_beside_few_that_drive_a_robot_of_a_crowd_speaks_as_often_as_one_of_few() -> None:
    assert profile_of(50).moving_beside(3) == profile_of(6).moving < profile_of(50).moving
    assert profile_of(50).moving_beside(49) == profile_of(50).moving
