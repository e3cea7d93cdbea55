"""Has the snapshots of one durable robot taken, each by a process of its own, beside the robot.

The process is started and awaited by a thread: nothing of it runs in a call of the robot's node. There is one at a
time; a segment that is closed meanwhile is looked at when it has ended. A snapshot that cannot be taken is told once,
and the journal grows until the next one can.
"""

import logging
import subprocess
import sys
import threading
from pathlib import Path

from rmr_agent.state_files import StateKey, remove_superfluous

log = logging.getLogger("rmr")


class SnapshotTaker:
    """Takes the snapshots in one folder."""

    def __init__(self, folder: Path, robot: int, key: StateKey, trust: Path | None = None) -> None:
        self._folder = folder
        self._key = key
        self._trust = trust
        self._robot = robot
        self._guard = threading.Lock()
        self._wanted = 0
        """The segment before which the next snapshot is to be taken; 0 if there is nothing to do."""
        self._thread: threading.Thread | None = None
        self._process: subprocess.Popen[str] | None = None
        self._over = False
        self._told = False

    def take(self, segment: int) -> None:
        """Have the snapshot before `segment` taken; return at once."""
        with self._guard:
            self._wanted = segment
            if self._thread is None and not self._over:
                self._thread = threading.Thread(target=self._work, name="snapshots", daemon=True)
                self._thread.start()

    def close(self) -> None:
        """Break off what is under way."""
        with self._guard:
            self._over = True
            thread = self._thread
            if self._process is not None:
                self._process.kill()
        if thread is not None:
            thread.join()

    def _work(self) -> None:
        try:
            self._take_all()
        except OSError as error:
            self._tell(error.strerror or str(error))
            with self._guard:
                self._thread = None

    def _tell(self, why: str) -> None:
        if not self._told:
            self._told = True
            log.warning("robot %d: no snapshot of the state: %s; the journal grows", self._robot, why)

    def _take_all(self) -> None:
        while (process := self._begun()) is not None:
            _, said = process.communicate()
            with self._guard:
                self._process = None
                over = self._over
            if over:
                return
            if process.returncode == 0:
                self._tidy()
            else:
                self._tell((said.strip().splitlines()[-1:] or [f"exit code {process.returncode}"])[0])

    def _begun(self) -> subprocess.Popen[str] | None:
        """Start the process that takes the next snapshot; return None, and end the thread, if none is wanted."""
        with self._guard:
            segment, self._wanted = self._wanted, 0
            if not segment or self._over:
                self._thread = None
                return None
            program = [sys.executable, "-m", "rmr_agent.take_snapshot"]
            words = [
                *program,
                str(self._folder),
                str(segment),
                str(self._key.file),
                *([str(self._trust)] if self._trust else []),
            ]
            self._process = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
            return self._process

    def _tidy(self) -> None:
        try:
            remove_superfluous(self._folder, self._key)
        except OSError as error:
            log.warning("robot %d: old state stays in %s: %s", self._robot, self._folder, error.strerror or error)
