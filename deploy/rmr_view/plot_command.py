"""`rmr plot NAME`: figures of experiments, drawn from their data.

The data files of `docs/evaluation`, or of another folder, are named after their figures. Nothing is measured here: what
a figure shows stands in its file, and `make paper` renews that.
"""

import argparse
import sys
from difflib import get_close_matches
from pathlib import Path

from rmr import __version__
from rmr.entry import ExitCode
from rmr_view.chart import ChartError, figures_in, read

DATA = Path("docs") / "evaluation"
NO_MATPLOTLIB = "rmr plot: matplotlib is not installed; install it into this environment: pip install 'rmr[plot]'"

BROKEN_MATPLOTLIB = "rmr plot: matplotlib cannot be loaded; install it anew: pip install --force-reinstall matplotlib"


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="rmr plot", description="Draw figures of experiments as SVG.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="a figure; without any, the known ones are listed")
    parser.add_argument("--all", action="store_true", help="every figure that there are data for")
    parser.add_argument("--data", type=Path, default=DATA, metavar="DIR", help="the data (default: %(default)s)")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="for the figures (default: beside the data)")
    parser.add_argument("--version", action="version", version=f"rmr {__version__}")
    return parser.parse_args(argv)


def perform(argv: list[str] | None) -> int:
    """Carry out the words `argv` (None: those of the command line); return the exit code."""
    arguments = _arguments(argv)
    try:
        return _run(arguments)
    except ChartError as error:
        print(error, file=sys.stderr)
        return ExitCode.INVALID
    except OSError as error:
        print(f"rmr plot: {error}", file=sys.stderr)
        return ExitCode.USAGE


def _run(arguments: argparse.Namespace) -> int:
    if not arguments.data.is_dir():
        print(f"rmr plot: there is no folder {arguments.data}; --data says where the data are", file=sys.stderr)
        return ExitCode.USAGE
    known = figures_in(arguments.data)
    names = list(known) if arguments.all else list(dict.fromkeys(arguments.names))
    if not names:
        print("\n".join(known) if known else f"there are no data in {arguments.data}")
        return 0
    unknown = [name for name in names if name not in known]
    for name in unknown:
        matches = get_close_matches(name, known, n=1)
        print(f"rmr plot: there is no figure {name!r}{_meant(matches)}", file=sys.stderr)
    if unknown:
        print(f"known in {arguments.data}: {', '.join(known) or 'none'}", file=sys.stderr)
        return ExitCode.USAGE
    return _draw_all({name: known[name] for name in names}, arguments.output or arguments.data)


def _meant(matches: list[str]) -> str:
    return f"; did you mean {matches[0]!r}?" if matches else ""


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
