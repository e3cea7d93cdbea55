"""The recording that one process of a run writes: when it begins, when it is put into the file, and log lines.

A process knows its run only when it has met its world: the file begins then. It is never replaced: a process that is
started again, or a world that begins another run, takes a name that is free (`robots-4.mcap`, `robots-4.1.mcap`).
"""

import asyncio
import logging
from collections.abc import Callable
from pathlib import Path

from rmr.base.time import Instant
from rmr.record.foxglove_messages import log_message
from rmr.record.record_writer import RecordWriter
from rmr.record.run_about import LAUNCHER_PROCESS, RunAbout, about_run

LINES_MAX = 200
"""Bound of the log lines that wait for the file to begin."""

NAMES_MAX = 1000
"""Bound of the recordings beside each other with one name."""

MODE = "processes"

log = logging.getLogger("rmr")


class ProcessRecorder(logging.Handler):
    """Records what one process does."""

    def __init__(self, file: Path, process: str, attach: Callable[[RecordWriter], None] = lambda _: None) -> None:
        """`process` is the name that the log lines and the file bear: ``world``, ``robots-4``.

        `attach` gives a new file what the process knows of the run: floor, lab, program. Beside the file of a launcher,
        which has all of it, it is not called.
        """
        super().__init__(logging.INFO)
        self.writer: RecordWriter | None = None
        """The present recording; None before the process has met its world."""
        self._file = file
        self._process = process
        self._attach = attach
        self._about: RunAbout | None = None
        self._now: Callable[[], Instant] = lambda: 0
        self._waiting: list[tuple[str, str]] = []
        self._failed = False
        log.addHandler(self)

    def begin(self, lab: str, seed: int, roster: tuple[int, ...], run: int, now: Callable[[], Instant]) -> RecordWriter:
        """Return the recording of this run, which the first call begins. `now` is lab time."""
        about = about_run(lab, MODE, seed, roster, self._process, str(run))
        self._now = now
        if self.writer is None or about != self._about:
            if self.writer is not None:
                self.writer.close()
            self._about = about
            self.writer = RecordWriter(free_name(self._file), about)
            if not self._file.with_name(f"{LAUNCHER_PROCESS}.mcap").exists():
                self._attach(self.writer)
            for level, message in self._waiting:
                self._write(level, message)
            self._waiting.clear()
            self._tell_failure()
        return self.writer

    def emit(self, record: logging.LogRecord) -> None:
        """Record a log line."""
        if self.writer is not None:
            self._write(record.levelname.lower(), record.getMessage())
        elif len(self._waiting) < LINES_MAX:
            self._waiting.append((record.levelname.lower(), record.getMessage()))

    def _write(self, level: str, message: str) -> None:
        assert self.writer is not None
        now = self._now()
        self.writer.write("/log", now, log_message(now, level, self._process, message))

    async def keep_flushed(self) -> None:
        """Put what has been recorded into the file once a second, without end."""
        while True:
            # Period with which what has been recorded is put into the file: so much is lost of a process that is
            # killed.
            await asyncio.sleep(1.0)
            if self.writer is not None:
                self.writer.flush()
                self._tell_failure()

    def _tell_failure(self) -> None:
        if self.writer is not None and self.writer.failure is not None and not self._failed:
            self._failed = True
            log.warning("%s", self.writer.failure)

    def end(self) -> None:
        """Finish the file."""
        log.removeHandler(self)
        if self.writer is not None:
            self.writer.close()
            self._tell_failure()


def free_name(file: Path) -> Path:
    """Return `file`, or a name beside it that no file bears: one that is there is not replaced."""
    names = (file, *(file.with_name(f"{file.stem}.{number}{file.suffix}") for number in range(1, NAMES_MAX)))
    return next((name for name in names if not name.exists()), file)
