"""`rmr radio`: what the radio of a lab will carry, tried in virtual time before anything is deployed."""
# ruff: noqa: PLC0415 - see rmr.commands

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from math import inf
from typing import TYPE_CHECKING, Any, TypeVar

from rmr.base.printable import counted
from rmr.entry import print_json
from rmr.entry.command_line import (
    Command,
    CommandGroup,
    CommandLineError,
    Parser,
    Read,
    Runnable,
    Subcommand,
    one_of,
    real,
    whole,
)
from rmr.radio.settings import SETTINGS

if TYPE_CHECKING:
    from multiprocessing.synchronize import Semaphore

    from rmr.radio.phy import RadioConfig
    from rmr.radio.trials import Over, Row, Runs

START_S = 10.0
"""Timeout for the start of a worker process, seconds; after it the work begins without that process."""
JOBS_MAX = 64
"""Largest number of worker processes, above the number of cores of a lab's machine."""
SEEDS_MAX = 100_000
"""Largest number of replications: confidence intervals are then far narrower than the error of the model."""

_Sample = TypeVar("_Sample")

ANY_REAL = real()
"""Reader of numbers without limits: the experiment checks the value with a better message."""
ANY_WHOLE = whole(-(10**18))
"""Reader of ints without limits: the experiment checks the value with a better message."""
CASES = ("hidden", "exposed_control", "near_far_hidden")
"""Cases of the experiment with hidden stations."""


# ---- options


def _declare_radio(parser: Parser) -> None:
    """Declare the radio's settings."""
    for each in SETTINGS:
        if each.choices and each.option:
            parser.choice(each.option, each.choices, default=each.default, help=each.help)
        elif each.option:
            parser.option(
                each.option,
                dest=each.name,
                metavar=each.metavar,
                read=real(*each.trial_limits),
                default=each.default,
                help=each.help,
            )


def _declare_runs(parser: Parser, seeds: int) -> None:
    """Declare the radio's settings and the options of replication; `seeds` is the default number of runs."""
    _declare_radio(parser)
    _whole(parser, "--seeds", "N", seeds, "How many times, each with chances of its own.", whole(1, SEEDS_MAX))
    _whole(parser, "--seed", "S", 0, "The first seed; the same seeds give the same output.", whole())
    _whole(parser, "--jobs", "N", 1, "Processes that share the work; the output is the same.", whole(1, JOBS_MAX))
    parser.flag("--json", dest="as_json", help="Print one JSON document on stdout.")


def _whole(parser: Parser, name: str, metavar: str, default: int, text: str, read: Read = ANY_WHOLE) -> None:
    parser.option(name, metavar=metavar, read=read, default=default, help=text)


def _real(parser: Parser, name: str, metavar: str, default: float, text: str) -> None:
    parser.option(name, metavar=metavar, read=ANY_REAL, default=default, help=text)


def _declare_payload(parser: Parser) -> None:
    _whole(parser, "--payload", "B", 50, "Octets that each frame carries.")
    parser.flag("--unicast", help="To one station, which acknowledges; else to all.")


def _declare_psdu(parser: Parser) -> None:
    _whole(parser, "--psdu", "B", 61, "Octets of a frame with header and check sequence: payload + 11.")


def _declare_saturated(parser: Parser) -> None:
    parser.flag("--saturated", help="As many frames as will go, instead of a rate.")


# ---- the experiments


def _declare_contention(parser: Parser) -> None:
    _whole(parser, "--senders", "N", 10, "Stations that send, 10 m around one that only listens.")
    _real(parser, "--offered-fps", "F", 100.0, "Frames a second that they want to send, all together.")
    _declare_saturated(parser)
    _declare_payload(parser)
    _real(parser, "--seconds", "S", 60.0, "Virtual time that counts, of each run.")
    _declare_runs(parser, 10)


def _contention(
    senders: int, offered_fps: float, saturated: bool, payload: int, unicast: bool, seconds: float, **others: Any
) -> None:
    """Run the experiment of contention: share and latency of frames on a shared channel."""
    from rmr.radio.trials.contention import Contention, run

    with _refused():
        case = Contention(senders, None if saturated else offered_fps, payload, unicast, seconds)
    load = "as fast as they can" if saturated else f"{offered_fps:g} frames/s in all"
    to = "to the sink, acknowledged" if unicast else "to all"
    title = f"{counted(senders, 'station')}, {load}, {payload} octets {to}, {seconds:g} s"
    _print_result(title, partial(run, case), others)


