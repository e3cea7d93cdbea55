"""The words of `rmr sim`, and back: the words that repeat a run."""

import argparse
import os
import re
import shlex
from pathlib import Path

from rmr import __version__
from rmr.coord.timing import Order
from rmr_world.provided_labs import missing, resolve

SEEDS_MAX = 100_000
"""Of one sweep: days of work, and a sweep.json of 30 MB."""
JOBS_MAX = 64
"""Processes at once; more than any one machine of a lab has use for."""
WHOLE = "[0-9]{1,18}"
"""What fits 64 bits; of thousands of digits Python makes no number at all."""
ORDERS = "who goes first: most deadlines met (ours), earliest deadline, first come, or no coordination (none)"


def parse(words: list[str] | None) -> argparse.Namespace:
    """Return what is asked for; wrong usage ends the process with exit code 2."""
    parser = argparse.ArgumentParser(
        prog="rmr sim", description="Run a lab in virtual time; the same seed gives the same report."
    )
    parser.add_argument("lab", type=_existing, metavar="LAB", help="a lab.yaml, its folder, or a provided lab")
    parser.add_argument("--seed", type=_natural, metavar="S", help="instead of the lab file's seed")
    parser.add_argument("--seeds", type=_seeds, metavar="A-B", help="a sweep: a run of each seed, and their summary")
    parser.add_argument("--resume", type=Path, metavar="RUN", help="go on with the sweep in this run folder")
    parser.add_argument("--jobs", type=_jobs, metavar="N", help="processes that share a sweep (default: one per core)")
    parser.add_argument("--robots", type=_positive, metavar="N", help="only the first N robots of the lab")
    parser.add_argument("--loss", type=_share, metavar="SHARE", help="share of radio frames lost, instead of the lab's")
    parser.add_argument("--chaos", action="store_true", help="faults at random for a while, drawn from the seed")
    parser.add_argument("--order", choices=[o.value for o in Order], default="ours", help=ORDERS)
    parser.add_argument("--actions", type=Path, metavar="FILE.py", help="handlers of actions, instead of the lab's")
    parser.add_argument("--events", type=Path, metavar="FILE.py", help="your own events, instead of the lab's")
    parser.add_argument("--run", type=Path, metavar="DIR", help="folder for the report (default: runs/LAB-DATE-TIME)")
    parser.add_argument("--trace", type=Path, metavar="FILE", help="write what happened as JSON lines")
    parser.add_argument("--json", action="store_true", help="the report as JSON on standard output")
    parser.add_argument("--strict", action="store_true", help="exit 4 when a deadline was missed or robots touched")
    parser.add_argument("--version", action="version", version=f"rmr {__version__}")
    arguments = parser.parse_args(words)
    if arguments.resume is not None and arguments.run is not None:
        parser.error("--resume goes on in its own run folder: leave out --run")
    sweep = arguments.seeds is not None or arguments.resume is not None
    if not sweep and arguments.jobs is not None:
        parser.error("--jobs shares the runs of a sweep: name its --seeds")
    if sweep and arguments.seed is not None:
        parser.error("--seed is one run, --seeds a sweep: name one of them")
    if sweep and arguments.trace is not None:
        parser.error("--trace is of one run; a sweep keeps the trace of each seed that fails")
    return arguments


def command_of(arguments: argparse.Namespace) -> str:
    """Return the command that, with a seed, repeats a run."""
    words = ["rmr", "sim", str(arguments.lab)]
    for name in ("robots", "loss", "actions", "events"):
        value = getattr(arguments, name)
        if value is not None:
            words += [f"--{name}", str(value)]
    if arguments.order != Order.OURS.value:
        words += ["--order", arguments.order]
    words += [f"--{name}" for name in ("chaos", "strict") if getattr(arguments, name)]
    return shlex.join(words)


def _existing(text: str) -> Path:
    if not resolve(Path(text)).exists():
        raise argparse.ArgumentTypeError(missing(Path(text)))
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
    return _whole(text, 0)


def _positive(text: str) -> int:
    return _whole(text, 1)


def _whole(text: str, least: int) -> int:
    if re.fullmatch(WHOLE, text) is None or int(text) < least:
        raise argparse.ArgumentTypeError(f"a whole number from {least}, of 18 digits at most, not {text!r:.40}")
    return int(text)


def _jobs(text: str) -> int:
    if _positive(text) > JOBS_MAX:
        raise argparse.ArgumentTypeError(f"at most {JOBS_MAX}, not {text}")
    return int(text)


def cores() -> int:
    """Return how many processors this process may use; where the system does not tell, how many there are."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(usable, JOBS_MAX)


def _seeds(text: str) -> range:
    match = re.fullmatch(f"({WHOLE})(?:-({WHOLE}))?", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"seeds such as 1-100, not {text!r:.40}")
    first, last = int(match[1]), int(match[2] or match[1])
    if not first <= last < first + SEEDS_MAX:
        raise argparse.ArgumentTypeError(f"from 1 to {SEEDS_MAX} seeds, the least first, not {text!r}")
    return range(first, last + 1)
