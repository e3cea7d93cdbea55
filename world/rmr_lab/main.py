"""The commands `rmr lab` and `rmr new`; their options are `rmr_lab.commands`."""

import sys
from collections.abc import Sequence

from rmr.entry import run
from rmr.entry.command_line import Runnable


def main(words: Sequence[str] | None = None, name: str = "rmr lab") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: _carry_out("command", words, name))


def check_main(words: Sequence[str] | None = None, name: str = "rmr check") -> int:
    """Check labs in the name of the command that was given; return the exit code."""
    return run(name, lambda: _carry_out("check", words, name))


def new_main(words: Sequence[str] | None = None, name: str = "rmr new") -> int:
    """Run `rmr new`; return its exit code."""
    return run(name, lambda: _carry_out("new", words, name))


def _carry_out(attribute: str, words: Sequence[str] | None, name: str) -> int:
    from rmr_lab import commands  # noqa: PLC0415 - see rmr.entry

    command: Runnable = getattr(commands, attribute)
    return command.main(words, name)


if __name__ == "__main__":
    sys.exit(main())
