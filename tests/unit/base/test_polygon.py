"""The distance of a polygon looks at the edges that face the point alone."""

import pytest

from rmr.base.arena import Polygon
from rmr.base.geometry import Point, point_segment_distance

SHAPES = (((1, 1), (3, 1), (3, 2), (1, 2)), ((0, 0), (4, 1), (2, 3)), ((1, 0), (2, 1), (1, 2), (0, 1)))


@pytest.mark.parametrize("corners", SHAPES)
def test_the_distance_of_a_polygon_is_the_least_of_all_its_edges_and_0_inside(corners):
    polygon = Polygon(tuple(Point(*corner) for corner in corners))
    edges = list(zip(corners, corners[1:] + corners[:1], strict=True))
    for x, y in ((0.1 * i, 0.1 * j) for i in range(-10, 51) for j in range(-10, 41)):
        least = min(point_segment_distance(x, y, *a, *b) for a, b in edges)
        assert polygon.distance(x, y) == pytest.approx(0.0 if polygon.contains(x, y) else least, abs=1e-12)
