"""Which of an area's places a robot takes where others have taken some, or stand on them."""

from rmr.base.arena import RobotShape
from rmr.base.geometry import Point
from rmr.node.driver import nearest_free

RADIUS = RobotShape().radius
PLACES = tuple(Point(1.0, 0.3 * k) for k in range(4))


def free(first: int, claimed: tuple[Point, ...] = (), stood: tuple[Point, ...] = ()) -> int | None:
    place = nearest_free(PLACES, first, claimed, RADIUS, stood, 2.0 * RADIUS + 0.005)
    return None if place is None else PLACES.index(place)


def test_a_robot_takes_its_own_place_if_nobody_else_has():
    assert [free(k) for k in range(4)] == [0, 1, 2, 3]
    assert free(1, claimed=(PLACES[0], PLACES[2])) == 1


def test_a_place_that_was_taken_or_is_stood_on_is_left_for_the_next_one_that_is_free_the_first_after_the_last():
    assert free(1, claimed=(PLACES[1],)) == 2
    assert free(2, claimed=(PLACES[2],), stood=(PLACES[3],)) == 0


def test_a_robot_that_stands_beside_a_place_takes_it_only_if_there_is_no_room():
    assert free(1, stood=(Point(1.0 + 2.0 * RADIUS, 0.3),)) == 2
    assert free(1, stood=(Point(1.01 + 2.0 * RADIUS, 0.3),)) == 1


def test_none_may_be_free():
    assert free(3, claimed=PLACES) is None
