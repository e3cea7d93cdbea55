"""What came of a run of processes: how it ended, and which processes ended before their time."""

from dataclasses import dataclass, field
from typing import Any


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
    died: dict[str, int] = field(default_factory=dict)
    """Exit codes of the processes that ended before their time, by name."""
    excused: set[str] = field(default_factory=set)
    """Those of them that ended on request, or that the restart policy has replaced: the exit code is not for them."""
    dead: list[int] = field(default_factory=list)
    """Robots whose process had ended when the run was over, and had not been started again."""
    ready_s: float | None = None
    """Wall time from the start of the first process until all were ready."""
    wall_s: float = 0.0
    """Wall time of the whole run."""
    faults: list[dict[str, Any]] = field(default_factory=list)
    """Faults of processes on request, in the form of a lab file's entries."""
    loads: list[dict[str, Any]] = field(default_factory=list)
    """What became of the loads of the lab file that have begun, as entries of the report."""
    report_error: str | None = None
    """Why the report could not be written."""
    recording: list[str] = field(default_factory=list)
    """What is missing in the recording, in sentences."""
