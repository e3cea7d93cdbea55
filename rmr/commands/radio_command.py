"""`rmr radio`: what the radio of a lab will carry, tried in virtual time before anything is deployed."""
# ruff: noqa: PLC0415 - see rmr.commands

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import click

from rmr.commands.common import SETTINGS, VERSION, counted, print_json

if TYPE_CHECKING:
    from multiprocessing.synchronize import Semaphore

    from rmr.radio.phy import RadioConfig
    from rmr.radio.trials import Over, Row, Runs

START_S = 10.0
"""How long a process that shares the work may take to begin before nobody waits for it any more."""
JOBS_MAX = 64
"""Processes at once; more than any one machine of a lab has use for."""
SEEDS_MAX = 100_000
"""Replications; their intervals are then far narrower than the model is right."""

_Sample = TypeVar("_Sample")
_Command = TypeVar("_Command", bound=Callable[..., None])


class Real(click.FloatRange):
    """A number within limits, and no NaN, which lies within any."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return `value` as a float."""
        number = super().convert(value, param, ctx)
        return self.fail(f"{value!r} is not a number.", param, ctx) if math.isnan(number) else number


def _options(*options: Callable[[_Command], _Command]) -> Callable[[_Command], _Command]:
    """Return the decorator that adds `options`, in the order of the help."""

    def add(command: _Command) -> _Command:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def _option(
    name: str, kind: "click.ParamType[Any]", default: object, text: str, metavar: str
) -> Callable[[_Command], _Command]:
    return click.option(name, type=kind, default=default, show_default=True, help=text, metavar=metavar)


_radio_options = _options(
    click.option(
        "--interference",
        type=click.Choice(["capture_3db", "awgn"]),
        default="capture_3db",
        show_default=True,
        help="capture_3db: a frame must be 3 dB above all others, as with real radios. awgn: others are like noise, "
        "as in ns-3; more frames survive.",
    ),
    _option(
        "--sensitivity", Real(-130, -40), -85.0, "Weakest power that is received, dBm; real radios -85 to -101.", "DBM"
    ),
    _option("--tx-power", Real(-60, 40), 0.0, "Power that is sent, dBm.", "DBM"),
    _option("--exponent", Real(1.5, 6), 3.0, "How fast power falls with distance: 2 in the open, 3 in a room.", "N"),
    _option("--shadowing", Real(0, 30), 0.0, "By how much links of one length differ: standard deviation, dB.", "DB"),
    _option("--loss", Real(0, 1), 0.0, "Share of frames that are lost besides.", "SHARE"),
)

_json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")


def _run_options(seeds: int) -> Callable[[_Command], _Command]:
    return _options(
        _option("--seeds", click.IntRange(1, SEEDS_MAX), seeds, "How many times, each with chances of its own.", "N"),
        _option("--seed", click.IntRange(min=0), 0, "The first seed; the same seeds give the same output.", "S"),
        _option(
            "--jobs", click.IntRange(1, JOBS_MAX), 1, "Processes that share the work; the output is the same.", "N"
        ),
        _json_option,
        VERSION,
    )


_payload = _option("--payload", click.INT, 50, "Octets that each frame carries.", "B")
_psdu = _option("--psdu", click.INT, 61, "Octets of a frame with header and check sequence: payload + 11.", "B")
_unicast = click.option("--unicast", is_flag=True, help="To one station, which acknowledges; else to all.")
_saturated = click.option("--saturated", is_flag=True, help="As many frames as will go, instead of a rate.")


@click.group("radio", context_settings=SETTINGS, short_help="Try what the radio will carry.")
@VERSION
def command() -> None:
    """Try in virtual time what the radio of a lab will carry, before anything is deployed.

    Each subcommand is one experiment with the radio that robots and simulator have: IEEE 802.15.4 at 2.4 GHz without
    beacons. Shares and times come with the interval in which the true value lies 95 times of 100.
    """


