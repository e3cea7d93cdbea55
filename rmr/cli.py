"""The programs `rmr` and `rmrc`; what they do is `rmr.commands`."""

import sys

from rmr.entry import run


def _rmr() -> int:
    from rmr.commands.fleet_verbs import FLEET  # noqa: PLC0415 - see rmr.entry

    if sys.argv[1:2] and sys.argv[1] in FLEET:  # at once: a verb should answer in 150 ms of processor time
        from rmr.commands.common import become_program  # noqa: PLC0415

        become_program("fleet", sys.argv[1:])
    from rmr.commands.subcommands import command  # noqa: PLC0415

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
