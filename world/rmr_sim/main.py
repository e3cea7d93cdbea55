"""`rmr sim LAB`: a lab in virtual time, in one process, the same for the same seed."""

import argparse
import json
import signal
import sys
import time
from pathlib import Path

from rmr import __version__
from rmr.node.actions import STOPPED, TAKEN_OVER
from rmr.node.trace import Level
from rmr_sim.run import prepare, report_of
from rmr_sim.simulation import Simulation
from rmr_world.document import LabError
from rmr_world.program import ProgramError
from rmr_world.report import table_text, write
from rmr_world.runfolder import RunFolderError, make_run_folder

FAILURES_MAX = 5
"""Failed actions that are told of; a program that tries again and again does not fill the screen."""
EXIT_FAILED, EXIT_USAGE, EXIT_INVALID, EXIT_STRICT = 1, 2, 3, 4


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="rmr sim", description="Run a lab in virtual time, in one process; the same seed gives the same report."
    )
    parser.add_argument("lab", type=_existing, metavar="LAB", help="a folder with a lab.yaml, or a lab.yaml")
    parser.add_argument("--seed", type=_natural, metavar="S", help="instead of the lab file's seed")
    parser.add_argument("--robots", type=_positive, metavar="N", help="only the first N robots of the lab")
    parser.add_argument("--loss", type=_share, metavar="SHARE", help="share of radio frames lost, instead of the lab's")
    parser.add_argument("--actions", type=Path, metavar="FILE.py", help="handlers of the program's own actions")
    parser.add_argument("--run", type=Path, metavar="DIR", help="folder for the report (default: runs/LAB-DATE-TIME)")
    parser.add_argument("--trace", type=Path, metavar="FILE", help="write what happened as JSON lines")
    parser.add_argument("--json", action="store_true", help="the report as JSON on standard output")
    parser.add_argument("--strict", action="store_true", help="exit 4 when a deadline was missed or robots touched")
    parser.add_argument("--version", action="version", version=f"rmr {__version__}")
    return parser.parse_args(argv)


def _existing(text: str) -> Path:
    if not Path(text).exists():
        raise argparse.ArgumentTypeError(f"there is no {text}")
    return Path(text)


def _share(text: str) -> float:
    try:
        share = float(text)
    except ValueError:
        share = -1.0
    if not 0.0 <= share < 1.0:
        raise argparse.ArgumentTypeError(f"a share from 0 up to 1, not {text!r}")
    return share


def _natural(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"a whole number from 0, not {text!r}")
    return int(text)


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"a whole number from 1, not {text!r}")
    return int(text)


def main(argv: list[str] | None = None) -> int:
    """Run the command; return its exit code."""
    arguments = _arguments(argv)
    try:
        return _run(arguments)
    except (LabError, ProgramError) as error:
        print(error, file=sys.stderr)
        return EXIT_INVALID
    except (RunFolderError, OSError) as error:
        print(f"rmr sim: {error}", file=sys.stderr)
        return EXIT_USAGE
    except KeyboardInterrupt:
        print("rmr sim: interrupted", file=sys.stderr)
        return EXIT_FAILED


def _run(arguments: argparse.Namespace) -> int:
    simulation = prepare(
        arguments.lab,
        seed=arguments.seed,
        robots=arguments.robots,
        loss=arguments.loss,
        actions=arguments.actions,
        trace=Level.NOTES if arguments.trace is None else Level.FACTS,
        warn=lambda text: print(text, file=sys.stderr),
    )
    folder = make_run_folder(simulation.lab.name, arguments.run)
    began = time.perf_counter()
    finished, interrupted = _run_until_interrupted(simulation)
    wall_s = time.perf_counter() - began
    report = report_of(simulation, finished)
    written = write(report, folder)
    trace = simulation.trace()
    if arguments.trace is not None:
        _write_trace(trace, arguments.trace)
    for line in failures(trace):
        print(line, file=sys.stderr)
    if arguments.json:
        json.dump(report, sys.stdout, indent=2, sort_keys=True)
        print()
    else:
        print(table_text(report))
    speed = simulation.time_s / wall_s if wall_s > 0 else 0.0
    took = f"{simulation.time_s:.1f} s simulated in {wall_s:.2f} s ({speed:.0f} x real time)"
    print(f"{'interrupted: ' if interrupted else ''}{took}; the report is {written}", file=sys.stderr)
    return exit_code(report, strict=arguments.strict)


def _run_until_interrupted(simulation: Simulation) -> tuple[bool, bool]:
    """Return whether all robots finished, and whether Ctrl-C ended the run; the second Ctrl-C raises."""
    interrupted = False

    def interrupt(*_: object) -> None:
        nonlocal interrupted
        interrupted = True
        simulation.stop()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        return simulation.run(), interrupted
    finally:
        signal.signal(signal.SIGINT, before)


def exit_code(report: dict[str, object], *, strict: bool) -> int:
    """Return the exit code for a report (0 fine, 1 not finished, 4 under --strict: missed or touched)."""
    if not report["finished"]:
        return EXIT_FAILED
    deadlines = report["deadlines"]
    assert isinstance(deadlines, dict)
    if strict and (deadlines["missed"] or report["collisions"]):
        return EXIT_STRICT
    return 0


def failures(trace: list[dict[str, object]]) -> list[str]:
    """Return a line for each action of `trace` that failed by itself, none twice, FAILURES_MAX at most."""
    lines: dict[str, None] = {}
    for entry in trace:
        if entry["what"] == "action_ended" and entry["failure"] not in {None, STOPPED, TAKEN_OVER}:
            lines[f"robot {entry['robot']}: action {entry['action']} failed: {entry['failure']}"] = None
    more = len(lines) - FAILURES_MAX
    return [*list(lines)[:FAILURES_MAX], *([f"and {more} more failed; --trace FILE holds all"] if more > 0 else [])]


def _write_trace(entries: list[dict[str, object]], path: Path) -> None:
    with path.open("w") as file:
        for entry in entries:
            file.write(json.dumps(entry) + "\n")


if __name__ == "__main__":
    sys.exit(main())
