"""Runs with their page, in this process: what `rmr sim LAB --view` and `rmr view RECORDING` start."""

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rmr.node.trace import TraceLevel
from rmr_sim.run_setup import Options, load, report_of
from rmr_view.page_server import PageServer, bind
from rmr_view.recorded_source import RecordedSource
from rmr_view.run_pacer import RunPacer
from rmr_view.simulated_source import SimulatedSource

LABS = Path(__file__).parents[2] / "deploy" / "labs"
FASTEST = 100.0
TOKEN = "a-token-of-tests"


class ShownRun:
    """One run; `run.server` can be stopped and started again on its port."""

    def __init__(self, lab: str = "corridor", *, speed: float = 1.0, control: bool = False, **options: Any) -> None:
        """`speed` is that of lab time; `FASTEST` runs to the end at once."""
        loaded = load(LABS / lab, Options(**options))
        self.simulation = loaded.simulation(None, TraceLevel.FACTS)
        path = Path(loaded.lab.program)
        program: dict[str, str | None] = {"name": path.name, "source": path.read_text()}
        self.pacer = RunPacer(speed)
        if speed >= FASTEST:
            self.pacer.stop()
        self.source = SimulatedSource(self.simulation, self.pacer, program, control, None)
        self.server = PageServer(self.source, bind(0), TOKEN)
        self.port = self.server.port
        self.server.start()
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()
        if speed >= FASTEST:
            self.thread.join()

    def _run(self) -> None:
        finished = self.simulation.run()
        self.source.over(report_of(self.simulation, finished))

    @property
    def address(self) -> str:
        """The page's address with its token."""
        return self.server.address

    def restart_server(self) -> None:
        """Serve again, on the same port, after `server.stop()`."""
        self.server = PageServer(self.source, bind(self.port), TOKEN)
        self.server.start()

    def close(self) -> None:
        """End run and server."""
        self.simulation.stop()
        self.pacer.stop()
        self.thread.join()
        self.server.stop()


class ShownRecording:
    """A recording."""

    def __init__(self, path: Path) -> None:
        self.source = RecordedSource(path)
        self.server = PageServer(self.source, bind(0), None)
        self.server.start()

    @property
    def address(self) -> str:
        """The page's address."""
        return self.server.address

    def close(self) -> None:
        """End the server."""
        self.server.stop()


def until(true: Callable[[], Any], what: str, seconds: float = 30.0) -> Any:
    """Wait until `true()` is, and return it; `what` names it where that takes too long."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        found = true()
        if found:
            return found
        time.sleep(0.02)
    raise AssertionError(f"not within {seconds:g} s: {what}")
