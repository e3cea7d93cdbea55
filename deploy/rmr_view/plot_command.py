"""`rmr plot`: figures of experiments, drawn from their data, and pictures of a run (`run_plot`).

The data files of `docs/evaluation`, or of another folder, are named after their figures. Nothing is measured here: what
a figure shows stands in its file, and `make paper` renews that.
"""

import sys
from pathlib import Path

from rmr.entry import ExitCode
from rmr.entry.command_line import CommandLineError, did_you_mean
from rmr_view.chart import ChartError, figures_in, read

NO_MATPLOTLIB = "rmr plot: matplotlib is not installed in this environment: pip install 'rmr-robots[plot]'"

BROKEN_MATPLOTLIB = "rmr plot: matplotlib cannot be loaded; install it anew: pip install --force-reinstall matplotlib"


def perform(
    names: list[str], every: bool, data: Path, output: Path | None, animate: Path | None, speed: float | None
) -> int:
    """Draw a run, the figures `names`, or `every` one; without any list those known. Return the exit code."""
    runs = [name for name in names if _is_run(name) and not (data / f"{name}.json").is_file()]
    if runs or animate is not None:
        if len(runs) != 1 or len(names) != 1 or every:
            raise CommandLineError("name one RUN, its folder or recording" + (", for --animate" if animate else ""))
        from rmr_view.run_plot import perform_run  # noqa: PLC0415 - figures need no recordings

        return perform_run(Path(runs[0]), output, animate, speed)
    try:
        return _run(names, every, data, data if output is None else output)
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


def _run(asked: list[str], every: bool, data: Path, output: Path) -> int:
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
    figures = {name: read(path) for name, path in chosen.items()}
    try:
        from rmr_view.draw import draw  # noqa: PLC0415 - matplotlib takes a second to load

        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in figures.items():
            for doubt in draw(figure, folder / f"{name}.svg"):
                print(f"rmr plot: {name}: {doubt}", file=sys.stderr)
            print(folder / f"{name}.svg")
    except ImportError as error:
        absent = isinstance(error, ModuleNotFoundError) and (error.name or "").partition(".")[0] == "matplotlib"
        print(NO_MATPLOTLIB if absent else f"{BROKEN_MATPLOTLIB}: {error}", file=sys.stderr)
        return ExitCode.FAILED
    return 0
