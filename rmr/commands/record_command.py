"""`rmr record`: join the files of a run, recover one that was cut short, tell what a recording holds."""
# ruff: noqa: PLC0415 - see rmr.commands

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rmr.base.printable import counted
from rmr.entry import ExitCode, print_json
from rmr.entry.command_line import Command, CommandGroup, Parser, Subcommand

if TYPE_CHECKING:
    from rmr.record.joining import Joined
    from rmr.record.recording import Recording


def _declare_join(parser: Parser) -> None:
    help_text = "a run folder, or the files of the processes of a run that was started by hand"
    parser.positional("paths", "RUN|FILE", read=Path, count="+", usage="RUN|FILE...", help=help_text)
    output = "the joined file (default: run.mcap in RUN); of FILEs the new run folder, or file"
    parser.option("-o", "--output", metavar="FILE", read=Path, help=output)


def _join(paths: list[Path], output: Path | None) -> int:
    """Join the files of a run; return the exit code."""
    from rmr.entry.command_line import CommandLineError
    from rmr.record.joining import join_files, join_run

    first = paths[0]
    if len(paths) == 1 and (output is None or not first.is_file()):
        return _written("join", paths, lambda: join_run(first, output))
    folders = [path for path in paths if path.is_dir()]
    if folders:
        raise CommandLineError(f"{folders[0]} is a folder: give one run folder alone, or files")
    if output is None:
        raise CommandLineError("name the new run folder with -o RUN: files that were named are left as they are")
    return _written("join", paths, lambda: join_files(paths, output))


def _declare_recover(parser: Parser) -> None:
    parser.positional("path", "RUN|FILE", help="a run folder, or a file that was cut short")


def _recover(path: Path) -> int:
    """Recover a recording; return the exit code."""
    from rmr.record.joining import recover

    return _written("recover", [path], lambda: recover(path))


def _written(name: str, paths: list[Path], write: Callable[[], "Joined"]) -> int:
    """Write a recording and tell what came of it; return the exit code."""
    from rmr.record.joining import NothingToDoError, UnwritableError
    from rmr.record.mcap_scan import RecordingError

    for path in paths:
        if not path.exists():
            print(f"rmr record {name}: {path}: No such file or directory", file=sys.stderr)
            return ExitCode.USAGE
    try:
        joined = write()
    except NothingToDoError as nothing:
        print(nothing)
        return ExitCode.OK
    except RecordingError as error:
        print(f"rmr record {name}: {error}", file=sys.stderr)
        return ExitCode.FAILED if isinstance(error, UnwritableError) else ExitCode.INVALID
    for problem in joined.problems:
        print(f"rmr record {name}: {problem}", file=sys.stderr)
    print(f"{joined.file}: {counted(joined.messages, 'message')}")
    return ExitCode.OK


def _declare_info(parser: Parser) -> None:
    parser.positional("path", "RUN|FILE", help="a run folder, or a recording")
    parser.flag("--json", dest="as_json", help="one JSON document on standard output")


def _info(path: Path, as_json: bool) -> int:
    """Tell what a recording holds; return the exit code."""
    from rmr.record.mcap_scan import RecordingError
    from rmr.record.recording import open_recording

    try:
        with open_recording(path) as recording:
            found = _contents(recording)
    except RecordingError as error:
        print(f"rmr record info: {error}", file=sys.stderr)
        return ExitCode.INVALID if path.exists() else ExitCode.USAGE
    if as_json:
        print_json(found)
        return ExitCode.OK
    about = found["about"]
    print(f"{about['lab']}, {about['mode']}, seed {about['seed']}, robots {about['roster']}")
    print(f"{found['begin_s']:.3f} s to {found['end_s']:.3f} s; recorded by rmr {about['rmr']} on {about['platform']}")
    for topic, row in found["channels"].items():
        print(f"  {topic:14} {row['messages']:9,} messages {row['octets']:12,} octets")
    for name in found["attachments"]:
        print(f"  {name}")
    for problem in found["problems"]:
        print(f"rmr record info: {problem}", file=sys.stderr)
    return ExitCode.OK


def _contents(recording: "Recording") -> dict[str, Any]:
    """Return what `rmr record info --json` prints."""
    from rmr.base.time import in_seconds

    channels: dict[str, dict[str, int]] = {}
    for raw in recording.raw_messages():
        row = channels.setdefault(raw.topic, {"messages": 0, "octets": 0})
        row["messages"] += 1
        row["octets"] += len(raw.octets)
    for name in recording.attachments:
        recording.attachment(name)
    recording.check()
    begin, end = recording.span
    return {
        "about": recording.about.to_metadata(),
        "begin_s": in_seconds(begin),
        "end_s": in_seconds(end),
        "complete": recording.complete,
        "channels": dict(sorted(channels.items())),
        "attachments": recording.attachments,
        "problems": list(recording.problems),
    }


_COMMANDS = {
    "info": ("Tell what a recording holds.", Command("Tell what a recording holds.", _declare_info, _info)),
    "join": (
        "Join the files of a run's processes into run.mcap.",
        Command(
            "Join the files of a run's processes into run.mcap, as rmr up does at its end, and remove them. FILEs of "
            "processes that were started by hand, as on several hosts, become the new run -o RUN, and stay.",
            _declare_join,
            _join,
        ),
    ),
    "recover": (
        "Write a file that was cut short or damaged anew.",
        Command(
            "Write a recording that was cut short or damaged anew, with its index, or join what is left of a run. "
            "What is lost is told.",
            _declare_recover,
            _recover,
        ),
    ),
}


def _loader(command: Command) -> Callable[[], Command]:
    return lambda: command


command = CommandGroup(
    "Recordings of runs: what they hold, joining and recovering them.",
    {name: Subcommand(summary, _loader(each)) for name, (summary, each) in _COMMANDS.items()},
)
