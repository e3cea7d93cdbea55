"""The options of `rmr-world`."""

import argparse
from pathlib import Path

from rmr import __version__
from rmr.base.streams import SEED_MAX
from rmr.bus.endpoint import DEFAULT_ENDPOINT, BusError, check_endpoint


def _endpoint(text: str) -> str:
    try:
        return check_endpoint(text)
    except BusError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"'{text}' is no number of robots")
    return int(text)


def _seed(text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) <= len(str(SEED_MAX))):
        raise argparse.ArgumentTypeError(f"a whole number from 0 to {SEED_MAX}, not {text!r:.40}")
    return int(text)


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    it = argparse.ArgumentParser(
        prog="rmr-world",
        description="Run a lab's world: physics, sensors, lab time, and the router that robots connect to.",
        epilog="Robots come and go with rmr-agent, in any order; `rmr up LAB` starts everything.",
    )
    it.add_argument("--config", required=True, type=Path, metavar="LAB.yaml", help="the lab file, or its folder")
    place = it.add_mutually_exclusive_group()
    place.add_argument(
        "--listen", type=_endpoint, metavar="ENDPOINT", help=f"where robots connect (default: {DEFAULT_ENDPOINT})"
    )
    place.add_argument("--connect", type=_endpoint, metavar="ENDPOINT", help="be a client of the router there")
    it.add_argument(
        "--program", type=Path, metavar="PROG", help="check the lab's facts against this program (.rmr or .rbc)"
    )
    it.add_argument("--robots", type=_count, metavar="N", help="only the first N robots of the lab")
    it.add_argument("--seed", type=_seed, metavar="S", help="another seed than the lab file's")
    it.add_argument(
        "--secret",
        type=Path,
        metavar="FILE",
        help="let in only those who know the secret in FILE, which is made if it does not exist (default: everybody)",
    )
    it.add_argument("--when-ready", action="store_true", help="lab time starts when all robots are ready")
    it.add_argument("--log", type=Path, metavar="FILE", help="write a log as JSON lines")
    it.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    return it
