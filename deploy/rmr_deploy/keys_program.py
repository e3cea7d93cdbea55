"""The subcommands and options of `rmr keys`; `rmr.bus.authority` carries them out.

Importing this module loads next to nothing (see `rmr.entry`), and its help no cryptography.
"""
# ruff: noqa: PLC0415

import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rmr.entry import ExitCode, print_json, run

if TYPE_CHECKING:
    from rmr.bus.certificates import Holder
    from rmr.entry.command_line import CommandGroup, Parser

ABOUT = """\
Keys of a lab with `bus: {security: mtls}`: a CA in a folder, and certificates that it issues.

Each process of the lab is given a folder with its own key and certificate, and names it with --keys DIR.
"""

EPILOG = "The folder of the CA stays with whoever issues keys. No process needs it."


# --- options


def _declare_folder(parser: "Parser") -> None:
    parser.positional("folder", "DIR", help="the folder of the CA")


def _declare_init(parser: "Parser") -> None:
    _declare_folder(parser)
    _declare_days(parser, "3650")


def _declare_days(parser: "Parser", default: str) -> None:
    from rmr.entry.command_line import whole

    parser.option("--days", metavar="N", read=whole(1, 36500), help=f"valid for N days (default: {default})")


def _declare_issue(parser: "Parser") -> None:
    _declare_folder(parser)
    parser.option(
        "--robot",
        metavar="N",
        dest="robots",
        repeatable=True,
        help="the process of robot N; 1-3: one process with all of them",
    )
    parser.flag("--world", help="the world, which may listen")
    parser.option("--router", metavar="HOST", dest="routers", repeatable=True, help="the router of a host")
    parser.option(
        "--operator",
        metavar="NAME",
        dest="operators",
        repeatable=True,
        help="who steers the lab: rmr fault, rmr load, rmr sign",
    )
    parser.option("--viewer", metavar="NAME", dest="viewers", repeatable=True, help="who watches: rmr attach, rmr view")
    parser.option(
        "--host",
        metavar="NAME_OR_IP",
        dest="hosts",
        repeatable=True,
        help="the world or router is reached under this name or address, too",
    )
    _declare_days(parser, "365")


def _declare_list(parser: "Parser") -> None:
    _declare_folder(parser)
    parser.flag("--json", dest="as_json", help="as a JSON document")


def _declare_bundle(parser: "Parser") -> None:
    _declare_folder(parser)
    parser.positional("who", "WHO", read=_who, help="as rmr keys list shows it: robot/4, world, router/HOST")
    parser.option(
        "-o",
        "--output",
        metavar="OUT",
        read=Path,
        required=True,
        help="a new folder, or with the ending .tar an archive",
    )


def _declare_revoke(parser: "Parser") -> None:
    _declare_folder(parser)
    parser.positional("who", "WHO", read=_who, help="as rmr keys list shows it: robot/4, world, router/HOST")


def _who(text: str) -> "Holder":
    from rmr.bus.authority import holder
    from rmr.bus.certificates import Holder

    named = Holder.read(text)
    return holder(named.role, named.name)


# --- subcommands


def _init(folder: Path, days: int | None) -> None:
    from rmr.bus.authority import CA_DAYS, Authority

    Authority.begin(folder, days or CA_DAYS)
    print(f"{folder}: a new CA; keep the folder to yourself, and a copy of it in another place")


