"""The options of `rmr up LAB` and of `rmr demo`; `rmr_deploy.lab_run` carries both out.

Importing this module loads next to nothing (see `rmr.entry`), and its help neither the bus nor the compiler.
"""
# ruff: noqa: PLC0415

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rmr.entry import run

if TYPE_CHECKING:
    from rmr.entry.command_line import Command, Parser

ABOUT = """\
Start LAB, a folder, its lab.yaml or a provided lab, as processes: a world and one process for each robot.

Waits until all are ready, runs until every robot holds the lab's finish fact, prints a table and leaves a
run folder with report.json and logs. Ctrl-C stops in order, twice at once. Other users of the machine can neither
use the bus of the run, which has a secret (the file secret in the run folder), nor read the folder.

With --here HOST it starts what the hosts file gives to this host; the same command on each host makes one lab.
"""


ABOUT_DEMO = """\
Show six robots that pass a narrow corridor in the order of their deadlines: rmr up with the provided lab corridor.

Takes about half a minute, in real time, and needs no clone and no file. Its last lines say how to see the run in the
browser. rmr sim corridor is the same in virtual time; rmr new NAME writes a lab of your own.
"""
DEMO_LAB = "corridor"


def _declare(parser: "Parser") -> None:
    from rmr.entry.command_line import real
    from rmr_world.provided_labs import existing_lab

    parser.positional("lab", "LAB", read=existing_lab)
    _declare_options(parser)
    parser.flag("--ros2", help="Show the simulated robots as robots of ROS 2: topics /robot_N/odom, /robot_N/scan ...")
    limit = "Seconds to wait for the other hosts (default: 300)."
    parser.option("--here", metavar="HOST", help="The share of this host alone, of a lab over several.")
    parser.option("--hosts", metavar="FILE", read=Path, help="Which host has what (default: `hosts` of the lab file).")
    parser.option("--secret", metavar="FILE", read=Path, help="With --here: the secret that all hosts share.")
    parser.flag("--open", dest="opened", help="With --here: without a secret; whoever reaches it can drive the robots.")
    parser.option("--wait-hosts", dest="wait_s", metavar="SECONDS", read=real(0, above=True), help=limit)


def _declare_options(parser: "Parser") -> None:
    from rmr.base.streams import SEED_MAX
    from rmr.entry.command_line import real, whole
    from rmr_deploy.restarts import restart_policy

    parser.flag("-d", "--detach", help="Run in the background; the command ends when the processes are started.")
    parser.flag("--wait", help="Run in the background; the command ends when all robots are ready.")
    parser.option("--robots", metavar="N", read=whole(1), help="The first N robots of the lab only.")
    parser.option("--seed", metavar="S", read=whole(0, SEED_MAX), help="In place of the lab's seed.")
    parser.option("--actions", metavar="FILE.py", read=Path, help="Handlers of the program's actions.")
    parser.flag("--json", dest="as_json", help="The report on standard output, all else on standard error.")
    parser.flag("--strict", help="Exit code 4 when a deadline was missed or robots touched.")
    parser.option("--run", dest="folder", metavar="DIR", read=Path, help="The run folder: new or empty.")
    parser.option("--record", metavar="FILE", read=Path, help="The recording, in place of run.mcap in the run folder.")
    parser.flag("--no-record", help="Write no recording.")
    parser.option("--timeout", dest="timeout_s", metavar="SECONDS", read=real(0, above=True), help="Wall time at most.")
    parser.option("--processes", metavar="N", read=whole(1), help="Spread the robots over N processes only.")
    parser.flag("--view", help="Print the address of the page, as on a terminal: the run in the browser.")
    parser.flag("--no-view", help="No page.")
    parser.option("--port", metavar="PORT", read=whole(0, 65535), help="Of the page (default: a free one).")
    parser.flag("--control", help="The page may disturb the radio, and kill, restart and stall robots.")
    parser.option(
        "--restart",
        metavar="POLICY",
        read=restart_policy,
        help="on-failure[:N]: start a robot that fails again, N times at most (default: no).",
    )
    parser.flag("--durable", help="Robots and world keep their state: one that is started again goes on.")
    parser.option(
        "--keys", metavar="DIR", read=Path, help="The folder of the CA, where the lab has security mtls (or RMR_KEYS)."
    )
    parser.flag("--watch", help="Compile the program when it is saved, and load it onto the running robots.")
    parser.flag("--keep-going", help="Go on without a robot that died; the exit code is 1 all the same.")


def _up(**options: Any) -> int:
    """Run a lab; return the exit code."""
    from rmr.entry.command_line import CommandLineError

    if options["no_view"] and (options["view"] or options["control"] or options["port"] is not None):
        raise CommandLineError("--no-view goes without --view, --control and --port")
    if options["record"] is not None and options["no_record"]:
        raise CommandLineError("--record names a recording, --no-record wants none: leave one of them out")
    from rmr_deploy.detached import detached_output, start_detached

    background = detached_output()
    detach, wait = options.pop("detach"), options.pop("wait")
    if background is None and (detach or wait):
        return start_detached(wait=wait, as_json=options["as_json"])
    from rmr_deploy.lab_run import perform
    from rmr_deploy.run_options import RunOptions

    return perform(RunOptions(**options), background)


def _demo(**options: Any) -> int:
    """Run the lab of the demo, whatever the current folder holds; return the exit code."""
    from rmr.entry import ExitCode
    from rmr_world.provided_labs import labs_folder, provided_labs

    lab = provided_labs().get(DEMO_LAB)
    if lab is None:
        where = labs_folder()
        print(f"rmr demo: {where} has no lab {DEMO_LAB}: install rmr-robots again, from a whole wheel", file=sys.stderr)
        return ExitCode.FAILED
    return _up(lab=lab, **options)


def command() -> "Command":
    """Return the command."""
    from rmr.entry.command_line import Command

    return Command(ABOUT, _declare, _up)


def main(words: Sequence[str] | None = None, name: str = "rmr up") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: command().main(words, name))


def demo_command() -> "Command":
    """Return the command `rmr demo`."""
    from rmr.entry.command_line import Command

    return Command(ABOUT_DEMO, _declare_options, _demo)


def demo_main(words: Sequence[str] | None = None, name: str = "rmr demo") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: demo_command().main(words, name))


if __name__ == "__main__":
    sys.exit(main())
