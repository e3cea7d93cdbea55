"""The programs `rmr-lab` and `rmr-new`; their options are `rmr_lab.commands`."""

import sys
from typing import TYPE_CHECKING

from rmr.entry import run

if TYPE_CHECKING:
    from rmr.entry.command_line import Runnable


def main() -> None:
    """Run `rmr lab`; ends the process. `rmr check LAB` becomes it, too."""
    sys.exit(run("rmr lab", lambda: _command("command", "rmr lab")))


def new_main() -> None:
    """Run `rmr new`; ends the process."""
    sys.exit(run("rmr new", lambda: _command("new", "rmr new")))


def _command(attribute: str, name: str) -> int:
    from rmr_lab import commands  # noqa: PLC0415 - see rmr.entry

    command: Runnable = getattr(commands, attribute)
    return command.main(name=name)


if __name__ == "__main__":
    main()
