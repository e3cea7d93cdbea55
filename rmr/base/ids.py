"""Robots' ids as people write them: ``4``, ``2-3``, ``0-5,9``."""

import re
from collections.abc import Sequence
from typing import Final

from rmr.base.printable import shortened
from rmr.base.values import ROBOT_ID_MAX

_RANGE: Final = re.compile(r"([0-9]{1,6})(?:-([0-9]{1,6}))?", re.ASCII)


def shown(text: str) -> str:
    """Return `text` as a message quotes it."""
    return repr(shortened(text, 40))


def spelled(ids: Sequence[int]) -> str:
    """Return ascending `ids` in the form that `listed` reads."""
    spans: list[list[int]] = []
    for robot in ids:
        if spans and robot == spans[-1][-1] + 1:
            spans[-1] = [spans[-1][0], robot]
        else:
            spans.append([robot])
    return ",".join("-".join(map(str, span)) for span in spans)


def named(ids: Sequence[int]) -> str:
    """Return ascending `ids` for use in a sentence: ``robot 1``, ``robots 1-3``."""
    return f"robot{'s' if len(ids) > 1 else ''} {spelled(ids)}"


def listed(text: str) -> tuple[int, ...]:
    """Return the ids of ``2-3`` or ``0-5,9``, ascending. Raises ValueError, which says what to write."""
    return tuple(sorted(in_order(text)))


def in_order(text: str) -> list[int]:
    """Return the ids as `listed` does, but in the order in which they are written."""
    ids: dict[int, None] = {}
    for part in text.split(","):
        for robot in _span(part.strip()):
            if robot in ids:
                raise ValueError(f"robot {robot} is listed twice")
            ids[robot] = None
    return list(ids)


def _span(part: str) -> range:
    match = _RANGE.fullmatch(part)
    if match is None:
        raise ValueError(f"{shown(part)} is no id and no range of ids; write ids such as 4, 2-3 or 0-5,9")
    first = int(match[1])
    last = first if match[2] is None else int(match[2])
    if max(first, last) > ROBOT_ID_MAX:
        raise ValueError(f"there is no robot {max(first, last)}: ids are 0 to {ROBOT_ID_MAX}")
    if last < first:
        raise ValueError(f"the range {part} ends before it begins; write {last}-{first}")
    return range(first, last + 1)
