"""The command ``rmr fault``: its options alone, so that ``--help`` costs little; `disturb` does the work."""

import sys
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Any

import click

from rmr import __version__
from rmr.base.time import NEVER, Duration
from rmr.bus.endpoint import DEFAULT_ENDPOINT
from rmr.radio.links import Disturbance
from rmr_world.units import duration, ids

Parse = Callable[[str], Any]


def _read(parse: Parse) -> Callable[[click.Context, click.Parameter, str | None], Any]:
    """Return the callback that reads an option's text by `parse`, which raises ValueError."""

    def callback(_ctx: click.Context, _param: click.Parameter, text: str | None) -> Any:
        try:
            return None if text is None else parse(text)
        except ValueError as error:
            raise click.BadParameter(str(error)) from None

    return callback


def _span(text: str) -> Duration:
    length = duration(float(text) if text.replace(".", "", 1).isdecimal() else text)
    if not length:
        raise ValueError("should be longer than nothing")
    return length


def _groups(text: str) -> list[list[int]]:
    groups = [ids(group.strip()) for group in text.split("/")]
    if len(groups) < 2:
        raise ValueError("should be two groups of robots or more, such as 1-3/4-6")
    return groups


def _pair(text: str) -> list[list[int]]:
    pair = ids(text)
    if len(pair) != 2:
        raise ValueError("should be two robots, such as 1,2")
    return [[robot] for robot in pair]


_WHERE = (
    click.option("--connect", metavar="ENDPOINT", help=f"Where the world listens, such as {DEFAULT_ENDPOINT}."),
    click.option("--run", "folder", type=click.Path(path_type=Path), metavar="DIR", help="The run folder."),
    click.option(
        "--secret", type=click.Path(path_type=Path), metavar="FILE", help="Of the bus, where no run folder holds it."
    ),
    click.option("--lab", metavar="NAME", help="The lab, where several run at one endpoint."),
    click.option("--json", "as_json", is_flag=True, help="What disturbs the radio now, as JSON."),
)
_FOR = click.option("--for", "length", metavar="T", callback=_read(_span), help="How long; else to the run's end.")
_HARM = (
    click.option("--loss", type=click.FloatRange(0, 1), metavar="SHARE", help="Of the frames, 0 to 1."),
    click.option("--attenuation", type=click.FloatRange(0), metavar="DB", help="Taken from the power of frames."),
    click.option("--cut", is_flag=True, help="Neither heard nor sensed."),
)


def _with(*options: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def decorate(function: Any) -> Any:
        for option in reversed(options):
            function = option(function)
        return function

    return decorate


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="rmr-fault")
def command() -> None:
    """Disturb the radio of a lab that runs.

    The lab is that of the newest run under way in ./runs, else the one whose world listens at the default endpoint.
    Each command shows what disturbs the radio then.
    """


@command.command()
@_with(*_HARM, _FOR, *_WHERE)
def radio(loss: float | None, attenuation: float | None, cut: bool, length: Duration | None, **where: Any) -> None:
    """Disturb all links."""
    _ask("add", _disturbance([], length, _harm(loss, attenuation, cut)), **where)


@command.command()
@click.argument("robots", metavar="A,B", callback=_read(_pair))
@_with(*_HARM, click.option("--one-way", is_flag=True, help="From the first robot to the second only."), _FOR, *_WHERE)
def link(
    robots: list[list[int]],
    loss: float | None,
    attenuation: float | None,
    cut: bool,
    one_way: bool,
    length: Duration | None,
    **where: Any,
) -> None:
    """Disturb the link between two robots, both ways."""
    _ask("add", _disturbance(robots, length, _harm(loss, attenuation, cut), one_way=one_way), **where)


@command.command()
@click.argument("groups", metavar="A,B.../C,D...", callback=_read(_groups))
@_with(_FOR, *_WHERE)
def partition(groups: list[list[int]], length: Duration | None, **where: Any) -> None:
    """Cut groups of robots off from each other, such as 1-3/4-6."""
    _ask("add", _disturbance(groups, length, (0.0, inf)), **where)


@command.command()
@_with(*_WHERE)
def clear(**where: Any) -> None:
    """End all that has been added by this command; what the lab file says stays."""
    _ask("clear", None, **where)


@command.command(name="list")
@_with(*_WHERE)
def list_(**where: Any) -> None:
    """Show what disturbs the radio, or will."""
    _ask("list", None, **where)


def _harm(loss: float | None, attenuation: float | None, cut: bool) -> tuple[float, float]:
    """Return loss and attenuation, of which exactly one is asked for."""
    if (loss is not None) + (attenuation is not None) + cut != 1:
        raise click.UsageError("Say exactly one of --loss, --attenuation and --cut.")
    return loss or 0.0, inf if cut else attenuation or 0.0


def _disturbance(
    groups: list[list[int]], length: Duration | None, harm: tuple[float, float], *, one_way: bool = False
) -> Disturbance:
    until = NEVER if length is None else length
    try:
        return Disturbance(0, until, tuple(map(tuple, groups)), one_way, *harm).check()
    except ValueError as error:
        raise click.UsageError(f"{error}.") from None


def _ask(
    wish: str,
    added: Disturbance | None,
    *,
    connect: str | None,
    folder: Path | None,
    secret: Path | None,
    lab: str | None,
    as_json: bool,
) -> None:
    if connect is not None and folder is not None:
        raise click.UsageError("Say --connect or --run, not both.")
    from rmr_deploy.disturb import perform  # noqa: PLC0415 - the bus loads only where a world is asked

    sys.exit(perform(wish, added, connect=connect, folder=folder, secret=secret, lab=lab, as_json=as_json))