def _declare_hidden(parser: Parser) -> None:
    parser.option(
        "--case",
        dest="name",
        metavar="|".join(CASES),
        read=one_of(CASES),
        default="hidden",
        help="hidden: A and C do not hear each other. exposed_control: as far from B, but they do. near_far_hidden: "
        "hidden, and C is the stronger.",
    )
    _real(parser, "--load-fps", "F", 25.0, "Frames a second that each of the two wants to send.")
    _declare_saturated(parser)
    _declare_payload(parser)
    _real(parser, "--seconds", "S", 120.0, "Virtual time that counts, of each run.")
    _declare_runs(parser, 10)


def _hidden(
    name: str, load_fps: float, saturated: bool, payload: int, unicast: bool, seconds: float, **others: Any
) -> None:
    """Run the experiment of hidden stations: frames that arrive at B from A and C out of each other's range."""
    from rmr.radio.trials.hidden import Hidden, distances, run

    with _refused():
        case = Hidden(name, None if saturated else load_fps, payload, unicast, seconds)
        a_m, c_m = distances(name, _config(others))
    load = "as fast as they can" if saturated else f"{load_fps:g} frames/s each"
    to = "acknowledged" if unicast else "to all"
    title = f"A at {a_m:.1f} m and C at {c_m:.1f} m from B, {load}, {payload} octets {to}, {seconds:g} s"
    _print_result(title, partial(run, case), others)


def _declare_storm(parser: Parser) -> None:
    _whole(parser, "--members", "N", 10, "Stations that answer.")
    _real(parser, "--jitter-ms", "J", 50.0, "Each waits a random time up to so long before it answers.")
    parser.choice(
        "--geometry",
        ["circle", "disk"],
        default="circle",
        help="circle: all at 10 m from the sender of the question. disk: anywhere within 20 m of it.",
    )
    _declare_payload(parser)
    _declare_runs(parser, 100)


def _storm(members: int, jitter_ms: float, geometry: str, payload: int, unicast: bool, **others: Any) -> None:
    """Run the experiment of a reply storm: answers of all receivers to one broadcast."""
    from rmr.radio.trials.storm import GEOMETRIES, Storm, run

    with _refused():
        case = Storm(members, jitter_ms, geometry, payload, unicast)
    to = "acknowledged" if unicast else "to all"
    who = f"{counted(members, 'member')}, {GEOMETRIES[geometry]}"
    _print_result(f"{who}, replies of {payload} octets {to} within {jitter_ms:g} ms", partial(run, case), others)


def _declare_overlap(parser: Parser) -> None:
    _real(parser, "--sir", "DB", 6.0, "Power of the first frame over that of the second, dB.")
    _real(parser, "--offset", "US", 100.0, "By how much the second begins later, us.")
    _declare_psdu(parser)
    _whole(parser, "--frames", "N", 400, "Pairs of frames of each run.")
    _declare_runs(parser, 1)


def _overlap(sir: float, offset: float, psdu: int, frames: int, **others: Any) -> None:
    """Run the experiment of overlap: capture of one of two simultaneous frames."""
    from rmr.radio.trials.overlap import Overlap, run, second_m

    with _refused():
        case = Overlap(sir, offset, psdu, frames)
        second_m(case, _config(others))
    title = f"the first {sir:g} dB over the second, which begins {offset:g} us later"
    _print_result(title, partial(run, case), others)


def _declare_latency(parser: Parser) -> None:
    _declare_payload(parser)
    _whole(parser, "--frames", "N", 2000, "Frames of each run.")
    _declare_runs(parser, 1)


def _latency(payload: int, unicast: bool, frames: int, **others: Any) -> None:
    """Run the experiment of latency: one sender on an idle channel."""
    from rmr.radio.trials.latency import Latency, run

    with _refused():
        case = Latency(payload, unicast, frames)
    title = f"{payload} octets {'to one, acknowledged' if unicast else 'to all'}, {frames} frames"
    _print_result(title, partial(run, case), others)


def _declare_link(parser: Parser) -> None:
    parser.option("--distance", metavar="M", read=ANY_REAL, required=True, help="Metres from sender to receiver.")
    _declare_psdu(parser)
    parser.option("--frames", metavar="N", read=ANY_WHOLE, help="Also send so many, in each run, and count.")
    _declare_runs(parser, 1)


