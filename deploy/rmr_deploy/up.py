"""The program `rmr-up`; its options are `rmr_deploy.commands.up`."""

import sys

from rmr.entry import run


def _command() -> int:
    from rmr.entry.clicked import perform  # noqa: PLC0415 - see rmr.entry
    from rmr_deploy.commands.up import command  # noqa: PLC0415

    return perform(command, "rmr up")


def main() -> None:
    """Run the command; ends the process."""
    sys.exit(run("rmr up", _command))


if __name__ == "__main__":
    main()
