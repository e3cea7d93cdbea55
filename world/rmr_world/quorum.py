"""The quorum of a run: which robots have to hold the finish fact before the run is finished.

    all      every robot of the lab
    living   every robot that is not dead for good; at least one
    N        any N robots at one time

A robot is dead for good if its process has ended and will not be started again. A dead robot holds no fact. For people
it has died, was stopped on purpose or never came: its *fate*.
"""

from collections.abc import Collection, Iterable, Mapping
from typing import Final, Literal, TypeVar

from rmr.base.ids import spelled

ALL: Final[Literal["all"]] = "all"
LIVING: Final[Literal["living"]] = "living"

Quorum = Literal["all", "living"] | int
"""A number is 1 at least."""
QUORUM_SCHEMA: Final = {"anyOf": [{"enum": [ALL, LIVING]}, {"type": "integer", "minimum": 1}]}
"""JSON Schema of a quorum."""

Fate = Literal["died", "stopped", "never came"]
DIED: Final[Literal["died"]] = "died"
STOPPED: Final[Literal["stopped"]] = "stopped"
"""The robot was asked to stop, or its process ended in good order."""
NEVER_CAME: Final[Literal["never came"]] = "never came"
"""Nobody has seen the robot: of one that a launcher has not started itself."""

_Who = TypeVar("_Who")


def quorum_value(value: object) -> Quorum:
    """Return `value` of a lab file as a quorum. Raises ValueError if it is none."""
    if value == ALL:
        return ALL
    if value == LIVING:
        return LIVING
    if isinstance(value, int) and not isinstance(value, bool) and value >= 1:
        return value
    raise ValueError("should be all, living, or the number of robots that have to hold the finish fact, 1 at least")


def is_met(quorum: Quorum, roster: Iterable[int], dead: Collection[int], holding: Collection[int]) -> bool:
    """Return whether the robots `holding` the finish fact suffice; `dead` are those that are dead for good."""
    if isinstance(quorum, int):
        return len(holding) >= quorum
    needed = [robot for robot in roster if quorum == ALL or robot not in dead]
    return bool(needed) and all(robot in holding for robot in needed)


def met_at(quorum: Quorum, finishes: Mapping[int, float | None]) -> float | None:
    """Return when the quorum was met, by the instants from which the robots that count hold the finish fact.

    None if not known: an instant is missing, or there is none.
    """
    known = sorted(at for at in finishes.values() if at is not None)
    if isinstance(quorum, int):
        return known[quorum - 1] if len(known) >= quorum else None
    return known[-1] if known and len(known) == len(finishes) else None


def by_fate(fates: Mapping[_Who, Fate]) -> list[tuple[list[_Who], str]]:
    """Return those of `fates` who died, who were stopped and who never came, each with its verb; nobody is left out."""
    groups: dict[Fate, list[_Who]] = {DIED: [], STOPPED: [], NEVER_CAME: []}
    for who, fate in fates.items():
        groups[fate].append(who)
    verbs = {DIED: "died", STOPPED: "were stopped" if len(groups[STOPPED]) > 1 else "was stopped"}
    return [(whole, verbs.get(fate, fate)) for fate, whole in groups.items() if whole]


def absence(fates: Mapping[int, Fate]) -> str:
    """Return what became of robots in words, such as ``robots 1-2 died, robot 4 was stopped``; empty if of none."""
    return ", ".join(f"robot{'s' if len(who) > 1 else ''} {spelled(who)} {verb}" for who, verb in by_fate(fates))
