"""Claims about named streams of chance."""

from rmr.base.streams import Normals, stream


def test_normal_numbers_are_those_of_gauss():
    normal, rng = Normals(stream("7/robot3/wheels")), stream("7/robot3/wheels")
    assert [normal.draw() for _ in range(1001)] == [rng.gauss(0.0, 1.0) for _ in range(1001)]