@command.command("contention", context_settings=SETTINGS, short_help="Many stations share the channel.")
@_option("--senders", click.INT, 10, "Stations that send, 10 m around one that only listens.", "N")
@_option("--offered-fps", click.FLOAT, 100.0, "Frames a second that they want to send, all together.", "F")
@_saturated
@_payload
@_unicast
@_option("--seconds", click.FLOAT, 60.0, "Virtual time that counts, of each run.", "S")
@_radio_options
@_run_options(10)
def contention(
    senders: int, offered_fps: float, saturated: bool, payload: int, unicast: bool, seconds: float, **others: Any
) -> None:
    """How many frames arrive, and how late, when many stations in range of each other send at random."""
    from rmr.radio.trials.contention import Contention, run

    with _refused():
        case = Contention(senders, None if saturated else offered_fps, payload, unicast, seconds)
    load = "as fast as they can" if saturated else f"{offered_fps:g} frames/s in all"
    to = "to the sink, acknowledged" if unicast else "to all"
    title = f"{counted(senders, 'stations')}, {load}, {payload} octets {to}, {seconds:g} s"
    _tell(title, partial(run, case), others)


@command.command("hidden", context_settings=SETTINGS, short_help="Two stations that cannot hear each other.")
@click.option(
    "--case",
    "name",
    type=click.Choice(["hidden", "exposed_control", "near_far_hidden"]),
    default="hidden",
    show_default=True,
    help="hidden: A and C do not hear each other. exposed_control: as far from B, but they do. near_far_hidden: "
    "hidden, and C is the stronger.",
)
@_option("--load-fps", click.FLOAT, 25.0, "Frames a second that each of the two wants to send.", "F")
@_saturated
@_payload
@_unicast
@_option("--seconds", click.FLOAT, 120.0, "Virtual time that counts, of each run.", "S")
@_radio_options
@_run_options(10)
def hidden(
    name: str, load_fps: float, saturated: bool, payload: int, unicast: bool, seconds: float, **others: Any
) -> None:
    """How many frames arrive at B from A and C, which cannot hear each other.

    They stand as far from B as the radio reaches well: 15 m with the radio of the defaults.
    """
    from rmr.radio.trials.hidden import Hidden, distances, run

    with _refused():
        case = Hidden(name, None if saturated else load_fps, payload, unicast, seconds)
        a_m, c_m = distances(name, _config(others))
    load = "as fast as they can" if saturated else f"{load_fps:g} frames/s each"
    to = "acknowledged" if unicast else "to all"
    title = f"A at {a_m:.1f} m and C at {c_m:.1f} m from B, {load}, {payload} octets {to}, {seconds:g} s"
    _tell(title, partial(run, case), others)


@command.command("storm", context_settings=SETTINGS, short_help="A broadcast that all who hear it answer.")
@_option("--members", click.INT, 10, "Stations that answer.", "N")
@_option("--jitter-ms", click.FLOAT, 50.0, "Each waits a random time up to so long before it answers.", "J")
@click.option(
    "--geometry",
    type=click.Choice(["circle", "disk"]),
    default="circle",
    show_default=True,
    help="circle: all 10 m from whoever asks. disk: anywhere within 20 m.",
)
@_payload
@_unicast
@_radio_options
@_run_options(100)
def storm(members: int, jitter_ms: float, geometry: str, payload: int, unicast: bool, **others: Any) -> None:
    """How many answers to one broadcast arrive when all who hear it answer. One run is one storm."""
    from rmr.radio.trials.storm import GEOMETRIES, Storm, run

    with _refused():
        case = Storm(members, jitter_ms, geometry, payload, unicast)
    to = "acknowledged" if unicast else "to all"
    who = f"{counted(members, 'members')}, {GEOMETRIES[geometry]}"
    _tell(f"{who}, replies of {payload} octets {to} within {jitter_ms:g} ms", partial(run, case), others)


@command.command("overlap", context_settings=SETTINGS, short_help="Two frames at once.")
@_option("--sir", click.FLOAT, 6.0, "Power of the first frame over that of the second, dB.", "DB")
@_option("--offset", click.FLOAT, 100.0, "By how much the second begins later, us.", "US")
@_psdu
@_option("--frames", click.INT, 400, "Pairs of frames of each run.", "N")
@_radio_options
@_run_options(1)
def overlap(sir: float, offset: float, psdu: int, frames: int, **others: Any) -> None:
    """Which of two frames at once is received, by their powers. The first comes from 10 m."""
    from rmr.radio.trials.overlap import Overlap, run, second_m

    with _refused():
        case = Overlap(sir, offset, psdu, frames)
        second_m(case, _config(others))
    title = f"the first {sir:g} dB over the second, which begins {offset:g} us later"
    _tell(title, partial(run, case), others)


