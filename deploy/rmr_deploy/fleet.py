"""The verbs that show and steer a lab that runs, `rmr ls`, `rmr ps`, `rmr down` and so on.

There is no daemon: a verb finds the run by its record (`active_runs`) and asks its launcher (`run_requests`). Importing
this module loads next to nothing (see `rmr.entry`); a verb imports what carries it out, and the bus only with --connect
and for `rmr attach`.
"""
# ruff: noqa: PLC0415

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rmr.entry import run

if TYPE_CHECKING:
    from rmr.entry.command_line import CommandGroup, Parser
    from rmr_deploy.run_requests import Who

# --- what the words of an option mean


def _robots(text: str) -> tuple[int, ...]:
    from rmr.base.ids import listed

    return listed(text)


def robots_or_service(text: str) -> "tuple[Who, ...]":
    """Return the robots, or the process without which no run goes on, that `text` names. Raises ValueError."""
    from rmr_deploy.run_requests import service_named

    if (service := service_named(text)) is not None:
        return (service,)
    try:
        return _robots(text)
    except ValueError as error:
        raise ValueError(f"{error}; or world, or router") from None


def _signal(text: str) -> int:
    from rmr_deploy.robot_orders import signal_number

    return signal_number(text)


def _length_s(text: str) -> float:
    from rmr.base.time import in_seconds
    from rmr_world.units import duration

    return in_seconds(duration(float(text) if text.replace(".", "", 1).isdecimal() else text))


# --- options


def _declare_places(parser: "Parser") -> None:
    """Declare which run is meant, of this machine or of others."""
    parser.option("--run", dest="folder", metavar="DIR", read=Path, help="The run folder, if several labs run.")
    parser.option("--lab", metavar="NAME", help="The name of the lab, if several run.")
    declare_connect(parser)


def declare_connect(parser: "Parser") -> None:
    """Declare where a lab over several hosts runs, of which this machine need be none."""
    parser.option("--connect", metavar="ENDPOINT", help="Where the router of a lab over several hosts listens.")
    parser.option("--secret", metavar="FILE", read=Path, help="Of its bus, with --connect.")
    parser.option("--keys", metavar="DIR", read=Path, help="The folder with an operator's keys, with --connect.")


def at_place(perform: Callable[..., int], *, acts: bool, **options: Any) -> int:
    """Carry out `perform`, for the lab that --connect names if it does. Raises FleetError."""
    from rmr.bus.certificates import credentials_path
    from rmr.entry.command_line import CommandLineError

    connect, secret, keys = (options.pop(name, None) for name in ("connect", "secret", "keys"))
    if connect is None:
        for word, value in (("--secret", secret), ("--keys", keys)):
            if value is not None:
                raise CommandLineError(f"{word} goes with --connect ENDPOINT")
        return perform(**options)
    if options["folder"] is not None:
        raise CommandLineError("say --connect or --run, not both")
    from rmr_deploy.remote_lab import opened_lab

    with opened_lab(connect, credentials_path(secret, keys, [connect]), options["lab"], acts=acts) as there:
        return perform(**options, there=there)


def _declare_json(parser: "Parser") -> None:
    parser.flag("--json", dest="as_json", help="As JSON.")


def _declare_ls(parser: "Parser") -> None:
    parser.flag("-a", "--all", dest="everything", help="Those in ./runs that are over, too.")
    _declare_json(parser)


def _declare_ps(parser: "Parser") -> None:
    parser.flag("-a", "--all", dest="everything", help="Processes that have ended, too; also after the run.")
    _declare_json(parser)
    _declare_places(parser)


def _declare_lines(parser: "Parser") -> None:
    from rmr.entry.command_line import whole

    parser.flag("-f", "--follow", help="Go on until the run is over.")
    parser.option("--since", dest="since_s", metavar="T", read=_length_s, help="Of the last T, such as 10s, only.")
    parser.option("-n", "--tail", metavar="N", read=whole(0), help="The last N lines only, of those that are there.")
    parser.flag("--json", dest="as_json", help="A JSON object in each line.")
    _declare_places(parser)


