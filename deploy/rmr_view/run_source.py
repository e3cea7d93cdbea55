"""What the page's server shows, as one interface: a simulated run, a run of processes, or a recording.

Every source answers the same questions. Those that take long are coroutines, which work in a thread or in another
process, so that the server's loop never waits for them. All times are seconds of lab time.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from rmr_view.run_history import RunHistory

ENTRIES_MAX = 5_000
"""Entries of one answer at most."""
OCTETS_MAX = 1 << 20
"""Octets of a source that are shown at most."""


class RequestRefusedError(Exception):
    """A request that cannot be granted: one sentence for a person, and the HTTP status."""

    def __init__(self, message: str, status: int = 400) -> None:
        super().__init__(message)
        self.status = status


class WhyOptions(NamedTuple):
    """How a fact is to be explained, as `rmr why` has it."""

    absent: bool = False
    """Why it does not hold."""
    depth: int = 3
    more: str | None = None
    """The number at which an answer was cut."""


class RunClock(NamedTuple):
    """Where lab time stands."""

    t: float
    end_s: float
    """End of what there is to see: the same as `t` while the run is live."""
    running: bool
    speed: float | None
    """Lab time over wall time of a simulated run; None: it cannot be chosen."""

    def message(self) -> dict[str, Any]:
        """Return the message for clients."""
        return {"type": "clock", "t": round(self.t, 3), "end_s": round(self.end_s, 3), **self._state()}

    def _state(self) -> dict[str, Any]:
        return {"running": self.running, "speed": self.speed}


class RunSource(Protocol):
    """One run."""

    history: RunHistory
    """What is kept of it for the map, the timeline and the clients that follow."""

    @property
    def clock(self) -> RunClock:
        """Where lab time stands."""

    @property
    def live(self) -> bool:
        """Whether the run goes on."""

    @property
    def report(self) -> Mapping[str, Any] | None:
        """The report, once the run is over and has one."""

    def about(self) -> dict[str, Any]:
        """Return the answer to `/api/run`."""

    async def start(self) -> None:
        """Begin, on the server's loop."""

    async def refresh(self) -> None:
        """Take in what is new; called several times a second, never twice at once."""

    async def entries(self, kind: str, begin: float, end: float) -> list[dict[str, Any]]:
        """Return the entries of `kind` (trace, frames or log) in [begin, end], the oldest first.

        There are `ENTRIES_MAX` + 1 at most: one more than fits an answer shows that there are more.
        """

    async def robot(self, robot: int, t: float | None) -> dict[str, Any]:
        """Return what a robot knew and did at `t` (None: now). Raises RequestRefusedError."""

    async def why(self, robot: int, fact: str, t: float | None, options: WhyOptions) -> dict[str, Any]:
        """Return the explanation of a fact. Raises RequestRefusedError."""

    async def missed(self, robot: int) -> dict[str, Any]:
        """Return what the time of each deadline that `robot` missed went into. Raises RequestRefusedError."""

    async def step(self, robot: int, at: int, commands: str) -> dict[str, Any]:
        """Carry out commands of `rmr replay --step`, one a line, from stop `at`. Raises RequestRefusedError."""

    async def control(self, order: Mapping[str, Any]) -> dict[str, Any]:
        """Carry out a checked order of `rmr_view.control_order`. Raises RequestRefusedError."""

    async def close(self) -> None:
        """Let go of files, threads and processes."""


def program_of(path: Path) -> dict[str, str | None]:
    """Return name and source of the program in `path`; the source is None for byte-code, or if it cannot be read."""
    source = None
    if path.suffix != ".rbc":
        try:
            with path.open("rb") as file:
                source = file.read(OCTETS_MAX).decode(errors="replace")
        except OSError:
            source = None
    return {"name": path.name, "source": source}