def _link(distance: float, psdu: int, frames: int | None, **others: Any) -> None:
    """Run the experiment of a link: power and reception over a distance."""
    from rmr.radio.trials.link import LinkTrial, run

    with _refused():
        case = LinkTrial(distance, psdu, frames)
    title = f"{distance:g} m, a frame of {psdu} octets" + (f", {frames} sent" if frames else "")
    _print_result(title, partial(run, case), others)


EXPERIMENTS: dict[str, tuple[str, Command]] = {
    "contention": (
        "Many stations share the channel.",
        Command(
            "How many frames arrive, and how late, when many stations in range of each other send at random.",
            _declare_contention,
            _contention,
        ),
    ),
    "hidden": (
        "Two stations that cannot hear each other.",
        Command(
            """\
How many frames arrive at B from A and C, which cannot hear each other.

They stand as far from B as the radio reaches well: 15 m with the radio of the defaults.
""",
            _declare_hidden,
            _hidden,
        ),
    ),
    "storm": (
        "A broadcast that all receivers answer.",
        Command(
            "How many answers to one broadcast arrive when all receivers answer. One run is one storm.",
            _declare_storm,
            _storm,
        ),
    ),
    "overlap": (
        "Two frames at once.",
        Command(
            "Which of two frames at once is received, by their powers. The first comes from 10 m.",
            _declare_overlap,
            _overlap,
        ),
    ),
    "latency": (
        "One sender alone.",
        Command("How long a frame takes over 10 m on an idle channel.", _declare_latency, _latency),
    ),
    "link": (
        "One frame over a distance.",
        Command(
            """\
How strong a frame is after a distance, and how likely it is received.

Nobody else is on the air. Under shadowing the shares are means of all links of that length. With --frames they
are what was counted on one such link in each run.
""",
            _declare_link,
            _link,
        ),
    ),
}
"""Name of each experiment -> its summary and its command."""


def _loaded(command: Command) -> Runnable:
    return command


command = CommandGroup(
    """\
Try in virtual time what the radio of a lab will carry, before anything is deployed.

Each subcommand is one experiment with the radio that robots and simulator have: IEEE 802.15.4 at 2.4 GHz without
beacons. Shares and times come with the interval in which the true value lies 95 times of 100.
""",
    {name: Subcommand(summary, partial(_loaded, experiment)) for name, (summary, experiment) in EXPERIMENTS.items()},
)


# ---- how they are run


@contextmanager
def _refused() -> Iterator[None]:
    """Context that reports a ValueError of an experiment's parameters as wrong usage."""
    try:
        yield
    except ValueError as error:
        raise CommandLineError(str(error)) from None


def _print_result(title: str, run: Callable[["Runs"], "Row"], others: dict[str, Any]) -> None:
    """Run an experiment and print its result row."""
    from rmr.radio.trials import Runs

    seeds = range(others["seed"], others["seed"] + others["seeds"])
    row = run(Runs(_config(others), seeds, _over(others["jobs"])))
    if others["as_json"]:
        print_json(row)
    else:
        print(f"{title}; {counted(len(seeds), 'run')}\n\n{row_text(row)}", end="")


def _config(others: dict[str, Any]) -> "RadioConfig":
    from rmr.radio.phy import RadioConfig

    return RadioConfig(**{each.name: others[each.name] for each in SETTINGS if each.option})


def _over(jobs: int) -> "Over":
    """Return the function that runs replications in `jobs` processes, with progress on a terminal."""

    def over(trial: Callable[[int], _Sample], seeds: Sequence[int]) -> Iterator[_Sample]:
        with _samples(trial, seeds, min(jobs, len(seeds))) as samples:
            if sys.stderr.isatty() and len(seeds) > 1:
                yield from _shown(samples, len(seeds))
            else:
                yield from samples

    return over


def _shown(samples: Iterator[_Sample], number: int) -> Iterator[_Sample]:
    """Yield the `number` `samples` with a progress line on the terminal."""
    try:
        for done, sample in enumerate(samples, 1):
            print(f"\r\x1b[Kruns  {done} of {number}", end="", file=sys.stderr, flush=True)
            yield sample
    finally:
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)


# Ctrl-C is deferred while the workers start. They inherit the blocked signal, so that only this process handles it.
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


# ---- the results of `rmr radio` as text: the label of each field of a row, and its unit
#
# One table names all fields that are shown; a field that is not in it only stands in the JSON.

