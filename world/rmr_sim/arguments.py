"""The words of `rmr sim`, and back: the words that repeat a run."""

import argparse
import os
import re
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from rmr.coord.timing import Order
from rmr.entry.command_line import CommandLineError, Parser, did_you_mean, real, whole
from rmr_sim.hunt.hunt_names import DEFAULT_PROPERTIES, METHODS, PROPERTIES
from rmr_world.provided_labs import existing_lab

SEEDS_MAX = 100_000
"""Of one sweep: days of work, and a sweep.json of 30 MB."""
JOBS_MAX = 64
"""Processes at once; more than any one machine of a lab has use for."""
WHOLE = "[0-9]{1,18}"
"""What fits 64 bits; of thousands of digits Python makes no number at all."""
ORDERS = "who goes first: most deadlines met (ours), earliest deadline, first come, or no coordination (none)"

NOT_HUNTING = {
    "seeds": "draws the seeds of its runs from --seed",
    "shard": "draws each run from those before it",
    "resume": "cannot be resumed",
    "chaos": "chooses the faults itself",
    "hard_chaos": "chooses the faults itself",
    "view": "shows no run",
    "trace": "writes no trace; the lab files that it writes repeat what it finds",
    "record": "writes no recording; the lab files that it writes repeat what it finds",
}
"""Options that a hunt does not have, and why."""

ABOUT = "Run a lab in virtual time; the same seed gives the same report."


def declare(parser: Parser) -> None:
    """Declare the options."""
    parser.positional("lab", "LAB", read=existing_lab, help="a lab.yaml, its folder, or a provided lab")
    parser.option("--seed", read=whole(), metavar="S", help="instead of the lab file's seed")
    parser.option("--seeds", read=_seeds, metavar="A-B", help="a sweep: a run of each seed, and their summary")
    parser.option(
        "--shard", read=shard_in, metavar="K/N", help="of a sweep the K-th of N shards: each N-th seed from the K-th"
    )
    parser.option("--resume", read=Path, metavar="RUN", help="go on with the sweep in this run folder")
    parser.option(
        "--jobs", read=whole(1, JOBS_MAX), metavar="N", help="processes that share a sweep (default: one per core)"
    )
    parser.option(
        "--on", read=_address, metavar="tcp://HOST:PORT", help="a Dask scheduler whose workers share a sweep or a hunt"
    )
    parser.option("--robots", read=whole(1), metavar="N", help="only the first N robots of the lab")
    parser.option("--loss", read=_share, metavar="SHARE", help="share of radio frames lost, instead of the lab's")
    parser.flag("--chaos", help="faults at random for a while, drawn from the seed")
    parser.flag("--hard-chaos", help="the same with longer stalls and partitions, and robots mute or deaf")
    parser.flag("--durable", help="restarted robots go on from their state instead of starting anew")
    parser.flag("--hunt", help="search for the smallest list of faults that breaks a property")
    parser.option("--budget", read=_time, metavar="T", help="of a hunt, such as 10m (default: 10m, unless --runs)")
    parser.option("--runs", read=whole(1), metavar="N", help="of a hunt at most: such a hunt can be repeated")
    parser.option("--findings", read=whole(1), metavar="N", default=1, help="after which a hunt ends")
    parser.option(
        "--properties",
        read=_some(PROPERTIES),
        metavar="LIST",
        default=",".join(DEFAULT_PROPERTIES),
        help=f"that a hunt may break, of {', '.join(PROPERTIES)}",
    )
    parser.option(
        "--methods", read=_some(METHODS), metavar="LIST", help=f"of a hunt, of {', '.join(METHODS)} (default: all)"
    )
    parser.choice("--order", [order.value for order in Order], default=Order.OURS.value, help=ORDERS)
    parser.option("--actions", read=Path, metavar="FILE.py", help="handlers of actions, instead of the lab's")
    parser.option("--events", read=Path, metavar="FILE.py", help="your own events, instead of the lab's")
    parser.option("--run", read=Path, metavar="DIR", help="folder for the report (default: runs/LAB-DATE-TIME)")
    parser.option("--trace", read=Path, metavar="FILE", help="write what happened as JSON lines")
    parser.flag("--view", help="show the run in the browser, at the speed of its lab time: pause, step, speed")
    parser.option("--port", read=whole(0, 65535), metavar="PORT", help="of the page (default: a free one)")
    parser.option("--speed", read=real(0.1, 100), metavar="X", help="of the run in the page (default: 1)")
    parser.flag("--control", help="the page may add faults, too; orders need the token in its address")
    parser.option("--record", read=Path, metavar="FILE", help="the recording (default: run.mcap in the run folder)")
    parser.flag("--no-record", help="write no recording")
    parser.flag("--json", help="the report as JSON on standard output")
    parser.flag("--strict", help="exit 4 when a deadline was missed or robots touched")


def parse(words: Sequence[str]) -> argparse.Namespace:
    """Return what `words` ask for, as if they were a command line. Raises CommandLineError."""
    parser = Parser("rmr sim", ABOUT)
    declare(parser)
    arguments = parser.read(words)
    check(arguments)
    return arguments


def check(arguments: argparse.Namespace) -> None:
    """Raise CommandLineError for options that do not go together."""
    if arguments.resume is not None and arguments.run is not None:
        raise CommandLineError("--resume goes on in its own run folder: leave out --run")
    if not arguments.view and (arguments.port is not None or arguments.speed is not None or arguments.control):
        raise CommandLineError("--port, --speed and --control are about the page: ask for it with --view")
    sweep = arguments.seeds is not None or arguments.resume is not None
    check_hunt(arguments)
    _check_shared(arguments, sweep=sweep)
    if sweep and arguments.seed is not None:
        raise CommandLineError("--seed is one run, --seeds a sweep: name one of them")
    if sweep and arguments.view:
        raise CommandLineError("--view shows one run: leave out --seeds and --resume")
    if sweep and arguments.record is not None:
        raise CommandLineError("--record is of one run; a sweep records none of its runs")
    if arguments.record is not None and arguments.no_record:
        raise CommandLineError("--record names a recording, --no-record wants none: leave one of them out")
    if sweep and arguments.trace is not None:
        raise CommandLineError("--trace is of one run; a sweep keeps the trace of each seed that fails")


