"""The program `rmr-fault`: the subcommands and options of `rmr fault`; `rmr_deploy.disturb` carries them out.

Importing this module loads next to nothing (see `rmr.entry`), and its help not the bus.
"""
# ruff: noqa: PLC0415

import sys
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rmr.entry import run

if TYPE_CHECKING:
    from rmr.entry.command_line import CommandGroup, Parser
    from rmr.radio.links import Disturbance

# --- what the words of an option mean


def _duration(text: str) -> int:
    from rmr_world.units import duration

    length = duration(float(text) if text.replace(".", "", 1).isdecimal() else text)
    if not length:
        raise ValueError("should be longer than nothing")
    return length


def _groups(text: str) -> list[list[int]]:
    from rmr_world.units import ids

    groups = [ids(group.strip()) for group in text.split("/")]
    if len(groups) < 2:
        raise ValueError("should be two groups of robots or more, such as 1-3/4-6")
    return groups


def _pair(text: str) -> list[list[int]]:
    from rmr_world.units import ids

    pair = ids(text)
    if len(pair) != 2:
        raise ValueError("should be two robots, such as 1,2")
    return [[robot] for robot in pair]


# --- options


def _declare_place(parser: "Parser") -> None:
    """Declare which lab is meant, and the form of the answer."""
    from rmr.bus.endpoint import DEFAULT_ENDPOINT

    parser.option("--connect", metavar="ENDPOINT", help=f"Where the world listens, such as {DEFAULT_ENDPOINT}.")
    parser.option("--run", dest="folder", metavar="DIR", read=Path, help="The run folder.")
    parser.option("--secret", metavar="FILE", read=Path, help="Of the bus, where no run folder holds it.")
    parser.option("--lab", metavar="NAME", help="The lab, where several run at one endpoint.")
    parser.flag("--json", dest="as_json", help="What disturbs the radio now, as JSON.")


def _declare_length(parser: "Parser") -> None:
    parser.option("--for", dest="length", metavar="T", read=_duration, help="How long; else to the run's end.")


def _declare_harm(parser: "Parser") -> None:
    from rmr.entry.command_line import real

    parser.option("--loss", metavar="SHARE", read=real(0, 1), help="Of the frames, 0 to 1.")
    parser.option("--attenuation", metavar="DB", read=real(0), help="Taken from the power of frames.")
    parser.flag("--cut", help="Neither heard nor sensed.")


def _declare_radio(parser: "Parser") -> None:
    _declare_harm(parser)
    _declare_length(parser)
    _declare_place(parser)


def _declare_link(parser: "Parser") -> None:
    parser.positional("robots", "A,B", read=_pair)
    _declare_harm(parser)
    parser.flag("--one-way", help="From the first robot to the second only.")
    _declare_length(parser)
    _declare_place(parser)


def _declare_partition(parser: "Parser") -> None:
    parser.positional("groups", "A,B.../C,D...", read=_groups)
    _declare_length(parser)
    _declare_place(parser)


# --- subcommands


def _radio(loss: float | None, attenuation: float | None, cut: bool, length: int | None, **place: Any) -> int:
    return _ask("add", _disturbance([], length, _harm(loss, attenuation, cut)), **place)


def _link(
    robots: list[list[int]],
    loss: float | None,
    attenuation: float | None,
    cut: bool,
    one_way: bool,
    length: int | None,
    **place: Any,
) -> int:
    return _ask("add", _disturbance(robots, length, _harm(loss, attenuation, cut), one_way=one_way), **place)


def _partition(groups: list[list[int]], length: int | None, **place: Any) -> int:
    return _ask("add", _disturbance(groups, length, (0.0, inf)), **place)


def _clear(**place: Any) -> int:
    return _ask("clear", None, **place)


def _list(**place: Any) -> int:
    return _ask("list", None, **place)


Row = tuple[str, Callable[["Parser"], None], Callable[..., int]]

SUBCOMMANDS: dict[str, Row] = {
    "radio": ("Disturb all links.", _declare_radio, _radio),
    "link": ("Disturb the link between two robots, both ways.", _declare_link, _link),
    "partition": ("Cut groups of robots off from each other, such as 1-3/4-6.", _declare_partition, _partition),
    "clear": (
        "End all that has been added by this command; what the lab file says stays.",
        _declare_place,
        _clear,
    ),
    "list": ("Show what disturbs the radio, or will.", _declare_place, _list),
}
"""Name -> what it does, its options, and what carries it out."""

ABOUT = """\
Disturb the radio of a lab that runs.

The lab is that of the newest run under way in ./runs, else the one whose world listens at the default endpoint.
Each command shows what disturbs the radio then.
"""


def command() -> "CommandGroup":
    """Return the command."""
    from rmr.entry.command_line import Command, CommandGroup, Subcommand

    def entry(row: Row) -> Subcommand:
        return Subcommand(row[0], lambda: Command(*row))

    return CommandGroup(ABOUT, {name: entry(row) for name, row in SUBCOMMANDS.items()})


def _harm(loss: float | None, attenuation: float | None, cut: bool) -> tuple[float, float]:
    """Return loss and attenuation, of which exactly one is asked for."""
    from rmr.entry.command_line import CommandLineError

    if (loss is not None) + (attenuation is not None) + cut != 1:
        raise CommandLineError("say exactly one of --loss, --attenuation and --cut")
    return loss or 0.0, inf if cut else attenuation or 0.0


def _disturbance(
    groups: list[list[int]], length: int | None, harm: tuple[float, float], *, one_way: bool = False
) -> "Disturbance":
    from rmr.base.time import NEVER
    from rmr.entry.command_line import CommandLineError
    from rmr.radio.links import Disturbance

    until = NEVER if length is None else length
    try:
        return Disturbance(0, until, tuple(map(tuple, groups)), one_way, *harm).check()
    except ValueError as error:
        raise CommandLineError(str(error)) from None


def _ask(wish: str, added: "Disturbance | None", **place: Any) -> int:
    from rmr.entry.command_line import CommandLineError
    from rmr_deploy.disturb import perform

    if place["connect"] is not None and place["folder"] is not None:
        raise CommandLineError("say --connect or --run, not both")
    return perform(wish, added, **place)


def main() -> None:
    """Run the command; ends the process."""
    sys.exit(run("rmr fault", lambda: command().main(name="rmr fault")))


if __name__ == "__main__":
    main()
