"""The command `rmr`: the language's own subcommands, and the way to the other packages' commands.

Nothing is imported before it is needed, so that help and wrong usage cost next to nothing: a subcommand of the
language is the module `rmr.commands.X_command`, imported by its name. A subcommand of another package is a program of
its own, `rmr-X`, which stands beside the interpreter that runs this; `rmr X` becomes it.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module

from rmr.commands.common import become_program
from rmr.commands.fleet_verbs import FLEET
from rmr.entry.command_line import CommandGroup, Runnable, Subcommand

COMMANDS: dict[str, str] = {
    "check": "Check programs and labs and print what is wrong with them.",
    "compile": "Compile a program to byte-code.",
    "dis": "Print byte-code as annotated text, offsets in hex.",
    "eval": "Run a program on robots without bodies.",
    "explain": "Explain an error or a warning.",
    "fmt": "Bring programs into canonical layout.",
    "radio": "Try what the radio will carry.",
    "record": "Join, recover and list recordings of runs.",
    "replay": "Execute the recorded minds of a run anew and check them.",
}
"""The language's own subcommands, each the `command` of its module, and their summaries."""

PROGRAMS: dict[str, str] = {
    "up": "Run a lab with one process for each robot.",
    "fault": "Inject faults into a lab that runs: of the radio, and of robots.",
    "load": "Give running robots a new program.",
    "why": "Say why a fact of a run holds, or why it does not.",
    "sim": "Run a lab deterministically, in virtual time.",
    "new": "Write a lab of your own that runs at once.",
    "lab": "Check, draw, list and copy labs; the schema of the lab file.",
    "view": "Show a run in the browser, while it goes on or afterwards.",
    "plot": "Draw pictures of a run, or figures of experiments.",
    "agent": "Run one robot.",
    "world": "Run the world server of a lab.",
}
"""The subcommands that are programs of their own, and their summaries."""


@dataclass(frozen=True, slots=True)
class ExternalProgram:
    """A subcommand that becomes the program `rmr-NAME`, which is given the words `first` and then all words."""

    program: str
    first: tuple[str, ...] = ()

    def main(self, words: Sequence[str] | None = None, name: str = "rmr") -> int:  # noqa: ARG002 - it knows its name
        """Become the program; ends the process."""
        become_program(self.program, [*self.first, *(sys.argv[1:] if words is None else words)])


def _own(name: str) -> Runnable:
    command: Runnable = import_module(f"rmr.commands.{name}_command").command
    return command


command = CommandGroup(
    "One logic program for a whole ensemble of robots, with deadlines that hold.",
    {name: Subcommand(summary, partial(_own, name)) for name, summary in COMMANDS.items()}
    | {name: Subcommand(summary, partial(ExternalProgram, name)) for name, summary in PROGRAMS.items()}
    | {name: Subcommand(summary, partial(ExternalProgram, "fleet", (name,))) for name, summary in FLEET.items()},
)