def _declare_logs(parser: "Parser") -> None:
    _declare_lines(parser)
    parser.positional("robots", "ROBOT", read=robots_or_service, count="*", usage="[ROBOT...]")


def _declare_robots(parser: "Parser") -> None:
    _declare_places(parser)
    parser.positional("robots", "ROBOT", read=robots_or_service, count="+", usage="ROBOT...")


def _declare_kill(parser: "Parser") -> None:
    parser.option("-s", "--signal", metavar="SIGNAL", read=_signal, default="KILL", help="Such as TERM or 15.")
    _declare_robots(parser)


def _declare_patient(parser: "Parser") -> None:
    from rmr.entry.command_line import real

    parser.option("-t", "--timeout", dest="timeout_s", metavar="S", read=real(0), default="10", help="Then kill.")
    _declare_robots(parser)


def _declare_restart(parser: "Parser") -> None:
    parser.flag("--force", help="Stop a robot that runs in order first.")
    _declare_patient(parser)


def _declare_usage(parser: "Parser") -> None:
    parser.flag("--once", help="Once, instead of each second until the run is over.")
    _declare_json(parser)
    _declare_places(parser)


def _declare_facts(parser: "Parser") -> None:
    parser.option("--predicate", metavar="NAME", help="Facts of this predicate only.")
    _declare_json(parser)
    _declare_places(parser)
    parser.positional("robots", "ROBOT", read=_robots, count="*", usage="[ROBOT...]")


def _declare_config(parser: "Parser") -> None:
    _declare_places(parser)
    parser.positional("source", "LAB", count="?", usage="[LAB]")


def _declare_attach(parser: "Parser") -> None:
    from rmr.bus.endpoint import DEFAULT_ENDPOINT
    from rmr.entry.command_line import real
    from rmr_world.provided_labs import existing_lab

    parser.positional("lab", "LAB", read=existing_lab)
    where = f"Where the world listens (default: {DEFAULT_ENDPOINT}; with keys tls)."
    parser.option("--connect", metavar="ENDPOINT", help=where)
    parser.option("--secret", metavar="FILE", read=Path, help="Of the bus, if it has one.")
    parser.option("--keys", metavar="DIR", read=Path, help="The folder with an operator's or a viewer's keys.")
    limit = "Seconds for the world to answer, and to return."
    parser.option("-t", "--timeout", dest="timeout_s", metavar="S", read=real(0), default="10", help=limit)
    parser.flag("--json", dest="as_json", help="The report on standard output, all else on standard error.")
    parser.flag("--strict", help="Exit code 4 when a deadline was missed or robots touched.")


def _declare_down(parser: "Parser") -> None:
    from rmr.entry.command_line import real

    parser.flag("--all", dest="everything", help="All labs that run on this machine.")
    parser.option("-t", "--timeout", dest="timeout_s", metavar="S", read=real(0), help="Then kill (default: 30).")
    _declare_places(parser)


def _declare_wait(parser: "Parser") -> None:
    from rmr.entry.command_line import real

    parser.option("-t", "--timeout", dest="timeout_s", metavar="S", read=real(0), help="Seconds to wait at most.")
    _declare_places(parser)


# --- verbs


def _ls(**options: Any) -> int:
    from rmr_deploy.fleet_listing import list_labs

    return list_labs(**options)


def _ps(**options: Any) -> int:
    from rmr_deploy.fleet_listing import list_processes

    return list_processes(**options)


def _logs(robots: "list[tuple[Who, ...]]", **options: Any) -> int:
    from rmr_deploy.run_logs import show_logs

    return show_logs(robots=[robot for group in robots for robot in group], **options)


def _events(**options: Any) -> int:
    from rmr_deploy.run_logs import show_logs

    return show_logs(**options, events_only=True)


def _order(verb: str) -> Callable[..., int]:
    """Return what carries out an order about robots."""

    def carry_out(robots: "list[tuple[Who, ...]]", **options: Any) -> int:
        from rmr_deploy.robot_orders import give_order

        return give_order(verb, [robot for group in robots for robot in group], **options)

    return carry_out


