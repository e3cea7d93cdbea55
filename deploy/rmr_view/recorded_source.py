"""The source of a recording: a file, or the files that a run has left.

Poses and the timeline are read once, in a thread, and kept (`RunHistory` bounds them). Entries are read from the file
for each request, so a recording of any size takes bounded memory.
"""

import asyncio
import json
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from threading import Lock
from typing import Any

from rmr.base.time import in_seconds, seconds
from rmr.record.mcap_scan import RecordingError
from rmr.record.recording import open_recording
from rmr.record.run_files import FLOOR, PATHS_NAME, REPORT, SOURCE
from rmr_view.mind_worker import MindWorker
from rmr_view.recorded_messages import entries_of, take, take_into_timeline
from rmr_view.run_history import RunHistory
from rmr_view.run_source import ENTRIES_MAX, RequestRefusedError, RunClock, WhyOptions

TIMELINE_TOPIC = "/trace"
EMPTY_FLOOR = {"width": 1.0, "height": 1.0, "cell": 0.05, "obstacles": [], "areas": [], "beacons": [], "bottleneck": []}
"""Where a recording has lost its floor."""


class RecordedSource:
    """One recording."""

    live = False

    def __init__(self, path: Path) -> None:
        """Open the recording at `path`. Raises RecordingError."""
        self.path = path
        self._recording = open_recording(path)
        self._reading = Lock()
        about = self._recording.about
        self._begin_s, self._end_s = map(in_seconds, self._recording.span)
        self._report = self._json(REPORT)
        self._floor = self._json(FLOOR)
        self._minds = MindWorker(path)
        self._loading: asyncio.Task[None] | None = None
        self.history = RunHistory(about.roster)

    def _json(self, name: str) -> dict[str, Any] | None:
        data = self._recording.attachment(name)
        try:
            value = None if data is None else json.loads(data)
        except ValueError:
            return None
        return value if isinstance(value, dict) else None

    # --- reading ---

    async def start(self) -> None:
        """Begin to read what is kept."""
        self._loading = asyncio.create_task(asyncio.to_thread(self._load))

    def _load(self) -> None:
        with self._reading:
            kept = ("/tf", "/tf_estimates", "/routes", "/status", "/faults", TIMELINE_TOPIC)
            for message in self._recording.messages(kept):
                if message.topic == TIMELINE_TOPIC:
                    take_into_timeline(self.history, message.at, message.data)
                else:
                    take(self.history, message.topic, message.at, message.data)

    async def refresh(self) -> None:
        """Wait until all that is kept has been read."""
        if self._loading is not None:
            await asyncio.shield(self._loading)

    async def entries(self, kind: str, begin: float, end: float) -> list[dict[str, Any]]:
        """Return entries as they stand in the file."""
        return await asyncio.to_thread(self._entries, kind, begin, end)

    def _entries(self, kind: str, begin: float, end: float) -> list[dict[str, Any]]:
        topic = f"/{kind}"
        last = seconds(min(end, self._end_s + 1.0)) + 1
        with self._reading:
            found = entries_of(topic, self._recording.messages((topic,), seconds(begin), last))
            return list(islice(found, ENTRIES_MAX + 1))

    # --- what there is to see ---

    @property
    def clock(self) -> RunClock:
        """Where lab time stands: at the end."""
        return RunClock(self._end_s, self._end_s, False, None)

    @property
    def report(self) -> Mapping[str, Any] | None:
        """The report, if the recording has one."""
        return self._report

    def about(self) -> dict[str, Any]:
        """Return the answer to `/api/run`."""
        about = self._recording.about
        problems = list(self._recording.problems)
        if self.history.malformed:
            problems.append(f"{self.history.malformed} messages of the recording are none of rmr's and left out")
        if self._floor is None:
            problems.append("the recording has no floor: only robots are shown")
        return {
            "lab": about.lab,
            "mode": about.mode,
            "live": False,
            "control": False,
            "steer": False,
            "seed": about.seed,
            "begin_s": self._begin_s,
            "end_s": self._end_s,
            "robots": list(about.roster),
            "floor": self._floor or EMPTY_FLOOR,
            "program": self._program(),
            "problems": problems,
            "report": self._report,
            "versions": {"rmr": about.rmr, "python": about.python, "platform": about.platform},
        }

    def _program(self) -> dict[str, str | None] | None:
        source = self._recording.attachment(SOURCE)
        paths = self._paths()
        name = Path(paths.get(SOURCE, SOURCE)).name
        return None if source is None else {"name": name, "source": source.decode(errors="replace")}

    def _paths(self) -> Mapping[str, str]:
        found = (part.scan.metadata.get(PATHS_NAME) for part in self._recording.parts)
        return next((paths for paths in found if paths), {})

    async def robot(self, robot: int, t: float | None) -> dict[str, Any]:
        """Return what a robot knew and did at `t`."""
        await self.refresh()
        at = self._end_s if t is None else t
        return await self._minds.state(robot, at) | self.history.robot(robot, at)

    async def why(self, robot: int, fact: str, t: float | None, options: WhyOptions) -> dict[str, Any]:
        """Return the explanation of a fact."""
        return await self._minds.why(robot, fact, t, options)

    async def missed(self, robot: int) -> dict[str, Any]:
        """Return what the time of missed deadlines went into."""
        return await self._minds.missed(robot)

    async def step(self, robot: int, at: int, commands: str) -> dict[str, Any]:
        """Return where commands lead among the stops of a robot."""
        return await self._minds.step(robot, at, commands)

    async def control(self, order: Mapping[str, Any]) -> dict[str, Any]:
        """Refuse: the run is over."""
        raise RequestRefusedError(f"{order['do']}: this is a recording of a run that is over", 409)

    async def close(self) -> None:
        """Close the files."""
        if self._loading is not None:
            await asyncio.wait([self._loading])
        self._recording.close()
        self._minds.close()


__all__ = ["RecordedSource", "RecordingError"]