@command.command("latency", context_settings=SETTINGS, short_help="One sender alone.")
@_payload
@_unicast
@_option("--frames", click.INT, 2000, "Frames of each run.", "N")
@_radio_options
@_run_options(1)
def latency(payload: int, unicast: bool, frames: int, **others: Any) -> None:
    """How long a frame takes over 10 m on a channel that nobody else uses."""
    from rmr.radio.trials.latency import Latency, run

    with _refused():
        case = Latency(payload, unicast, frames)
    title = f"{payload} octets {'to one, acknowledged' if unicast else 'to all'}, {frames} frames"
    _tell(title, partial(run, case), others)


@command.command("link", context_settings=SETTINGS, short_help="One frame over a distance.")
@click.option("--distance", metavar="M", type=click.FLOAT, required=True, help="Metres from sender to receiver.")
@_psdu
@click.option("--frames", metavar="N", type=click.INT, help="Also send so many, in each run, and count.")
@_radio_options
@_run_options(1)
def link(distance: float, psdu: int, frames: int | None, **others: Any) -> None:
    """How strong a frame is after a distance, and how likely it is received.

    Nobody else is on the air. Under shadowing the shares are means of all links of that length. With --frames they
    are what was counted on one such link in each run.
    """
    from rmr.radio.trials.link import Link, run

    with _refused():
        case = Link(distance, psdu, frames)
    title = f"{distance:g} m, a frame of {psdu} octets" + (f", {frames} sent" if frames else "")
    _tell(title, partial(run, case), others)


# ---- how they are run


@contextmanager
def _refused() -> Iterator[None]:
    """Take what a case says against its values for wrong usage."""
    try:
        yield
    except ValueError as error:
        raise click.UsageError(str(error)) from None


def _tell(title: str, run: Callable[["Runs"], "Row"], others: dict[str, Any]) -> None:
    """Run an experiment and print what it finds."""
    from rmr.commands.radio_rows import told
    from rmr.radio.trials import Runs

    seeds = range(others["seed"], others["seed"] + others["seeds"])
    row = run(Runs(_config(others), seeds, _over(others["jobs"])))
    if others["as_json"]:
        print_json(row)
    else:
        click.echo(f"{title}; {counted(len(seeds), 'runs')}\n\n{told(row)}", nl=False)


def _config(others: dict[str, Any]) -> "RadioConfig":
    from rmr.radio.phy import RadioConfig

    return RadioConfig(
        tx_power_dbm=others["tx_power"],
        sensitivity_dbm=others["sensitivity"],
        exponent=others["exponent"],
        loss=others["loss"],
        interference=others["interference"],
        shadowing_db=others["shadowing"],
    )


def _over(jobs: int) -> "Over":
    """Return what runs replications, in so many processes, and tells on a terminal how many are done."""

    def over(trial: Callable[[int], _Sample], seeds: Sequence[int]) -> Iterator[_Sample]:
        with _samples(trial, seeds, min(jobs, len(seeds))) as samples:
            if sys.stderr.isatty() and len(seeds) > 1:
                with click.progressbar(samples, length=len(seeds), label="runs", file=sys.stderr) as shown:
                    yield from shown
            else:
                yield from samples

    return over


@contextmanager
def _samples(trial: Callable[[int], _Sample], seeds: Sequence[int], jobs: int) -> Iterator[Iterator[_Sample]]:
    if jobs == 1:
        yield map(trial, seeds)
        return
    from multiprocessing import get_context

    from rmr.entry.workers import interrupted_later

    context = get_context("spawn")
    begun = context.Semaphore(0)
    with ExitStack() as stack:
        with interrupted_later():
            pool = stack.enter_context(context.Pool(jobs, _begin, (begun,)))
            for _ in range(jobs):
                begun.acquire(timeout=START_S)  # a process that is ended while it begins says so
        yield pool.imap(trial, seeds)


def _begin(begun: "Semaphore") -> None:
    from rmr.entry.workers import end_with_parent

    end_with_parent()
    begun.release()
