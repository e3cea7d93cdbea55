"""Directions of turns: by which end of a passage a robot enters and by which it leaves, as one number of four bits.

A passage has one entrance, or up to `ENDS_MAX` ends. Of one with two ends direction 0 enters by the first, 1 by the
second; of one with a single entrance they are those to the east and to the west. Where narrow sections meet there are
three ends or four, and a direction for each pair of them.
"""

from typing import Final

DIRECTION_MAX: Final = 15
"""Greatest direction of a passage: it shares an octet with the phase."""
EXCLUSIVE: Final = DIRECTION_MAX
"""Direction of a passage that excludes every other one, those of the same direction too."""
ENDS_MAX: Final = 4
"""Greatest number of ends of a passage: so many have directions that four bits tell apart."""
_BETWEEN_TWO: Final = 2
"""Directions of two ends; those of more follow them."""


def direction_of(entrance: int, end: int, ends: int) -> int:
    """Return the direction from `entrance` to `end`, numbers of a passage with so many `ends`."""
    if ends <= _BETWEEN_TWO:
        return entrance
    return _BETWEEN_TWO + (ENDS_MAX - 1) * entrance + (end if end < entrance else end - 1)


def ends_of(direction: int) -> tuple[int, int]:
    """Return by which end a robot enters and by which it leaves."""
    if direction < _BETWEEN_TWO:
        return direction, 1 - direction
    entrance, end = divmod(direction - _BETWEEN_TWO, ENDS_MAX - 1)
    return entrance, end if end < entrance else end + 1


def may_follow(a: int, b: int) -> bool:
    """Return whether two passages may follow each other by a headway; else one ends before the other begins.

    They may in one direction, and in two that share the end by which robots enter, or that by which they leave: nobody
    comes towards the other, and no way crosses the other's.
    """
    if EXCLUSIVE in (a, b):
        return False
    if a == b or min(a, b) < _BETWEEN_TWO:
        return a == b
    (entrance, end), (its_entrance, its_end) = ends_of(a), ends_of(b)
    return entrance == its_entrance or end == its_end


def leads_together(a: int, b: int) -> bool:
    """Return whether robots of two directions leave by one end: those that do take the places there in one order."""
    return a == b or EXCLUSIVE in (a, b) or (min(a, b) >= _BETWEEN_TWO and ends_of(a)[1] == ends_of(b)[1])
