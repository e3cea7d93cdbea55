"""Reads a recording: one file, or the files that the processes of a run have written, merged by time.

Reading is streamed: of each file a chunk or two are in memory. What cannot be read is told in `problems` and left out;
only a recording of which nothing can be read is an error.

The recording of a run that is under way is followed while its files grow: each process puts what it has recorded into
its file once a second. Files may come later than others (a robot that is started again), and stay readable here after
the run has joined and removed them.
"""

import heapq
import json
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgpack  # type: ignore[import-untyped]

from rmr.base.ids import listed, named
from rmr.base.time import NEVER, Instant, in_seconds
from rmr.record.mcap_format import FormatError
from rmr.record.mcap_scan import McapScan, RecordingError
from rmr.record.run_about import METADATA_NAME, AboutError, RunAbout

RUN_FILE: Final = "run.mcap"
"""The recording of a run, in its folder."""
PARTS_FOLDER: Final = "record"
"""The folder of the files of the single processes, until they are joined."""
PROBLEMS_NAME: Final = "problems"
"""The metadata record of a joined file that repeats what was wrong with its parts."""
WORLD_PROCESS: Final = "world"
ROBOTS_PREFIX: Final = "robots-"


class Message(NamedTuple):
    """One message of a recording."""

    topic: str
    at: Instant
    data: dict[str, Any]


class RawMessage(NamedTuple):
    """One message as it stands in the file."""

    topic: str
    at: Instant
    encoding: str
    octets: bytes


class RecordingPart(NamedTuple):
    """One file."""

    scan: McapScan
    about: RunAbout


class Recording:
    """A recording that can be read."""

    def __init__(self, parts: Sequence[RecordingPart], problems: Sequence[str] = ()) -> None:
        self.parts = tuple(parts)
        self.about = parts[0].about
        """What it is a recording of. Of several files: as the world, or else the first of them, states it."""
        self._problems = list(problems)

    @property
    def problems(self) -> tuple[str, ...]:
        """Sentences on what is missing. A damaged chunk is found when it is read."""
        return tuple(self._problems)

    @property
    def complete(self) -> bool:
        """Whether every file has been finished."""
        return all(part.scan.complete for part in self.parts)

    @property
    def span(self) -> tuple[Instant, Instant]:
        """Instants of the first and the last message; (0, 0) without any."""
        chunks = [chunk for part in self.parts for chunk in part.scan.chunks]
        return (min(c.begin for c in chunks), max(c.end for c in chunks)) if chunks else (0, 0)

    @property
    def attachments(self) -> list[str]:
        """Names of the attachments."""
        return list(dict.fromkeys(name for part in self.parts for name in part.scan.attachments))

    def attachment(self, name: str) -> bytes | None:
        """Return the data of an attachment; None without one of that name, and a problem if it is damaged."""
        for part in self.parts:
            try:
                data = part.scan.attachment(name)
            except FormatError as error:
                self.add_problem(f"{part.scan.name}: {name} is damaged and left out ({error})")
                continue
            if data is not None:
                return data
        return None

    def messages(
        self, topics: Collection[str] | None = None, begin: Instant = 0, end: Instant = NEVER
    ) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all) from `begin` until before `end`, in order of time."""
        for raw in self.raw_messages(topics, begin, end):
            data = self._decoded(raw)
            if data is not None:
                yield Message(raw.topic, raw.at, data)

    def _decoded(self, raw: RawMessage) -> dict[str, Any] | None:
        """Return the content of a message; None, and a problem, where it has none that can be read."""
        try:
            data = json.loads(raw.octets) if raw.encoding == "json" else msgpack.unpackb(raw.octets)
        except (ValueError, msgpack.UnpackException, RecursionError) as error:
            self.add_problem(f"a message of {raw.topic} at {in_seconds(raw.at):.3f} s cannot be read: {error}")
            return None
        return data if isinstance(data, dict) else None

    def raw_messages(
        self, topics: Collection[str] | None = None, begin: Instant = 0, end: Instant = NEVER
    ) -> Iterator[RawMessage]:
        """Yield messages as `messages` does, undecoded."""
        wanted = sorted(
            (chunk.begin, number, place)
            for number, part in enumerate(self.parts)
            for place, chunk in enumerate(part.scan.chunks)
            if chunk.end >= begin and chunk.begin < end
        )
        heap: list[tuple[Instant, int, int, int, int, bytes]] = []
        for start, number, place in wanted:
            while heap and heap[0][0] < start:
                yield self._raw(heapq.heappop(heap))
            for order, (at, channel, data) in enumerate(self._loaded(number, place)):
                named = self.parts[number].scan.channels.get(channel)
                if begin <= at < end and named is not None and (topics is None or named.topic in topics):
                    heapq.heappush(heap, (at, number, place, order, channel, data))
        while heap:
            yield self._raw(heapq.heappop(heap))

    def _raw(self, entry: tuple[Instant, int, int, int, int, bytes]) -> RawMessage:
        at, number, _, _, channel, data = entry
        named = self.parts[number].scan.channels[channel]
        return RawMessage(named.topic, at, named.encoding, data)

    def _loaded(self, number: int, place: int) -> list[tuple[int, int, bytes]]:
        """Return the messages of a chunk; none, and a problem, if it is damaged."""
        scan = self.parts[number].scan
        chunk = scan.chunks[place]
        try:
            found = scan.load(chunk)
        except FormatError as error:
            self.add_problem(
                f"{scan.name}: what was recorded from {in_seconds(chunk.begin):.3f} s to {in_seconds(chunk.end):.3f} s "
                f"is damaged and left out ({error})"
            )
            return []
        if any(channel not in scan.channels for _, channel, _ in found):
            scan.find_channels()
        if any(channel not in scan.channels for _, channel, _ in found):
            self.add_problem(f"{scan.name}: messages of which the file does not say what they are, are left out")
        return found

    def check(self) -> bool:
        """Return whether no file is damaged, by checksums of all octets; a problem for each that is."""
        damaged = {part.scan.name: damage for part in self.parts if (damage := part.scan.damage) is not None}
        for name, damage in damaged.items():
            self.add_problem(f"{name}: the file is damaged: {damage}")
        return not damaged

    def add_problem(self, problem: str) -> None:
        """Add a sentence on what is missing, unless it is there."""
        if problem not in self._problems:
            self._problems.append(problem)

    def __enter__(self) -> "Recording":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files."""
        for part in self.parts:
            part.scan.close()


