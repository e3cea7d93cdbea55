"""The event log of a run: what befell its processes and robots, as lines of JSON in the run folder.

The form is that of the processes' logs, so that `rmr logs` merges them; each line has an `event` of `EVENTS` beside.
"""

import json
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final

from rmr.base.file_errors import naming

EVENTS_FILE = "events.jsonl"
WHO = "rmr up"
"""The launcher in lines of logs."""

EVENTS = {
    "started": "the processes of the run are started",
    "ready": "all robots are ready",
    "over": "the run is over: `reason`, `finished`",
    "robot_started": "a process of a robot was started: `process`, `pid`",
    "world_started": "a durable world was started again: `process`, `pid`",
    "robot_state": "a robot's `state` is another one",
    "process_ended": "a process has ended: `process`, `exit_code`",
    "robot_back": "a process that was started by hand has taken the robot's place",
    "robot_left": "that process has left again",
    "fault": "a fault of the lab file was performed: `fault`",
    "load": "it is known what became of a load of the lab file: `load`",
    "request": "an order was carried out: `do`, `robot`, and what else it has",
}
"""What a line may tell."""


class EventLog:
    """The events of one run."""

    def __init__(self, folder: Path, now_s: Callable[[], float | None]) -> None:
        """`now_s` returns lab time in seconds, None before it runs."""
        self._path = folder / EVENTS_FILE
        self.now_s: Final = now_s
        self._states: dict[int, str] = {}
        self.heard: Callable[[str, dict[str, Any]], None] | None = None
        """Called with each event and its fields."""
        self.failure = ""
        """Why the file ends early: which it is, and what was wrong; empty while it is written."""

    def note(self, event: str, message: str, **fields: Any) -> None:
        """Write an event; a run goes on if it cannot be written, and the file ends there (`failure`)."""
        assert event in EVENTS
        now_s = self.now_s()
        stamp = {} if now_s is None else {"t": round(now_s, 3)}
        line = {"time": round(time.time(), 6), "level": "info", "who": WHO, "message": message, **stamp}
        line |= {"event": event, **fields}
        if not self.failure:
            try:
                with naming(self._path), self._path.open("a") as file:
                    file.write(json.dumps(line, ensure_ascii=False, default=str) + "\n")
            except OSError as error:
                self.failure = f"{error.filename}: {error.strerror}"
        if self.heard is not None:
            self.heard(event, fields)

    def note_states(self, states: Iterable[tuple[int, str]]) -> None:
        """Write the states of robots that are other ones than before."""
        for robot, state in states:
            if self._states.get(robot, "starting") != state:
                self._states[robot] = state
                self.note("robot_state", f"robot {robot}: {state}", robot=robot, state=state)
