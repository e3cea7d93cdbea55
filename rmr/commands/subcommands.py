"""The command `rmr`: the language's own subcommands, and the way to the other packages' commands.

Nothing is imported before it is needed, so that help and wrong usage cost next to nothing: a subcommand of the
language is the module `rmr.commands.X`, imported by its name. A subcommand of another package is a program of its
own, `rmr-X`, which stands beside the interpreter that runs this; `rmr X` becomes it.
"""

from importlib import import_module

import click

from rmr.commands.common import SETTINGS, VERSION, become_program

COMMANDS = ("check", "compile", "dis", "eval", "explain", "fmt", "radio")
"""The language's own subcommands, each the `command` of the module of its name in `rmr.commands`."""

PROGRAMS: dict[str, str] = {
    "up": "Run a lab with one process for each robot.",
    "fault": "Disturb the radio of a lab that runs.",
    "sim": "Run a lab deterministically, in virtual time.",
    "new": "Write a lab of your own that runs at once.",
    "lab": "Check, draw, list and copy labs; the schema of the lab file.",
    "plot": "Draw figures of experiments.",
    "agent": "Run one robot.",
    "world": "Run the world server of a lab.",
}
"""The subcommands that are programs of their own, and what help says of them."""


class Commands(click.Group):
    """A group that knows its commands by name and imports them when they are asked for."""

    def list_commands(self, _ctx: click.Context) -> list[str]:
        """Return the names, the language's own first."""
        return [*COMMANDS, *PROGRAMS]

    def get_command(self, _ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a subcommand, or one that becomes a program."""
        if cmd_name in PROGRAMS:
            return _program(cmd_name)
        return _own(cmd_name) if cmd_name in COMMANDS else None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the subcommand that `args` name; a misspelt one gets the nearest name as a hint."""
        known = self.list_commands(ctx)
        if args and args[0] not in known and not args[0].startswith("-"):
            from difflib import get_close_matches  # noqa: PLC0415 - only a misspelling needs it

            matches = get_close_matches(args[0], known, n=1)
            hint = f" Did you mean '{matches[0]}'?" if matches else ""
            ctx.fail(f"No such command '{args[0]}'.{hint}")
        return super().resolve_command(ctx, args)


def _own(name: str) -> click.Command:
    command = import_module(f"rmr.commands.{name}").command
    assert isinstance(command, click.Command)
    return command


def _program(name: str) -> click.Command:
    """Return the subcommand that becomes the program `rmr-NAME` and passes it all arguments."""

    def become(arguments: tuple[str, ...]) -> None:
        become_program(name, list(arguments))

    return click.Command(
        name,
        callback=become,
        params=[click.Argument(["arguments"], nargs=-1, type=click.UNPROCESSED)],
        help=PROGRAMS[name],
        add_help_option=False,
        context_settings={"ignore_unknown_options": True, "allow_interspersed_args": False},
    )


@click.command(cls=Commands, context_settings=SETTINGS)
@VERSION
def command() -> None:
    """One logic program for a whole ensemble of robots, with deadlines that hold."""
