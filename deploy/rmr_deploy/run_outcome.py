"""What came of a run of processes: how it ended, and which processes ended before their time.

Whether one died or was stopped is decided here alone: it was stopped if that was asked for, or if it ended in good
order, as at SIGTERM. What then has to be said of it, in words and colours, follows from its fate (`rmr_world.quorum`).
"""

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from rmr.entry import ExitCode
from rmr_world.quorum import DIED, STOPPED, Fate

Life = Literal["stop", "die", "restart"]
"""A process was stopped in order, died without an order, or was started again by policy or by hand."""


class Befell(NamedTuple):
    """What befell the robots of one host."""

    faults: list[dict[str, Any]]
    lives: list[dict[str, Any]]
    """As `RunOutcome` has both."""
    died: dict[str, int]


def read_befell(octets: bytes) -> Befell:
    """Return what another host has told as `RunOutcome.befell`; what cannot stand in a report is left out."""
    try:
        faults, lives, died = json.loads(octets)
        times = [[one for one in part if _is_entry(one)] for part in (faults, lives)]
        codes = {str(name): code for name, code in died.items() if type(code) is int}
    except (ValueError, TypeError, AttributeError, RecursionError):
        return Befell([], [], {})
    return Befell(times[0], times[1], codes)


def _is_entry(entry: Any) -> bool:
    if not isinstance(entry, dict) or not entry.keys() & {"at", "from"} or ("to" in entry and "from" not in entry):
        return False
    return all(isinstance(entry.get(key, 0.0), int | float) for key in ("at", "from", "to"))


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """What other hosts of a lab have of a run."""

    report: str = ""
    """Where the report is, in words; empty where this host has not taken part."""
    folders: dict[str, list[str]] = field(default_factory=dict)
    """Run folders by host, as they told."""
    befell: list[Befell] = field(default_factory=list)
    """What befell the robots of each; none for a host without the world."""


@dataclass(slots=True)
class RunOutcome:
    """What came of a run."""

    finished: bool = False
    """The robots of the lab's quorum held the finish fact (or the lab asks for none and its duration has passed)."""
    reason: str = ""
    """Why the run ended, for people."""
    interrupted: bool = False
    hurried: bool = False
    """Interrupted twice: everything was killed at once."""
    invalid: bool = False
    """A process refused the program or the lab."""
    ended: dict[str, int] = field(default_factory=dict)
    """Exit codes of the processes that ended before their time, by name."""
    stopped: set[str] = field(default_factory=set)
    """Those of them that did so as they were asked to, or in good order."""
    excused: set[str] = field(default_factory=set)
    """Those of them that ended on request, or that the restart policy has replaced: the exit code is not for them."""
    absent: dict[int, Fate] = field(default_factory=dict)
    """Robots whose process had ended when the run was over, and had not been started again, ascending."""
    ready_s: float | None = None
    """Wall time from the start of the first process until all were ready."""
    wall_s: float = 0.0
    """Wall time of the whole run."""
    faults: list[dict[str, Any]] = field(default_factory=list)
    """Faults of processes on request, in the form of a lab file's entries."""
    lives: list[dict[str, Any]] = field(default_factory=list)
    """Ends and starts of processes that are no faults on request: see `note_lives`."""
    world_restarts: int = 0
    """How often the world was started again."""
    loads: list[dict[str, Any]] = field(default_factory=list)
    """What became of the loads of the lab file that have begun, as entries of the report."""
    elsewhere: Elsewhere = field(default_factory=Elsewhere)
    """What the other hosts of the lab have, if there are others."""
    report_error: str | None = None
    """Why the report could not be written."""
    recording: list[str] = field(default_factory=list)
    """What is missing in the recording, in sentences."""

    def note_end(self, name: str, exit_code: int, *, asked: bool) -> None:
        """Note that the process `name` has ended before its time, perhaps because it was `asked` to stop."""
        self.ended[name] = exit_code
        self.invalid |= exit_code == ExitCode.INVALID
        if asked or exit_code == ExitCode.OK:
            self.stopped.add(name)

    def note_lives(self, word: Life, robots: Iterable[int | str], at_s: float | None) -> None:
        """Note, for the recording, what befell the processes of `robots`, or the world, at a lab time.

        None: before it began.
        """
        self.lives += [{"at": round(at_s or 0.0, 3), word: robot} for robot in robots]

    def befell(self) -> bytes:
        """Return what is told to other hosts: the newest 300 of each, which fit a message."""
        return json.dumps(Befell(self.faults[-300:], self.lives[-300:], dict(list(self.died.items())[-300:]))).encode()

    def fate(self, name: str) -> Fate:
        """Return what became of the process `name`, which has ended."""
        return STOPPED if name in self.stopped else DIED

    @property
    def died(self) -> dict[str, int]:
        """Exit codes of the processes that died, by name."""
        return {name: code for name, code in self.ended.items() if self.fate(name) == DIED}
