"""The program `rmr-world`: its options alone, so that help and wrong usage cost little; `perform` does the work."""

import os
import sys
from collections.abc import Sequence

from rmr.entry import run


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command; ends the process."""
    code = run("rmr-world", lambda: _command(arguments))
    os._exit(code)  # zenoh's threads must not keep the process


def _command(arguments: Sequence[str] | None) -> int:
    from rmr_world.options import parser  # noqa: PLC0415 - see rmr.entry

    options = parser().parse_args(arguments)
    try:
        from rmr_world.world_process import perform  # noqa: PLC0415 - physics and lab schema load only where a world runs

        return perform(options)
    except KeyboardInterrupt:  # before the signal handlers stood: a world that is told to stop has not failed
        print("rmr-world: ended (SIGINT)", file=sys.stderr)
        return 0


if __name__ == "__main__":
    main()
