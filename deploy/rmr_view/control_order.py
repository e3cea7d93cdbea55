"""Orders of the page: what a client may ask for, checked before anything is done.

{"do": "pause"}                                      a simulated run: stop lab time
{"do": "resume"}                                     let it go on
{"do": "step"}                                       advance by one tick of 1/60 s, and pause
{"do": "speed", "speed": 2.0}                        lab time over wall time, 0.1 to 100
{"do": "partition", "groups": [[1, 2], [3]], "for_s": 5}
{"do": "loss", "loss": 0.5, "for_s": 5}              of all frames; without `for_s` to the end of the run
{"do": "clear"}                                      end what has been added
{"do": "kill", "robot": 3}                           the robot's process
{"do": "restart", "robot": 3}
{"do": "stall", "robot": 3, "for_s": 2}
"""

from collections.abc import Callable, Collection, Mapping
from typing import Any

from rmr_view.run_source import RequestRefusedError

SPEED_MIN = 0.1
SPEED_MAX = 100.0

STEERING = frozenset({"pause", "resume", "step", "speed"})
"""Orders about the time of a simulated run; all others are faults."""
AT_ROBOTS = frozenset({"kill", "restart", "stall"})
"""Orders about the process of a robot."""

Check = Callable[[Any, Collection[int]], Any]
"""Returns a field's value, given the robots of the run. Raises ValueError, which says what to write."""


def _number(least: float, most: float) -> Check:
    def check(value: Any, _robots: Collection[int]) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
            raise ValueError(f"a number from {least:g} to {most:g}")
        return float(value)

    return check


def _robot(value: Any, robots: Collection[int]) -> int:
    if type(value) is not int or value not in robots:
        raise ValueError("the id of a robot of this run")
    return value


def _groups(value: Any, robots: Collection[int]) -> list[list[int]]:
    wanted = "two groups of robots or more, such as [[1, 2], [3]], no robot in two of them"
    if not isinstance(value, list) or len(value) < 2 or not all(isinstance(group, list) and group for group in value):
        raise ValueError(wanted)
    named = [_robot(robot, robots) for group in value for robot in group]
    if len(set(named)) != len(named):
        raise ValueError(wanted)
    return value


_FOR_S = _number(0.001, 86_400.0)  # length of a fault: a day at most

ORDERS: dict[str, tuple[dict[str, Check], dict[str, Check]]] = {
    "pause": ({}, {}),
    "resume": ({}, {}),
    "step": ({}, {}),
    "speed": ({"speed": _number(SPEED_MIN, SPEED_MAX)}, {}),
    "partition": ({"groups": _groups}, {"for_s": _FOR_S}),
    "loss": ({"loss": _number(0.0, 1.0)}, {"for_s": _FOR_S}),
    "clear": ({}, {}),
    "kill": ({"robot": _robot}, {}),
    "restart": ({"robot": _robot}, {}),
    "stall": ({"robot": _robot, "for_s": _FOR_S}, {}),
}
"""Order -> the fields that it must have, and those that it may have."""


def checked_order(body: Any, robots: Collection[int]) -> Mapping[str, Any]:
    """Return `body` as an order. Raises RequestRefusedError with what is wrong and what to write."""
    if not isinstance(body, dict) or not isinstance(body.get("do"), str):
        raise RequestRefusedError('an order is a JSON object with the key "do"')
    do = body["do"]
    if do not in ORDERS:
        raise RequestRefusedError(f"unknown order {do!r:.40}; known are {', '.join(ORDERS)}")
    required, optional = ORDERS[do]
    fields = required | optional
    for name in body:
        if name != "do" and name not in fields:
            raise RequestRefusedError(f"{do}: unknown field {name!r:.40}")
    for name in required:
        if name not in body:
            raise RequestRefusedError(f"{do}: the field {name!r} is missing")
    order = {"do": do}
    for name, check in fields.items():
        if name in body:
            try:
                order[name] = check(body[name], robots)
            except ValueError as error:
                raise RequestRefusedError(f"{do}: {name}: write {error}") from None
    return order