def _issue(
    folder: Path,
    robots: Sequence[str],
    world: bool,
    routers: Sequence[str],
    operators: Sequence[str],
    viewers: Sequence[str],
    hosts: Sequence[str],
    days: int | None,
) -> None:
    from rmr.bus.authority import LEAF_DAYS, Authority, check_host, holder
    from rmr.bus.certificates import LISTENERS, moment
    from rmr.entry.command_line import CommandLineError

    named = {"robot": robots, "world": [""] if world else [], "router": routers, "operator": operators}
    try:
        all_of = [holder(role, name) for role, names in (named | {"viewer": viewers}).items() for name in names]
        known_as = list(map(check_host, hosts))
    except ValueError as error:
        raise CommandLineError(str(error)) from None
    if not all_of:
        raise CommandLineError("say for whom: --robot N, --world, --router HOST, --operator NAME or --viewer NAME")
    if twice := [who for who in all_of if all_of.count(who) > 1]:
        raise CommandLineError(f"{twice[0]} is named twice")
    if known_as and (len(all_of) > 1 or all_of[0].role not in LISTENERS):
        raise CommandLineError("--host goes with one --world or one --router: nobody else listens")
    authority = Authority(folder)
    index = authority.index()
    before = {one.who for one in index if one.revoked is None}
    listeners = {who for who in before if who.partition("/")[0] in LISTENERS}
    new = set(map(str, all_of)) - {one.who for one in index}
    for who in all_of:
        issued = authority.issue(who, known_as, days or LEAF_DAYS)
        until = moment(datetime.fromisoformat(issued.valid_until))
        print(f"issued {who}, serial {issued.serial}, valid until {until}")
        if str(who) in before:
            print(f"  the one before is valid, too, until it expires, or rmr keys revoke {folder} {who}")
    if listeners and new:
        names, where = ", ".join(sorted(new)), ", ".join(sorted(listeners))
        print(f"{names} may do nothing yet: write the bundles of {where} anew, and restart whichever of them listens")


def _list(folder: Path, as_json: bool) -> None:
    from rmr.bus.authority import Authority
    from rmr.bus.certificates import moment

    index, now = Authority(folder).index(), datetime.now(UTC)
    newest = {one.who: one for one in index}
    states = [one.state(newest[one.who], now) for one in index]
    if as_json:
        print_json({"issued": [asdict(one) | {"state": state} for one, state in zip(index, states, strict=True)]})
        return
    width = max([len(one.who) for one in index] + [3])
    print(f"{'WHO':{width}}  {'VALID UNTIL':23}  {'STATE':21}  SERIAL")
    for one, state in zip(index, states, strict=True):
        print(f"{one.who:{width}}  {moment(datetime.fromisoformat(one.valid_until))}  {state:21}  {one.serial}")


def _bundle(folder: Path, who: "Holder", output: Path) -> None:
    from rmr.bus.authority import Authority, write_bundle

    files = Authority(folder).bundle(who)
    write_bundle(files, output)
    print(f"{output}: {', '.join(files)} of {who}")


def _revoke(folder: Path, who: "Holder") -> None:
    from rmr.bus.authority import Authority

    number = Authority(folder).revoke(who)
    what = "its certificate" if number == 1 else f"all {number} certificates"
    print(f"revoked {who}: {what}; give each router, and a world that listens, a new bundle, and restart it")
    if who.role == "operator":
        print(f"  and each robot: until then it takes programs that {who} has signed")


def _told(perform: Callable[..., None]) -> Callable[..., int]:
    """Return `perform` with its errors told as sentences, and an exit code."""

    def told(**options: Any) -> int:
        from rmr.bus.endpoint import BusError

        try:
            perform(**options)
        except BusError as error:
            print(f"rmr keys: {error}", file=sys.stderr)
            return ExitCode.INVALID
        except OSError as error:
            print(f"rmr keys: {error.filename or options['folder']}: {error.strerror}", file=sys.stderr)
            return ExitCode.USAGE
        return ExitCode.OK

    return told


SUBCOMMANDS: dict[str, tuple[str, Callable[["Parser"], None], Callable[..., None]]] = {
    "init": ("Make a CA in a new folder.", _declare_init, _init),
    "issue": ("Issue certificates; to somebody who has one, another.", _declare_issue, _issue),
    "list": ("List all certificates that were issued, and how they stand.", _declare_list, _list),
    "bundle": ("Write what one process needs to a folder or an archive.", _declare_bundle, _bundle),
    "revoke": ("Revoke all certificates that somebody has.", _declare_revoke, _revoke),
}
"""Name -> summary, the function that declares its options, the one that carries it out."""


def command() -> "CommandGroup":
    """Return the command."""
    from rmr.entry.command_line import Command, CommandGroup, Subcommand

    def loaded(name: str) -> Callable[[], Command]:
        summary, declare, perform = SUBCOMMANDS[name]
        return lambda: Command(summary, declare, _told(perform), EPILOG)

    return CommandGroup(ABOUT, {name: Subcommand(each[0], loaded(name)) for name, each in SUBCOMMANDS.items()})


def main(words: Sequence[str] | None = None, name: str = "rmr keys") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: command().main(words, name))


if __name__ == "__main__":
    sys.exit(main())
