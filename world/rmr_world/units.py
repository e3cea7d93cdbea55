"""Notations of durations, angles and robot ids in lab files and on the command line.

Each function returns the value in the project's unit and raises ValueError with the expected notation.
"""

import math
import re

from rmr.base.ids import in_order
from rmr.base.time import NS_PER_MS, NS_PER_S, Duration
from rmr.base.values import ROBOT_ID_MAX

PASSAGES_MAX = 24
"""Passages of a lab: a robot keeps the groups of all of them (`rmr.coord.timing.GROUPS_MAX`)."""
ROBOTS_MAX = 1000
"""Bound of the robots of one world and one radio, which also stops a typing error in a grid."""

_DURATION = re.compile(r"([0-9]+(?:\.[0-9]+)?)\s*(ms|s|min)")
_UNIT_NS = {"ms": NS_PER_MS, "s": NS_PER_S, "min": 60 * NS_PER_S}
_ANGLE = re.compile(r"(-?[0-9]+(?:\.[0-9]+)?)\s*(deg|rad)")
_DURATION_S_MAX = 1e6
_ANGLE_MAX = 1000.0
"""Greatest angle, radians: with many turns a float loses precision of the heading."""


def duration(value: object) -> Duration:
    """Return nanoseconds for ``120s``, ``500ms``, ``1.5min`` or a number of seconds."""
    if isinstance(value, str) and (match := _DURATION.fullmatch(value)):
        ns = float(match[1]) * _UNIT_NS[match[2]]
    elif isinstance(value, int | float) and not isinstance(value, bool) and value >= 0:
        ns = value * NS_PER_S
    else:
        raise ValueError("should be a duration such as 120s, 500ms or 1.5min")
    if not ns <= _DURATION_S_MAX * NS_PER_S:
        raise ValueError(f"should be at most {_DURATION_S_MAX:.0f} s")
    return round(ns)


def angle(value: object) -> float:
    """Return radians for ``90deg``, ``1.57rad`` or a number of radians."""
    if isinstance(value, str) and (match := _ANGLE.fullmatch(value)):
        radians = math.radians(float(match[1])) if match[2] == "deg" else float(match[1])
    elif isinstance(value, int | float) and not isinstance(value, bool):
        radians = float(value)
    else:
        raise ValueError("should be an angle such as 90deg, or a number of radians")
    if not abs(radians) <= _ANGLE_MAX:
        raise ValueError(f"should be at most {_ANGLE_MAX:.0f} rad")
    return radians


def ids(value: object) -> list[int]:
    """Return the ids of ``2-3``, ``0-5,9``, ``4`` or ``[2, 3]``, in the order in which they are written."""
    if isinstance(value, int) and not isinstance(value, bool):
        value = [value]
    if isinstance(value, str):
        value = in_order(value)
    if not isinstance(value, list) or not value or not all(type(i) is int for i in value):
        raise ValueError("should be ids such as 2-3 or 0-5,9")
    if any(not 0 <= i <= ROBOT_ID_MAX for i in value):
        raise ValueError(f"ids should be from 0 to {ROBOT_ID_MAX}")
    if len(value) > ROBOTS_MAX:
        raise ValueError(f"should be at most {ROBOTS_MAX} robots, not {len(value)}")
    return value


def ids_or_all(value: object) -> list[int]:
    """Return the ids that `ids` returns, or none for ``all``."""
    try:
        return [] if value == "all" else ids(value)
    except ValueError as error:
        raise ValueError(f"{error}, or all") from None
