"""The command `rmr plot`: figures of experiments, drawn from their data, and pictures of a run.

The data files of `docs/evaluation`, or of another folder, are named after their figures. Nothing is measured here: what
a figure shows stands in its file, and `make paper` renews that. Of a recorded run there are pictures as SVG, and with
`--animate` the run itself as SVG.
"""
# ruff: noqa: PLC0415 - see rmr.entry; figures need no recordings, and runs no matplotlib, which takes a second to load

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rmr.entry import ExitCode, run
from rmr.entry.command_line import Command, CommandLineError, Parser, did_you_mean, real, remedy

if TYPE_CHECKING:
    from rmr_view.run_data import RunData

DATA = Path("docs") / "evaluation"
"""Where the data of figures lie by default."""


def main(words: Sequence[str] | None = None, name: str = "rmr plot") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: command().main(words, name))


def command() -> Command:
    """Return the command."""
    return Command("Draw pictures of a run, or figures of experiments, as SVG.", _declare, perform)


def _declare(parser: Parser) -> None:
    parser.positional(
        "names",
        "NAME|RUN",
        read=str,
        count="*",
        usage="[NAME...|RUN]",
        help="a figure, or a run: its folder or a recording (.mcap); without any, the known figures are listed",
    )
    parser.flag("--all", dest="every", help="every figure that there are data for")
    parser.option("--data", read=Path, default=DATA, metavar="DIR", help="the data")
    parser.option(
        "-o", "--output", read=Path, metavar="DIR", help="for the pictures (default: beside the data, or in RUN)"
    )
    parser.option("--animate", read=Path, metavar="FILE", help="write RUN as an animation, FILE.svg")
    parser.option(
        "--speed", read=real(0.01, 1000), metavar="X", help="lab time over time of --animate (default: 15 s at most)"
    )


def perform(
    names: list[str], every: bool, data: Path, output: Path | None, animate: Path | None, speed: float | None
) -> int:
    """Draw a run, the figures `names`, or `every` one; without any list those known. Return the exit code."""
    from rmr_view.chart import ChartError

    runs = [name for name in names if _is_run(name) and not (data / f"{name}.json").is_file()]
    if runs or animate is not None:
        if len(runs) != 1 or len(names) != 1 or every:
            raise CommandLineError("name one RUN, its folder or recording" + (", for --animate" if animate else ""))
        return _plot_run(Path(runs[0]), output, animate, speed)
    try:
        return _plot_figures(names, every, data, data if output is None else output)
    except ChartError as error:
        print(error, file=sys.stderr)
        return ExitCode.INVALID
    except OSError as error:
        print(f"rmr plot: {error}", file=sys.stderr)
        return ExitCode.USAGE


def _is_run(name: str) -> bool:
    """Return whether `name` names a run rather than a figure: a folder that exists, a path, or a recording."""
    path = Path(name)
    return path.suffix == ".mcap" or path.name != name or path.is_dir()


def _plot_figures(asked: list[str], every: bool, data: Path, output: Path) -> int:
    from rmr_view.chart import figures_in

    if not data.is_dir():
        print(f"rmr plot: there is no folder {data}; --data says where the data are", file=sys.stderr)
        return ExitCode.USAGE
    known = figures_in(data)
    names = list(known) if every else list(dict.fromkeys(asked))
    if not names:
        print("\n".join(known) if known else f"there are no data in {data}")
        return 0
    unknown = [name for name in names if name not in known]
    for name in unknown:
        print(f"rmr plot: there is no figure {name!r}{did_you_mean(name, known)}", file=sys.stderr)
    if unknown:
        print(f"known in {data}: {', '.join(known) or 'none'}", file=sys.stderr)
        return ExitCode.USAGE
    return _draw_all({name: known[name] for name in names}, output)


def _draw_all(chosen: dict[str, Path], folder: Path) -> int:
    """Read all figures, then draw them: of a mistake in one nothing is half done."""
    from rmr_view.chart import read

    figures = {name: read(path) for name, path in chosen.items()}
    try:
        from rmr_view.draw import draw

        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in figures.items():
            for doubt in draw(figure, folder / f"{name}.svg"):
                print(f"rmr plot: {name}: {doubt}", file=sys.stderr)
            print(folder / f"{name}.svg")
    except ImportError as error:
        if isinstance(error, ModuleNotFoundError) and remedy(error):
            raise
        what = f"cannot be loaded; install it anew: pip install --force-reinstall matplotlib: {error}"
        print(f"rmr plot: matplotlib {what}", file=sys.stderr)
        return ExitCode.FAILED
    return 0


# ---- pictures of a run


def _plot_run(run: Path, output: Path | None, animate: Path | None, speed: float | None) -> int:
    """Draw the pictures of `run` into the folder `output`, or its animation into `animate`; return the exit code."""
    from rmr.record.mcap_scan import RecordingError

    if animate is not None and animate.suffix.lower() != ".svg":
        raise CommandLineError(f"--animate {animate}: name a file that ends in .svg")
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


def _read(run: Path) -> "RunData":
    from rmr.record.recording import open_recording
    from rmr_view.run_data import run_data

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


def _write_pictures(data: "RunData", folder: Path) -> int:
    from rmr.base.file_errors import naming
    from rmr_view.run_pictures import PICTURES

    folder.mkdir(parents=True, exist_ok=True)
    for name, picture in PICTURES.items():
        path = folder / f"{name}.svg"
        with naming(path):
            path.write_text(picture(data), encoding="utf-8")
        print(path)
    return ExitCode.OK


def _write_film(data: "RunData", path: Path, speed: float | None) -> int:
    from rmr.base.file_errors import naming
    from rmr_view.animation import animation

    drawn = animation(data, speed).encode()
    path.parent.mkdir(parents=True, exist_ok=True)
    with naming(path):
        path.write_bytes(drawn)
    print(path)
    return ExitCode.OK


if __name__ == "__main__":
    sys.exit(main())
