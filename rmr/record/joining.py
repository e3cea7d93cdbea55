"""Writes a recording anew, as one finished file with its index: the files of a run's processes joined, or a file that
was cut short recovered.

Messages are read and written one by one, in order of time. The new file takes its place when it is whole; until then
nothing that was there is changed.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

from rmr.base.ids import spelled
from rmr.base.time import Instant
from rmr.record.being_written import is_being_written
from rmr.record.channels import BY_TOPIC
from rmr.record.mcap_scan import RecordingError
from rmr.record.record_writer import RecordWriter
from rmr.record.recording import (
    PARTS_FOLDER,
    PROBLEMS_NAME,
    ROBOTS_PREFIX,
    RUN_FILE,
    WORLD_PROCESS,
    Recording,
    RecordingPart,
    merged,
    open_part,
    open_recording,
    part_files,
    robots_of,
)
from rmr.record.run_about import LAUNCHER_PROCESS, METADATA_NAME
from rmr.record.run_files import REPORT

PARTS_NAME: Final = "parts"
"""The metadata record of a joined file with the files that it holds: name, and octets. A part that could not be removed
is not joined twice."""


class Joined(NamedTuple):
    """What came of it."""

    file: Path
    messages: int
    problems: tuple[str, ...]
    """What is missing."""


class NothingToDoError(RecordingError):
    """The recording is one whole file already."""


class UnwritableError(RecordingError):
    """The new file cannot be written, now or there."""


def join_run(folder: Path, target: Path | None = None) -> Joined:
    """Join the files of the processes of the run in `folder` into `target` (None: its ``run.mcap``) and remove them.

    Files that came later are added to those joined before; a file that a process is writing stays. Raises
    RecordingError if there is no recording, UnwritableError if the new file cannot be written, NothingToDoError if
    there are no files to join; nothing is removed then.
    """
    if not folder.is_dir():
        raise RecordingError(f"{folder}: no run folder")
    joined_before = [file for file in [folder / RUN_FILE] if file.is_file()]
    files, later = _parts(folder)
    if not files and joined_before and not later:
        raise NothingToDoError(f"{folder / RUN_FILE} is one file: there is nothing to join")
    if not files and later:
        raise UnwritableError(f"{later[0]}: a process is still writing it; end the run first")
    with merged([*joined_before, *files], folder) as recording:
        for file in later:
            recording.add_problem(f"{file}: a process is still writing it; it is left out")
        parts = [Path(part.scan.name) for part in recording.parts if part.scan.name != str(folder / RUN_FILE)]
        sizes = {file.name: str(file.stat().st_size) for file in parts}
        joined = rewrite(recording, target or folder / RUN_FILE, report_of(folder), sizes)
    for file in parts:
        with suppress(OSError):
            file.unlink()
    with suppress(OSError):  # files of another run stay
        (folder / PARTS_FOLDER).rmdir()
    return joined


def join_files(files: Sequence[Path], target: Path) -> Joined:
    """Join the `files` that the processes of one run have written, as on several hosts, into `target`; they stay.

    `target` is the new run folder, or the new file if its name ends in ``.mcap``. Raises RecordingError with one
    sentence if they are no recordings of the processes of one run, each robot once at any time, with its world;
    UnwritableError if one is being written, or the new file cannot be.
    """
    for file in files:
        if is_being_written(file):
            raise UnwritableError(f"{file}: a process is still writing it; end the run first")
    parts = [open_part(file) for file in files]
    try:
        _check_one_run(parts)
    finally:
        for part in parts:
            part.scan.close()
    file = target if target.suffix == ".mcap" else target / RUN_FILE
    if file.exists():
        raise UnwritableError(f"{file} is there already: name another file or folder")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UnwritableError(f"cannot make {error.filename}: {error.strerror}") from None
    with merged(files, target) as recording:
        return rewrite(recording, file, None)


def _check_one_run(parts: Sequence[RecordingPart]) -> None:
    """Raise RecordingError unless the files are of the processes of one run, and nothing is in them twice."""
    for part in parts:
        process = part.about.process
        if process not in (WORLD_PROCESS, LAUNCHER_PROCESS) and not process.startswith(ROBOTS_PREFIX):
            raise RecordingError(f"{part.scan.name}: not of one process of a run ({process}): it is whole by itself")
    worlds = [part for part in parts if part.about.process == WORLD_PROCESS]
    if not worlds:
        raise RecordingError(
            "none of the files is of the world: name what rmr-world --record has written, too; it has floor, lab and "
            "true poses"
        )
    for part in parts:
        if not part.about.same_run(worlds[0].about):
            raise RecordingError(
                f"{part.scan.name} is of another run than {worlds[0].scan.name}: {_run(part)}, not {_run(worlds[0])}"
            )
    told: dict[str, list[RecordingPart]] = {}
    for part in parts:
        names = [f"robot {robot}" for robot in robots_of(part)] or [f"the {part.about.process}"]
        for name in names:
            for other in told.setdefault(name, []):
                if _overlap(part, other):
                    raise RecordingError(
                        f"{other.scan.name} and {part.scan.name} are both of {name}, at the same time: leave one out"
                    )
            told[name].append(part)


def _run(part: RecordingPart) -> str:
    about = part.about
    return f"run {about.run or 'unknown'} of lab {about.lab}, seed {about.seed}, robots {spelled(about.roster)}"


def _overlap(one: RecordingPart, other: RecordingPart) -> bool:
    """Whether two files tell of one time: those of a process and of the next one do not, a file and its copy do."""
    (begin, end), (since, until) = (_told_span(part) for part in (one, other))
    return (begin < until and since < end) or (begin, end) == (since, until)


def _told_span(part: RecordingPart) -> tuple[Instant, Instant]:
    """Return the instants of the first and last message; what a process says before it knows lab time has instant 0."""
    recording = Recording([part])
    end = recording.span[1]
    first = next(recording.raw_messages(begin=1), None)
    return (end if first is None else first.at, end)


def _parts(folder: Path) -> tuple[list[Path], list[Path]]:
    """Return the files to join, and those that a process is writing. Files that are joined already are removed."""
    known: dict[str, str] = {}
    with suppress(RecordingError):
        known = open_part(folder / RUN_FILE).scan.metadata.get(PARTS_NAME, {})
    files: list[Path] = []
    later: list[Path] = []
    for file in part_files(folder):
        with suppress(OSError):
            if known.get(file.name) == str(file.stat().st_size):
                file.unlink()
            else:
                (later if is_being_written(file) else files).append(file)
    return files, later


def recover(path: Path) -> Joined:
    """Write a file that was cut short or damaged anew, with its index, or join what is left of a run folder.

    What is damaged is left out, so that every reader takes the file.

    Raises RecordingError, UnwritableError, NothingToDoError if the file is whole.
    """
    if path.is_dir():
        if not (path / RUN_FILE).is_file() or part_files(path):
            return join_run(path)
        path = path / RUN_FILE
    with open_recording(path) as recording:
        scan = recording.parts[0].scan
        if recording.complete and recording.check():
            raise NothingToDoError(f"{path}: the file is whole: there is nothing to recover")
        if scan.being_written:
            raise UnwritableError(f"{path}: a process is still writing it; end the run first")
        if any(chunk.compression == "lz4" for chunk in scan.chunks):
            raise UnwritableError(f"{path}: another tool has compressed it with lz4, which rmr does not read")
        return rewrite(recording, path, None, scan.metadata.get(PARTS_NAME))


def report_of(folder: Path) -> bytes | None:
    """Return the report in a run folder; None without one."""
    try:
        return (folder / REPORT).read_bytes()
    except OSError:
        return None


def rewrite(recording: Recording, target: Path, report: bytes | None, parts: Mapping[str, str] | None = None) -> Joined:
    """Write `recording` to `target`, with `report` if it has none; `parts` are noted in it. Raises RecordingError."""
    partial = target.with_name(f".{target.name}.new")
    # The process of a file that several files were joined into.
    process = "joined" if len(recording.parts) > 1 else recording.about.process
    writer = RecordWriter(partial, replace(recording.about, process=process))
    try:
        _copy_files(recording, writer, report)
        unknown = _copy_messages(recording, writer)
        problems = (*recording.problems, *unknown)
        if problems:
            writer.note(PROBLEMS_NAME, {str(number): problem for number, problem in enumerate(problems, 1)})
        if parts is not None:
            writer.note(PARTS_NAME, parts)
        writer.close()
        if writer.failure is None:
            partial.replace(target)
    except OSError as error:
        writer.failure = str(error.strerror or error)
    finally:
        writer.close()
        with suppress(OSError):
            partial.unlink()
    if writer.failure is not None:
        reason = writer.failure.rpartition(": ")[2]
        raise UnwritableError(f"cannot write {target}: {reason}; what was recorded is where it was")
    return Joined(target, writer.count, problems)


def _copy_files(recording: Recording, writer: RecordWriter, report: bytes | None) -> None:
    """Copy attachments and metadata."""
    noted = {METADATA_NAME, PROBLEMS_NAME, PARTS_NAME}
    for part in recording.parts:
        for name, values in part.scan.metadata.items():
            if name not in noted:
                noted.add(name)
                writer.note(name, values)
    for name in recording.attachments:
        data = recording.attachment(name)
        if data is not None:
            writer.attach(name, data)
    if report is not None and REPORT not in recording.attachments:
        writer.attach(REPORT, report, recording.span[1])


def _copy_messages(recording: Recording, writer: RecordWriter) -> list[str]:
    """Copy the messages; return sentences on those of unknown channels, which are left out."""
    unknown: dict[str, int] = {}
    for raw in recording.raw_messages():
        if raw.topic in BY_TOPIC:
            writer.write(raw.topic, raw.at, raw.octets)
        else:
            unknown[raw.topic] = unknown.get(raw.topic, 0) + 1
        if writer.failure is not None:
            break
    return [
        f"{count} messages of the channel {topic}, which is unknown, are left out" for topic, count in unknown.items()
    ]
