"""Commands of click in `run`: they leave Ctrl-C to it."""

import click


def perform(command: click.Command, name: str) -> int:
    """Run `command` with the words of the command line; return its exit code. Ctrl-C raises KeyboardInterrupt."""
    try:
        return command.main(prog_name=name, standalone_mode=False) or 0
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except click.Abort:
        raise KeyboardInterrupt from None