def _check_shared(arguments: argparse.Namespace, *, sweep: bool) -> None:
    """Raise CommandLineError for options that do not go together with how runs are shared."""
    if not sweep and not arguments.hunt and arguments.jobs is not None:
        raise CommandLineError("--jobs shares the runs of a sweep or a hunt: name its --seeds, or --hunt")
    if arguments.shard is not None and not sweep:
        raise CommandLineError("--shard is a part of a sweep: name its --seeds")
    if arguments.shard is not None and arguments.seeds is not None and arguments.shard.of > len(arguments.seeds):
        raise CommandLineError(
            f"--shard {arguments.shard}: {len(arguments.seeds)} seeds cannot be shared by {arguments.shard.of}"
        )
    if arguments.on is not None and not (sweep or arguments.hunt):
        raise CommandLineError("--on shares the runs of a sweep or a hunt: name its --seeds, or --hunt")
    if arguments.on is not None and arguments.jobs is not None:
        raise CommandLineError("--jobs are processes of this machine, --on is a cluster: name one of them")


def check_hunt(arguments: argparse.Namespace) -> None:
    """Raise CommandLineError for options that do not go together with a hunt, or only with one."""
    given = [name for name in ("budget", "runs", "methods") if getattr(arguments, name) is not None]
    if not arguments.hunt and given:
        raise CommandLineError(f"--{given[0]} is about a hunt: ask for it with --hunt")
    if not arguments.hunt:
        return
    for name, reason in NOT_HUNTING.items():
        if getattr(arguments, name) not in {None, False}:
            raise CommandLineError(f"--hunt {reason}: leave out --{name.replace('_', '-')}")


def command_of(arguments: argparse.Namespace) -> str:
    """Return the command that, with a seed, repeats a run."""
    words = ["rmr", "sim", str(arguments.lab)]
    for name in ("robots", "loss", "actions", "events"):
        value = getattr(arguments, name)
        if value is not None:
            words += [f"--{name}", str(value)]
    if arguments.order != Order.OURS.value:
        words += ["--order", arguments.order]
    flags = ("chaos", "hard_chaos", "durable", "strict")
    words += [f"--{name.replace('_', '-')}" for name in flags if getattr(arguments, name)]
    return shlex.join(words)


def _share(text: str) -> float:
    share: float = real(0, 1)(text)
    if share == 1.0:
        raise ValueError(f"a share from 0 up to 1, not {text!r}")
    return share


def cores() -> int:
    """Return how many processors this process may use; where the system does not tell, how many there are."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(usable, JOBS_MAX)


def _time(text: str) -> int:
    """Return nanoseconds for 90s, 10m or 1.5h."""
    match = re.fullmatch(r"([0-9]{1,9}(?:\.[0-9]{1,9})?)(s|m|min|h)", text)
    time_ns = 0 if match is None else round(float(match[1]) * {"s": 1, "m": 60, "min": 60, "h": 3600}[match[2]] * 1e9)
    if not time_ns:
        raise ValueError(f"a time such as 90s, 10m or 2h, not {text!r:.40}")
    return time_ns


def _some(known: Sequence[str]) -> Callable[[str], tuple[str, ...]]:
    """Return the reader of a list of names, each of `known`."""

    def read(text: str) -> tuple[str, ...]:
        names = text.split(",")
        for name in names:
            if name not in known:
                raise ValueError(f"{name!r:.40} is none of {', '.join(known)}{did_you_mean(name, known)}")
        return tuple(dict.fromkeys(names))

    return read


class Shard(NamedTuple):
    """A part of a sweep's seeds: the `number`-th of `of` takes each `of`-th seed, from the `number`-th on."""

    number: int = 1
    of: int = 1

    def seeds(self, whole: range) -> range:
        """Return the seeds of this shard."""
        return whole[self.number - 1 :: self.of]

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"


def shard_in(text: str) -> Shard:
    """Return the shard that K/N names. Raises ValueError."""
    match = re.fullmatch(f"({WHOLE})/({WHOLE})", text)
    shard = None if match is None else Shard(int(match[1]), int(match[2]))
    if shard is None or not 1 <= shard.number <= shard.of <= SEEDS_MAX:
        raise ValueError(f"a shard such as 3/50, from 1/50 to 50/50, not {text!r:.40}")
    return shard


def _address(text: str) -> str:
    if re.fullmatch(r"(tcp|tls|wss?)://[^\s/:]+:[0-9]{1,5}|(tcp|tls)://\[[0-9a-fA-F:]+\]:[0-9]{1,5}", text) is None:
        raise ValueError(f"the address of a Dask scheduler, such as tcp://scheduler:8786, not {text!r:.60}")
    return text


def _seeds(text: str) -> range:
    match = re.fullmatch(f"({WHOLE})(?:-({WHOLE}))?", text)
    if match is None:
        raise ValueError(f"seeds such as 1-100, not {text!r:.40}")
    first = int(match[1])
    last = int(match[2] or match[1])
    if not first <= last < first + SEEDS_MAX:
        raise ValueError(f"from 1 to {SEEDS_MAX} seeds, the least first, not {text!r}")
    return range(first, last + 1)
