"""`rmr plot RUN`: pictures of a recorded run as SVG, and with `--animate` the run itself as SVG or GIF."""

import sys
from pathlib import Path

from rmr.base.file_errors import naming
from rmr.entry import ExitCode
from rmr.entry.command_line import CommandLineError
from rmr.record.mcap_scan import RecordingError
from rmr.record.recording import open_recording
from rmr_view.animation import animation
from rmr_view.run_data import RunData, run_data
from rmr_view.run_pictures import PICTURES


def perform_run(run: Path, output: Path | None, animate: Path | None, speed: float | None) -> int:
    """Draw the pictures of `run` into the folder `output`, or its animation into `animate`; return the exit code."""
    if animate is not None and animate.suffix.lower() not in {".svg", ".gif"}:
        raise CommandLineError(f"--animate {animate}: name a file that ends in .svg or .gif")
    if not run.exists():
        print(f"rmr plot: {run}: no such file or folder", file=sys.stderr)
        return ExitCode.USAGE
    try:
        data = _read(run)
    except RecordingError as error:
        print(f"rmr plot: {error}", file=sys.stderr)
        return ExitCode.INVALID
    try:
        return _write_pictures(data, output or _beside(run)) if animate is None else _write_film(data, animate, speed)
    except OSError as error:
        print(f"rmr plot: {error.filename}: {error.strerror}", file=sys.stderr)
        return ExitCode.USAGE


def _read(run: Path) -> RunData:
    recording = open_recording(run)
    try:
        data = run_data(recording)
        for problem in (*recording.problems, *data.problems):
            print(f"rmr plot: {problem}", file=sys.stderr)
    finally:
        recording.close()
    return data


def _beside(run: Path) -> Path:
    return run if run.is_dir() else run.parent


def _write_pictures(data: RunData, folder: Path) -> int:
    folder.mkdir(parents=True, exist_ok=True)
    for name, picture in PICTURES.items():
        path = folder / f"{name}.svg"
        with naming(path):
            path.write_text(picture(data), encoding="utf-8")
        print(path)
    return ExitCode.OK


def _write_film(data: RunData, path: Path, speed: float | None) -> int:
    if path.suffix.lower() == ".gif":
        try:
            from rmr_view.gif_film import film_of  # noqa: PLC0415 - Pillow is optional
        except ImportError:
            print(
                "rmr plot: a GIF needs Pillow: pip install 'rmr-robots[plot]', or write FILE.svg, which needs nothing",
                file=sys.stderr,
            )
            return ExitCode.FAILED
        octets = film_of(data, speed)
    else:
        octets = animation(data, speed).encode()
    path.parent.mkdir(parents=True, exist_ok=True)
    with naming(path):
        path.write_bytes(octets)
    print(path)
    return ExitCode.OK
