"""The programs `rmr` and `rmrc`; what they do is `rmr.commands`."""

import sys

from rmr.entry import run


def _rmr() -> int:
    from rmr.commands.subcommands import command  # noqa: PLC0415 - see rmr.entry

    return command.main(name="rmr")


def _rmrc() -> int:
    from rmr.commands.compile_command import command  # noqa: PLC0415 - see rmr.entry

    return command.main(name="rmrc")


def main() -> None:
    """Run `rmr`; ends the process."""
    sys.exit(run("rmr", _rmr))


def compile_main() -> None:
    """Run `rmrc`, which is `rmr compile`; ends the process."""
    sys.exit(run("rmrc", _rmrc))
