"""The law of ways alone keeps robots that drive apart, and each part of it is needed (`ways_campaign`)."""

import pytest
from ways_campaign import PARTS, overlapping

LAST = 30


def test_no_hulls_of_robots_that_drive_overlap() -> None:
    assert overlapping(1, LAST) == []


@pytest.mark.parametrize("part", PARTS)
def test_each_part_of_the_law_is_needed(part: str) -> None:
    assert overlapping(1, LAST, part)
