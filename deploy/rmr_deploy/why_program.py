"""The options of `rmr why`; `rmr_deploy.why_run` carries it out.

Importing this module loads next to nothing (see `rmr.entry`), and its help neither the compiler nor the replay.
"""
# ruff: noqa: PLC0415

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rmr.entry import run

if TYPE_CHECKING:
    from rmr.entry.command_line import Command, Parser

ABOUT = """Say why a fact holds, or why it does not.

The robots of a recorded run are executed anew, those that the answer needs, and the answer is the tree of rules, facts,
messages and actions that led to the fact, with instants and places in the program. RUN is a run folder, a run.mcap, or
the id of a robot of the lab that runs here. FACT is a fact, a goal (?at(@4, exit)) or an action; variables and _ match
anything, and each fact that matches is an answer, the newest first.

--missed explains deadlines instead: the time of a job (assertion@robot) as intervals, each with the one owner that the
job waited for."""


def _instant(text: str) -> int:
    from rmr_world.units import duration

    return duration(float(text) if text.replace(".", "", 1).isdecimal() else text)


def _declare(parser: "Parser") -> None:
    from rmr.entry.command_line import whole

    told = "A run folder, its run.mcap, or a robot of the lab that runs."
    parser.positional("where", "RUN", read=str, count="?", usage="RUN", help=told)
    parser.positional(
        "fact", "FACT", read=str, count="?", usage="[FACT]", help="Such as 'at(@4, exit)'; with --missed crossing@3."
    )
    parser.flag("--not", help="Why the fact does not hold: what was missing or in the way.", dest="absent")
    parser.option("--at", metavar="T", read=_instant, help="The instant of the question, such as 12.3s; else the end.")
    parser.option("--depth", metavar="N", read=whole(0, 100), default=3, help="Levels that are shown.")
    parser.option("--more", metavar="N", help="Go on at the number at which an answer was cut.")
    parser.flag("--missed", help="What the time of missed deadlines went into: all, or of one job (crossing@3).")
    parser.flag("--timeline", help="With --missed JOB: in the order of time instead of largest first.")
    parser.option("--lab", metavar="NAME", help="With the id of a robot: the lab, if several run.")
    parser.flag("--json", help="The answer as JSON.", dest="as_json")
    parser.flag("--dot", help="The answer as a graph for Graphviz.", dest="as_dot")


def _perform(**options: Any) -> int:
    from rmr_deploy.why_run import perform

    return perform(**options)


def why_command() -> "Command":
    """Return the command."""
    from rmr.entry.command_line import Command

    return Command(ABOUT, _declare, _perform)


def main(words: Sequence[str] | None = None, name: str = "rmr why") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: why_command().main(words, name))


if __name__ == "__main__":
    sys.exit(main())