NAMES: dict[str, tuple[str, str]] = {
    "delivery_ratio_sink": ("arrive at the sink", "%"),
    "channel_access_failure_ratio": ("find no free channel", "%"),
    "no_ack_ratio": ("are never acknowledged", "%"),
    "collision_loss_ratio_at_sink_given_transmitted": ("of those sent, do not arrive", "%"),
    "delivery_ratio_all_receivers": ("arrive at a station, mean of all", "%"),
    "duplicates_per_delivered": ("arrive twice", "%"),
    "throughput_sink_fps": ("arrive at the sink", "frames/s"),
    "mean_access_delay_ms": ("until on the air, mean", "ms"),
    "p95_access_delay_ms": ("until on the air, 95 of 100", "ms"),
    "mean_e2e_ms": ("until arrived, mean", "ms"),
    "p95_e2e_ms": ("until arrived, 95 of 100", "ms"),
    "p99_e2e_ms": ("until arrived, 99 of 100", "ms"),
    "mean_service_ms": ("time in the radio, mean", "ms"),
    "attempts_per_transmitted_frame": ("attempts of a frame on the air", ""),
    "delivery_ratio": ("arrive at B", "%"),
    "confirmed_over_offered": ("done with at the end", "%"),
    "caf_ratio": ("find no free channel", "%"),
    "attempts_per_offered": ("attempts of a frame", ""),
    "both_delivery_ratio": ("arrive at B, mean of both", "%"),
    "discovery_heard_ratio": ("members that hear the discovery", "%"),
    "reply_delivery_ratio": ("replies that arrive", "%"),
    "all_replies_received_prob": ("storms in which all replies arrive", "%"),
    "last_reply_ms": ("the last reply arrives after", "ms"),
    "median_reply_ms": ("half of the replies within", "ms"),
    "attempts_per_member": ("attempts of a reply", ""),
    "member_hears_other_reply_ratio": ("replies that another member hears", "%"),
    "first_ok": ("the first frame is received", "%"),
    "second_ok": ("the second frame is received", "%"),
    "access_ms": ("until on the air", "ms"),
    "oneway_ms": ("until arrived", "ms"),
    "confirm_ms": ("until confirmed", "ms"),
    "rx_dbm": ("power at the receiver (RSSI)", "dBm"),
    "snr_db": ("power over the noise", "dB"),
    "lqi": ("link quality (LQI), 0 to 255", ""),
    "ber": ("bits wrong", "%"),
    "per": ("frames lost", "%"),
    "success": ("frames received", "%"),
    "airtime_us": ("time on the air", "us"),
}
"""Field -> label and unit; with the unit ``%`` the field is a share."""

WIDTH = max(len(words) for words, _ in NAMES.values())


def row_text(row: Mapping[str, Any]) -> str:
    """Return the lines of a table."""
    return "".join(f"{line}\n" for line in _lines(row, ""))


def _lines(row: Mapping[str, Any], indent: str) -> Iterator[str]:
    for name, value in row.items():
        if name in NAMES:
            words, unit = NAMES[name]
            yield f"{indent}{words:{WIDTH}}{_value(value, unit)}".rstrip()
        elif isinstance(value, dict) and any(field in NAMES for field in value):
            yield f"{indent}{name}"
            yield from _lines(value, indent + "  ")


def _value(value: Any, unit: str) -> str:
    """Return a value with unit and confidence interval, or a distribution as mean, 95th percentile and maximum.

    All values with intervals are counts, times or shares: intervals are clipped to the possible range.
    """
    if not isinstance(value, dict):
        return f"{_number(value, unit)} {unit}"
    if "max" in value:
        mean, usual, longest = (_number(value[name], unit) for name in ("mean", "p95", "max"))
        return f"{mean} {unit}, 95 of 100 within {usual.strip()}, all within {longest.strip()}"
    if value.get("n_reps") == 0:
        return f"{'-':>9}"  # there was nothing to take it from, in no run
    middle = _number(value["mean"] if "mean" in value else value["p"], unit)
    if value["ci95"] is None:
        return f"{middle} {unit}"
    most = 1.0 if unit == "%" else inf
    low, high = (_number(min(max(end, 0.0), most), unit).strip() for end in value["ci95"])
    return f"{middle} {unit:8}  {low} .. {high}"


def _number(value: float, unit: str) -> str:
    return f"{100 * value:9.2f}" if unit == "%" else f"{value:9.2f}" if isinstance(value, float) else f"{value:9}"
