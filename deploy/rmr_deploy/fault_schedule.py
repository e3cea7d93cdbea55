"""The faults of robots in a lab file, as `rmr up` performs them on processes when their time has come.

`rmr sim` performs them at the exact instant; here the launcher does so when it hears that lab time has passed it, up
to 0.2 s later. Faults that find a robot dead, or a restart that finds it alive, have no effect, as in the simulator.
The radio's disturbances are the world's affair.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from rmr.base.time import Duration, Instant, in_seconds
from rmr_world.faults import fault_entry, fault_line
from rmr_world.lab import Fault, Kill, Outage, Restart, Slow, Stall


class FaultSchedule:
    """The faults of a lab that are still to come."""

    def __init__(self, faults: Iterable[Fault], perform: Callable[[Mapping[str, Any]], str]) -> None:
        """`perform` carries out a request to the launcher and returns why it is refused."""
        self._perform = perform
        numbered = sorted((_begin(fault), i, fault) for i, fault in enumerate(faults))
        self._due = [(begin, fault) for begin, _, fault in numbered]

    def will_restart(self, robot: int) -> bool:
        """Whether a restart of `robot` is still to come."""
        return any(isinstance(fault, Restart) and fault.robot == robot for _, fault in self._due)

    def perform_due(self, now: Instant) -> list[tuple[str, dict[str, Any]]]:
        """Perform what is due; return a sentence about each fault, and its entry."""
        told = []
        while self._due and self._due[0][0] <= now:
            _, fault = self._due.pop(0)
            entry = fault_entry(fault)
            refused = self._perform(_request(fault, now))
            told.append((f"the lab file: {fault_line(entry)}{': ' if refused else ''}{refused}", entry))
        return told


def _begin(fault: Fault) -> Instant:
    return fault.at if isinstance(fault, Kill | Restart) else fault.start


def _request(fault: Fault, now: Instant) -> dict[str, Any]:
    """Return a fault that begins `now` as a request to the launcher."""
    match fault:
        case Kill(robot=robot):
            return {"do": "crash", "robot": robot}
        case Restart(robot=robot):
            return {"do": "start", "robot": robot}
        case Stall(end=end, robot=robot):
            return {"do": "stall", "robot": robot, "for_s": _left_s(end - now)}
        case Slow(end=end, robot=robot, every=every):
            return {"do": "slow", "robot": robot, "for_s": _left_s(end - now), "every_s": in_seconds(every)}
        case Outage(end=end, robot=robot):
            return {"do": "outage", "robot": robot, "for_s": _left_s(end - now)}


def _left_s(left: Duration) -> float:
    return max(0.001, in_seconds(left))
