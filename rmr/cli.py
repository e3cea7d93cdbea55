"""The command `rmr`: the language's own subcommands, and the way to the other packages' commands.

Nothing is imported before it is needed: the table below holds what `rmr --help` shows, so that help and wrong
usage cost next to nothing. A subcommand of another package is a program of its own, `rmr-X`, which stands
beside the interpreter that runs this; `rmr X` becomes it.
"""

import os
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import click

EXIT_FAILED = 1
"""It ran and failed."""
EXIT_USAGE = 2
"""Wrong usage."""
EXIT_INVALID = 3
"""An invalid program, byte-code or lab file."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A subcommand: what help says of it, and where it is."""

    help: str
    module: str | None = None
    """Where its click command is, called like the subcommand; None for a program of its own."""
    attribute: str | None = None
    """What its click command is called there, if not like the subcommand."""


COMMANDS: dict[str, Entry] = {
    "check": Entry("Check programs and print what is wrong with them.", "rmr.lang.commands"),
    "compile": Entry("Compile a program to byte-code.", "rmr.lang.commands", "compile_command"),
    "dis": Entry("Print byte-code as annotated text.", "rmr.lang.commands"),
    "up": Entry("Run a lab with one process for each robot."),
    "sim": Entry("Run a lab deterministically, in virtual time."),
    "agent": Entry("Run one robot."),
    "world": Entry("Run the world server of a lab."),
}
"""Every subcommand, in the order in which help lists them."""


class Commands(click.Group):
    """A group whose subcommands are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the names in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import and return a subcommand."""
        entry = COMMANDS.get(cmd_name)
        if entry is None:
            return None
        if entry.module is None:
            return _program(cmd_name, entry)
        command = getattr(import_module(entry.module), entry.attribute or cmd_name)
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the subcommand that `args` name; a misspelt one gets the nearest name as a hint."""
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            from difflib import get_close_matches  # noqa: PLC0415 - only for a mistake

            matches = get_close_matches(args[0], COMMANDS, n=1)
            hint = f" Did you mean '{matches[0]}'?" if matches else ""
            ctx.fail(f"No such command '{args[0]}'.{hint}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """List the subcommands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry.help) for name, entry in COMMANDS.items()])


def _program(name: str, entry: Entry) -> click.Command:
    """Return the subcommand that becomes the program `rmr-NAME` and passes it all arguments."""

    def become(arguments: tuple[str, ...]) -> None:
        path = Path(sys.executable).with_name(f"rmr-{name}")
        if not path.is_file():
            click.echo(f"rmr {name}: {path} is not installed; `make install` or `pip install rmr` does it", err=True)
            raise SystemExit(EXIT_FAILED)
        sys.stdout.flush()
        try:
            os.execv(path, [str(path), *arguments])
        except OSError as error:
            click.echo(f"rmr {name}: cannot run {path}: {error.strerror}", err=True)
            raise SystemExit(EXIT_FAILED) from None

    return click.Command(
        name,
        callback=become,
        params=[click.Argument(["arguments"], nargs=-1, type=click.UNPROCESSED)],
        help=entry.help,
        add_help_option=False,
        context_settings={"ignore_unknown_options": True, "allow_interspersed_args": False},
    )


def _version(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    """Print the version and end."""
    if wanted and not context.resilient_parsing:
        from rmr import __version__  # noqa: PLC0415

        click.echo(f"rmr {__version__}")
        context.exit()


version_option = click.option(
    "--version", is_flag=True, is_eager=True, expose_value=False, callback=_version, help="Show the version and exit."
)
"""`--version` without asking the package's metadata, which takes longer than all the rest."""


@click.command(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@version_option
def main() -> None:
    """One logic program for a whole ensemble of robots, with deadlines that hold."""


def compile_main() -> None:
    """Run `rmrc`, which is `rmr compile`."""
    from rmr.lang.commands import compile_command  # noqa: PLC0415

    compile_command.main(prog_name="rmrc")
