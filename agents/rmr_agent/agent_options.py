"""The options of `rmr-agent`."""

import argparse
from pathlib import Path

from rmr import __version__
from rmr.base.ids import listed
from rmr.bus.endpoint import DEFAULT_ENDPOINT, BusError, check_endpoint
from rmr.bus.keys import Keys


def _robot_ids(text: str) -> tuple[int, ...]:
    try:
        return listed(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _endpoint(text: str) -> str:
    try:
        return check_endpoint(text)
    except BusError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _lab(text: str) -> str:
    try:
        return Keys(text).lab
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    it = argparse.ArgumentParser(
        prog="rmr-agent",
        description="Run one robot, or several: load byte-code, find the world, live.",
        epilog="Compile a program with rmrc; start its world with rmr-world; or let `rmr up LAB` do all of it.",
    )
    it.add_argument("program", metavar="PROG.rbc", type=Path, help="the byte-code to run")
    it.add_argument(
        "--id", required=True, type=_robot_ids, metavar="N", help="which robot of the lab this is; 1-20: several robots"
    )
    it.add_argument(
        "--connect",
        default=DEFAULT_ENDPOINT,
        type=_endpoint,
        metavar="ENDPOINT",
        help="where the world listens (default: %(default)s)",
    )
    it.add_argument("--actions", type=Path, metavar="FILE.py", help="handlers of the program's own actions")
    it.add_argument("--radio-key", type=Path, metavar="FILE", help="the radio's key, where the lab's is secured")
    it.add_argument(
        "--secret",
        type=Path,
        metavar="FILE",
        help="the secret of the world's bus (of rmr up: secret in the run folder)",
    )
    it.add_argument("--lab", type=_lab, metavar="NAME", help="the lab, where several run at one endpoint")
    it.add_argument("--log", type=Path, metavar="FILE", help="write a log as JSON lines, with the robot's trace")
    it.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    return it
