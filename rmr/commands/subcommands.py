"""The command `rmr`: the language's own subcommands, and the way to the other packages' commands.

Nothing is imported before it is needed, so that help and wrong usage cost next to nothing: each subcommand is a module
that is imported by its name, also those of packages that this one does not depend on.
"""

import sys
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from typing import NamedTuple

from rmr.entry import ExitCode
from rmr.entry.command_line import CommandGroup, Runnable, Subcommand

COMMANDS: dict[str, str] = {
    "check": "Check programs and labs and print what is wrong with them.",
    "compile": "Compile a program to byte-code.",
    "completion": "Print the script by which a shell completes commands.",
    "dis": "Print byte-code as annotated text, offsets in hex.",
    "eval": "Run a program on robots without bodies.",
    "explain": "Explain an error or a warning.",
    "fmt": "Bring programs into canonical layout.",
    "man": "Write a manual page for each command.",
    "radio": "Try what the radio will carry.",
    "record": "Join, recover and list recordings of runs.",
    "replay": "Execute the recorded minds of a run anew and check them.",
}
"""The language's own subcommands, each the `command` of its module, and their summaries."""

PROGRAMS: dict[str, tuple[str, str]] = {
    "up": ("rmr_deploy.up:main", "Run a lab with one process for each robot."),
    "demo": ("rmr_deploy.up:demo_main", "Show six robots that pass a corridor, as processes."),
    "doctor": ("rmr_deploy.doctor:main", "Say what this machine lacks for RMR, and what mends it."),
    "fault": ("rmr_deploy.fault:main", "Inject faults into a lab that runs: of the radio, and of robots."),
    "load": ("rmr_deploy.load:main", "Give running robots a new program."),
    "why": ("rmr_deploy.why_program:main", "Say why a fact of a run holds, or why it does not."),
    "sim": ("rmr_sim.main:main", "Run a lab deterministically, in virtual time."),
    "sweep": ("rmr_sim.main:sweep_main", "Merge the shards of a sweep."),
    "new": ("rmr_lab.main:new_main", "Write a lab of your own that runs at once."),
    "lab": ("rmr_lab.main:main", "List and copy labs; the schema of the lab file."),
    "view": ("rmr_view.view:main", "Show a run in the browser, while it goes on or afterwards."),
    "lsp": ("rmr_editor.main:main", "Serve an editor: diagnostics, hover, rename and so on."),
    "plot": ("rmr_view.plot:main", "Draw pictures of a run, or figures of experiments."),
    "agent": ("rmr_agent.main:main", "Run one robot."),
    "keys": ("rmr_deploy.keys_program:main", "Issue the keys by which processes of a lab know each other."),
    "sign": ("rmr_deploy.sign:main", "Sign a program, for robots that run signed ones alone."),
    "export": ("rmr_deploy.export:main", "Write units of systemd, or compose files, for the hosts of a lab."),
    "router": ("rmr_deploy.router:main", "Run a router between the hosts of a lab."),
    "world": ("rmr_world.main:main", "Run the world server of a lab."),
}
"""The subcommands of other packages, each the function that carries it out and its summary."""

FLEET: dict[str, str] = {
    "ls": "List the labs that run on this machine.",
    "ps": "List the processes of a lab that runs, and how its robots are.",
    "logs": "Show the logs of a run as one, by lab time; also after its end.",
    "events": "Show what befell the processes of a run.",
    "stats": "Show processor time and memory of the processes, each second.",
    "facts": "Show the facts that robots hold; also after the run.",
    "config": "Show the lab of a run, or a lab file, with all defaults.",
    "kill": "Kill robots or the world, or send them another signal.",
    "stop": "Stop robots in order; the run goes on without them.",
    "start": "Start robots again that have ended.",
    "restart": "Start robots again, with --force also those that run.",
    "pause": "Hold robots' processes until they are unpaused.",
    "unpause": "Let paused robots go on.",
    "attach": "Show table and report of a lab that was started by hand.",
    "wait": "Wait until a run is over; the exit code is that of rmr up.",
    "down": "End a run in order, and wait until nothing of it is left.",
}
"""The verbs that show and steer a lab that runs, and their summaries."""


class OtherPackage(NamedTuple):
    """A subcommand of a package that this one does not depend on: `function` is ``module:name``."""

    function: str
    verb: str = ""
    """The word that the function is given before all others: it carries out several subcommands."""

    def main(self, words: Sequence[str] | None = None, name: str = "rmr") -> int:
        """Carry out `words` as the command `name`; return the exit code."""
        module, _, function = self.function.partition(":")
        words = [*([self.verb] if self.verb else ()), *(sys.argv[1:] if words is None else words)]
        try:
            carry_out: Callable[[Sequence[str], str], int] = getattr(import_module(module), function)
        except ModuleNotFoundError as error:
            package = module.partition(".")[0]
            if error.name != package:
                raise
            print(f"{name}: {package} is not installed here; pip install rmr-robots brings all of it", file=sys.stderr)
            return ExitCode.FAILED
        return carry_out(words, name.removesuffix(f" {self.verb}") if self.verb else name)


def _own(name: str) -> Runnable:
    command: Runnable = import_module(f"rmr.commands.{name}_command").command
    return command


HEADINGS: dict[str, str] = {
    "programs": "check compile dis eval explain fmt lsp radio",
    "labs": "demo new lab sim sweep up agent world router export keys sign",
    "a lab that runs": "ls ps logs events stats facts config wait attach down "
    "kill stop start restart pause unpause fault load",
    "what a run leaves": "view why replay plot record",
    "this machine": "doctor completion man",
}
"""Heading of the help -> the subcommands under it, in the order in which they are listed."""


def _subcommand(name: str, heading: str) -> Subcommand:
    if name in COMMANDS:
        return Subcommand(COMMANDS[name], partial(_own, name), heading)
    if name in FLEET:
        return Subcommand(FLEET[name], partial(OtherPackage, "rmr_deploy.fleet:main", name), heading)
    function, summary = PROGRAMS[name]
    return Subcommand(summary, partial(OtherPackage, function), heading)


command = CommandGroup(
    "One logic program for a whole ensemble of robots, with deadlines that hold.",
    {name: _subcommand(name, heading) for heading, names in HEADINGS.items() for name in names.split()},
    {"top": "rmr stats"},
)