def _usage(**options: Any) -> int:
    from rmr_deploy.fleet_listing import show_usage

    return show_usage(**options)


def _facts(robots: list[tuple[int, ...]], **options: Any) -> int:
    from rmr_deploy.fleet_listing import show_facts

    return show_facts([robot for group in robots for robot in group], **options)


def _config(**options: Any) -> int:
    from rmr_deploy.fleet_listing import show_config

    return show_config(**options)


def _attach(**options: Any) -> int:
    from rmr.bus.certificates import credentials_path, default_endpoint
    from rmr_deploy.attach import AttachOptions, attach

    options["secret"] = credentials_path(options["secret"], options.pop("keys"), [options["connect"]])
    options["connect"] = options["connect"] or default_endpoint(options["secret"])
    return attach(AttachOptions(**options))


def _down(**options: Any) -> int:
    from rmr_deploy.run_stop import bring_down

    return bring_down(**options)


def _wait(**options: Any) -> int:
    from rmr_deploy.run_stop import wait_for_end

    return wait_for_end(**options)


Row = tuple[str, Callable[["Parser"], None], Callable[..., int]]

VERBS: dict[str, Row] = {
    "ls": ("List the labs that run on this machine.", _declare_ls, _ls),
    "ps": ("List the processes of a lab that runs, and how its robots are.", _declare_ps, _ps),
    "logs": ("Show the logs of a run as one, by lab time; also after its end.", _declare_logs, _logs),
    "events": ("Show what befell the processes of a run.", _declare_lines, _events),
    "stats": ("Show processor time and memory of the processes, each second.", _declare_usage, _usage),
    "facts": ("Show the facts that robots hold; also after the run.", _declare_facts, _facts),
    "config": ("Show the lab of a run, or a lab file, with all defaults.", _declare_config, _config),
    "kill": ("Kill robots or the world, or send them another signal.", _declare_kill, _order("kill")),
    "stop": ("Stop robots in order; the run goes on without them.", _declare_patient, _order("stop")),
    "start": ("Start robots again that have ended.", _declare_robots, _order("start")),
    "restart": ("Start robots again, with --force also those that run.", _declare_restart, _order("restart")),
    "pause": ("Hold robots' processes until they are unpaused.", _declare_robots, _order("pause")),
    "unpause": ("Let paused robots go on.", _declare_robots, _order("unpause")),
    "attach": ("Show table and report of a lab that was started by hand.", _declare_attach, _attach),
    "wait": ("Wait until a run is over; the exit code is that of rmr up.", _declare_wait, _wait),
    "down": ("End a run in order, and wait until nothing of it is left.", _declare_down, _down),
}
"""Name -> what it does, its options, and what carries it out."""

ABOUT = """\
Show and steer labs that run.

A verb means the only lab that runs on this machine; if several run, choose with --run or --lab. With --connect they
mean a lab over several hosts that runs on other machines.
"""


def command() -> "CommandGroup":
    """Return the command."""
    from rmr.entry.command_line import Command, CommandGroup, Subcommand

    def carried_out(name: str, perform: Callable[..., int]) -> Callable[..., int]:
        def carry_out(**options: Any) -> int:
            from rmr_deploy.run_choice import performed

            if perform is _attach:
                return performed(name, lambda: _attach(**options))
            acts = name not in ("ps", "logs", "events", "facts", "stats", "config", "wait")
            return performed(name, lambda: at_place(perform, acts=acts, **options))

        return carry_out

    def entry(name: str, row: Row) -> Subcommand:
        return Subcommand(row[0], lambda: Command(row[0], row[1], carried_out(name, row[2])))

    return CommandGroup(ABOUT, {name: entry(name, row) for name, row in VERBS.items()})


def main(words: Sequence[str] | None = None, name: str = "rmr") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: command().main(words, name))


if __name__ == "__main__":
    sys.exit(main())