# ---- opening


def open_recording(path: Path) -> Recording:
    """Return the recording at `path`: a run folder, or a file of one. Raises RecordingError with one sentence."""
    if not path.is_dir():
        part = open_part(path)
        problems = [*cut_short(part.scan), *part.scan.metadata.get(PROBLEMS_NAME, {}).values()]
        return Recording([part], problems)
    file = path / RUN_FILE
    if not file.exists():
        return merged(part_files(path), path)
    recording = open_recording(file)
    if part_files(path):
        recording.add_problem(f"{path / PARTS_FOLDER}: files that are not joined are left out; see rmr record join")
    return recording


def part_files(folder: Path) -> list[Path]:
    """Return the files of the single processes of the run in `folder`, by name."""
    return sorted((folder / PARTS_FOLDER).glob("*.mcap"))


def open_part(path: Path) -> RecordingPart:
    """Return one file. Raises RecordingError."""
    scan = McapScan(path)
    try:
        about = RunAbout.from_metadata(_metadata(scan))
    except AboutError as error:
        raise RecordingError(f"{path}: {error}") from error
    return RecordingPart(scan, about)


def _metadata(scan: McapScan) -> dict[str, str]:
    if METADATA_NAME not in scan.metadata:
        raise RecordingError(f"{scan.name}: the file was cut short within its first octets: it holds nothing")
    return scan.metadata[METADATA_NAME]


def cut_short(scan: McapScan) -> list[str]:
    """Return a sentence on a file that was cut short; nothing on one that is whole, or still being written."""
    if scan.complete or scan.being_written:
        return []
    last = max((chunk.end for chunk in scan.chunks), default=None)
    until = "it holds no message" if last is None else f"its last message is of {in_seconds(last):.3f} s"
    octets = f"; {scan.cut_octets} octets at its end are no whole record" if scan.cut_octets else ""
    return [f"{scan.name}: the file was cut short: {until}{octets}"]


