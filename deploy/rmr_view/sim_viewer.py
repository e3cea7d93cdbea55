"""What `rmr sim LAB --view` does beside the run itself: the server, its address, and the wait at the end."""

import argparse
import signal
import socket
import sys
import time
from contextlib import suppress
from typing import Any

from rmr.entry import ExitCode
from rmr.record.record_writer import RecordWriter
from rmr_sim.sim_command import perform as simulate
from rmr_sim.simulation import Simulation
from rmr_view.access_guard import new_token
from rmr_view.page_server import PageServer, PageServerError, bind
from rmr_view.run_pacer import RunPacer
from rmr_view.run_source import program_of
from rmr_view.simulated_source import SimulatedSource


class SimViewer:
    """Shows one simulated run."""

    def __init__(self, listener: socket.socket, speed: float, control: bool) -> None:
        """`listener` is the socket of the page; `control` says whether it may add faults."""
        self._listener = listener
        self._control = control
        self._pacer = RunPacer(speed)
        self._source: SimulatedSource | None = None
        self._server: PageServer | None = None
        self._interrupted = False

    def attach(self, simulation: Simulation, writer: RecordWriter | None) -> None:
        """Start the server and print its address."""
        program = program_of(simulation.lab.program)
        self._source = SimulatedSource(simulation, self._pacer, program, self._control, writer)
        self._server = PageServer(self._source, self._listener, new_token())
        self._server.start()
        print(f"the page: {self._server.address}", file=sys.stderr, flush=True)

    def interrupt(self) -> None:
        """Let a paused run go on to its end."""
        self._interrupted = True
        self._pacer.stop()

    def over(self, report: dict[str, Any]) -> None:
        """Pass on the report."""
        if self._source is not None:
            self._source.over(report)

    def wait(self) -> None:
        """Serve what was until Ctrl-C, unless that has come already."""
        if self._server is None or self._interrupted:
            return
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        with suppress(KeyboardInterrupt):
            print("the run is over; the page stays until Ctrl-C", file=sys.stderr, flush=True)
            while True:
                time.sleep(3600)

    def close(self) -> None:
        """End the server."""
        if self._server is not None:
            self._server.stop()
        self._listener.close()


def perform(arguments: argparse.Namespace) -> int:
    """Run the lab and show it; return the exit code of `rmr sim`."""
    try:
        listener = bind(arguments.port or 0)
    except PageServerError as error:
        print(f"rmr sim: {error}", file=sys.stderr)
        return ExitCode.FAILED
    viewer = SimViewer(listener, arguments.speed or 1.0, arguments.control)
    try:
        code = simulate(arguments, viewer)
        sys.stdout.flush()
        viewer.wait()
        return code
    finally:
        viewer.close()
