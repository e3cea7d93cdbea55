"""The subcommands and options of `rmr fault`; `rmr_deploy.disturb` carries them out.

Importing this module loads next to nothing (see `rmr.entry`), and its help not the bus.
"""
# ruff: noqa: PLC0415

import sys
from collections.abc import Callable, Sequence
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rmr.entry import run

if TYPE_CHECKING:
    from rmr.entry.command_line import CommandGroup, Parser
    from rmr.radio.links import Disturbance
    from rmr_deploy.run_requests import Who

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
    parser.option("--run", dest="folder", metavar="DIR", read=Path, help="The run folder, if several labs run.")
    parser.option("--secret", metavar="FILE", read=Path, help="Of the bus, where no run folder holds it.")
    parser.option("--keys", metavar="DIR", read=Path, help="The folder with an operator's keys, for tls/HOST:PORT.")
    parser.option("--lab", metavar="NAME", help="The name of the lab, if several run.")
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
    parser.flag("--one-way", help="From an earlier group to a later one only.")
    _declare_length(parser)
    _declare_place(parser)


def _declare_victims(parser: "Parser") -> None:
    """Declare robots of a run that `rmr up` has started, on this machine or on others."""
    from rmr_deploy.fleet import declare_connect, robots_or_service

    parser.option("--run", dest="folder", metavar="DIR", read=Path, help="The run folder, if several labs run.")
    parser.option("--lab", metavar="NAME", help="The name of the lab, if several run.")
    declare_connect(parser)
    parser.positional("robots", "ROBOT", read=robots_or_service, count="+", usage="ROBOT...")


def _declare_spell(parser: "Parser") -> None:
    _declare_length(parser)
    _declare_victims(parser)


def _declare_slow(parser: "Parser") -> None:
    parser.option("--every", metavar="T", read=_duration, required=True, help="One tick in each T, such as 100ms.")
    _declare_spell(parser)


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


def _partition(groups: list[list[int]], one_way: bool, length: int | None, **place: Any) -> int:
    return _ask("add", _disturbance(groups, length, (0.0, inf), one_way=one_way), **place)


def _crash(**options: Any) -> int:
    return _befall("kill", "crash", {}, **options)


def _stall(length: int | None, **options: Any) -> int:
    return _befall("stall", "stall", _seconds(for_s=length), **options)


def _slow(length: int | None, every: int, **options: Any) -> int:
    return _befall("slow", "slow", _seconds(for_s=length, every_s=every), **options)


def _outage(length: int | None, **options: Any) -> int:
    return _befall("outage", "outage", _seconds(for_s=length), **options)


def _seconds(**lengths: int | None) -> dict[str, float]:
    """Return durations in seconds; one that is not said lasts to the run's end."""
    from rmr.base.time import in_seconds
    from rmr_deploy.run_requests import FAULT_S_MAX

    return {name: FAULT_S_MAX if length is None else in_seconds(length) for name, length in lengths.items()}


def _befall(
    verb: str,
    order: str,
    lengths: dict[str, float],
    *,
    robots: "list[tuple[Who, ...]]",
    **place: Any,
) -> int:
    """Have the launcher perform a fault of robots."""
    from rmr_deploy.fleet import at_place
    from rmr_deploy.robot_orders import give_order
    from rmr_deploy.run_choice import performed

    ids = [robot for group in robots for robot in group]
    told = {"verb": order, "robots": ids, "lengths": lengths, **place}
    return performed(f"fault {verb}", lambda: at_place(give_order, acts=True, **told))


def _clear(**place: Any) -> int:
    return _ask("clear", None, **place)


def _list(**place: Any) -> int:
    return _ask("list", None, **place)


Row = tuple[str, Callable[["Parser"], None], Callable[..., int]]

SUBCOMMANDS: dict[str, Row] = {
    "kill": ("Kill robots or the world, as if they had failed: a restart policy applies.", _declare_victims, _crash),
    "stall": ("Stop the processes of robots for a while.", _declare_spell, _stall),
    "slow": ("Let robots run for one tick in each period only.", _declare_slow, _slow),
    "outage": ("Let robots hear no beacon of the localisation service.", _declare_spell, _outage),
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
Break things in a lab that runs: its robots and its radio.

The lab is the only one that runs on this machine; if several run, choose with --run or --lab. If none does, the radio
is that of the lab whose world listens at the default endpoint. Each command about the radio shows what disturbs it.
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
    from rmr.bus.certificates import credentials_path
    from rmr.entry.command_line import CommandLineError
    from rmr_deploy.disturb import perform

    if place["connect"] is not None and place["folder"] is not None:
        raise CommandLineError("say --connect or --run, not both")
    place["secret"] = credentials_path(place["secret"], place.pop("keys"), [place["connect"]])
    return perform(wish, added, **place)


def main(words: Sequence[str] | None = None, name: str = "rmr fault") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: command().main(words, name))


if __name__ == "__main__":
    sys.exit(main())