def merged(files: Sequence[Path], folder: Path) -> Recording:
    """Return the recording in several files of one run. Raises RecordingError if none can be read."""
    parts: list[RecordingPart] = []
    problems: list[str] = []
    for file in files:
        try:
            parts.append(open_part(file))
        except RecordingError as error:
            problems.append(str(error))
    if not parts:
        why = "; ".join(problems) or _no_files(folder)
        raise RecordingError(f"{folder}: no recording of a run: {why}")
    parts.sort(key=lambda part: (part.about.process != WORLD_PROCESS, part.scan.name))
    own = [part for part in parts if part.about.same_run(parts[0].about)]
    problems += [f"{part.scan.name}: of another run; it is left out" for part in parts if part not in own]
    problems += [problem for part in own for problem in cut_short(part.scan)]
    problems += missing_parts(own)
    first = own[0]._replace(about=replace(own[0].about, process="joined"))
    return Recording([first, *own[1:]], problems)


def _no_files(folder: Path) -> str:
    """Say why a folder may hold no recording, and which one is meant where it holds the folders of runs."""
    try:
        runs = [each for each in folder.iterdir() if (each / RUN_FILE).is_file() or part_files(each)]
        newest = max(runs, key=lambda run: run.stat().st_mtime, default=None)
    except OSError:
        newest = None
    if newest is None:
        return "it was made without one (--no-record), or is no run folder"
    return f"it holds the folders of runs; name one, such as {newest}, the newest"


def robots_of(part: RecordingPart) -> list[int]:
    """Return the robots whose process has written a file."""
    process = part.about.process
    return list(listed(process.removeprefix(ROBOTS_PREFIX))) if process.startswith(ROBOTS_PREFIX) else []


def missing_parts(parts: Sequence[RecordingPart]) -> list[str]:
    """Return a sentence on the processes of the run that have left no file."""
    recorded = {robot for part in parts for robot in robots_of(part)}
    absent = [robot for robot in parts[0].about.roster if robot not in recorded]
    found = []
    if absent:
        found.append(f"no file of {named(absent)}: what they recorded is missing")
    if all(part.about.process != WORLD_PROCESS for part in parts):
        found.append("no file of the world: true poses are missing")
    return found


class GrowingRecording(Recording):
    """The recording of the run in a folder, so far."""

    def __init__(self, folder: Path) -> None:
        """Raise RecordingError while there is no file that can be read."""
        self._folder = folder
        first = merged(part_files(folder), folder)
        super().__init__(first.parts)
        self._known = {part.scan.name for part in self.parts}
        self._read: dict[str, int] = {}
        """Number of chunks that `news` has returned, by file."""

    def refresh(self) -> None:
        """Take in what has been written since the last call."""
        for file in part_files(self._folder):
            if str(file) not in self._known:
                self._add(file)
        for part in self.parts:
            part.scan.extend()

    def _add(self, file: Path) -> None:
        try:
            part = open_part(file)
        except RecordingError:  # not begun yet: it is tried again
            return
        self._known.add(str(file))
        if part.about.same_run(self.about):
            self.parts = (*self.parts, part)
        else:
            part.scan.close()
            self.add_problem(f"{file}: of another run; it is left out")

    def news(self) -> list[Message]:
        """Return the messages that have come since the last call, in order of time among themselves."""
        self.refresh()
        found: list[Message] = []
        for number, part in enumerate(self.parts):
            chunks = len(part.scan.chunks)
            for place in range(self._read.get(part.scan.name, 0), chunks):
                found += self._news_of(part, number, place)
            self._read[part.scan.name] = chunks
        found.sort(key=lambda message: message.at)
        return found

    def _news_of(self, part: RecordingPart, number: int, place: int) -> list[Message]:
        found: list[Message] = []
        for at, channel, octets in self._loaded(number, place):
            named = part.scan.channels.get(channel)
            if named is not None:
                data = self._decoded(RawMessage(named.topic, at, named.encoding, octets))
                if data is not None:
                    found.append(Message(named.topic, at, data))
        return found
