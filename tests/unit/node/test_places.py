"""Which of an area's places a robot takes where others have taken some, or stand on them."""

from rmr.base.arena import Area, Arena, FloorPassage, Polygon, RobotShape
from rmr.base.geometry import Point
from rmr.node.area_places import in_order, nearest_free

RADIUS = RobotShape().radius
PLACES = tuple(Point(1.0, 0.3 * k) for k in range(4))


AREA = Area("line", PLACES, slotted=True)
OPEN = Arena(3.0, 2.0, 0.05, areas=(AREA,))
WEST, EAST = (Area(name, (Point(x, 1.0),)) for name, x in (("west", 1.3), ("east", 1.7)))
WALLS = tuple(
    Polygon((Point(1.4, low), Point(1.6, low), Point(1.6, high), Point(1.4, high)))
    for low, high in ((0.0, 0.85), (1.15, 2.0))
)
TWO_ROOMS = Arena(3.0, 2.0, 0.05, obstacles=WALLS, passages=(FloorPassage("door", (WEST, EAST)),))
IN_BOTH = Area("store", (Point(2.5, 0.5), Point(0.5, 0.5), Point(2.5, 1.5), Point(0.5, 1.5)), slotted=True)
"""Its first and third place are in the east, the others in the west, beyond the door."""


def free(first: int, claimed: tuple[Point, ...] = (), stood: tuple[Point, ...] = ()) -> int:
    places = in_order(OPEN, AREA, first)
    return PLACES.index(nearest_free(places, claimed, RADIUS, stood, 2.0 * RADIUS + 0.005))


def test_a_robot_takes_its_own_place_if_nobody_else_has():
    assert [free(k) for k in range(4)] == [0, 1, 2, 3]
    assert free(1, claimed=(PLACES[0], PLACES[2])) == 1


def test_a_place_that_was_taken_or_is_stood_on_is_left_for_the_next_one_that_is_free_the_first_after_the_last():
    assert free(1, claimed=(PLACES[1],)) == 2
    assert free(2, claimed=(PLACES[2],), stood=(PLACES[3],)) == 0


def test_a_robot_that_stands_beside_a_place_takes_it_only_if_there_is_no_room():
    assert free(1, stood=(Point(1.0 + 2.0 * RADIUS, 0.3),)) == 2
    assert free(1, stood=(Point(1.01 + 2.0 * RADIUS, 0.3),)) == 1


def test_where_none_is_free_it_keeps_its_own():
    assert free(3, claimed=PLACES) == 3


def test_places_beyond_a_passage_come_after_those_in_the_room_of_the_first_one():
    first, beyond, third, too = IN_BOTH.places
    assert in_order(TWO_ROOMS, IN_BOTH, 0) == (first, third, beyond, too)
    assert in_order(TWO_ROOMS, IN_BOTH, 1) == (third, first, beyond, too)
    assert in_order(TWO_ROOMS, IN_BOTH, 2) == in_order(TWO_ROOMS, IN_BOTH, 0)


def test_without_a_passage_places_are_taken_in_the_order_of_the_lab_file():
    assert in_order(OPEN, IN_BOTH, 1) == (*IN_BOTH.places[1:], IN_BOTH.places[0])
