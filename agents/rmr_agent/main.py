"""The program `rmr-agent`: its options alone, so that help and wrong usage cost little; `perform` does the work."""

import os
import sys
from collections.abc import Sequence

from rmr.entry import run


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command; ends the process."""
    code = run("rmr-agent", lambda: _command(arguments))
    os._exit(code)  # zenoh's threads and a user's action must not keep the process


def _command(arguments: Sequence[str] | None) -> int:
    from rmr_agent.agent_options import parser  # noqa: PLC0415 - see rmr.entry

    options = parser().parse_args(arguments)
    try:
        from rmr_agent.perform import perform  # noqa: PLC0415 - the bus and the node load only where a robot runs

        return perform(options)
    except KeyboardInterrupt:  # before the signal handlers stood: a robot that is told to stop has not failed
        from rmr.base.ids import spelled  # noqa: PLC0415

        print(f"rmr-agent {spelled(options.id)}: ended (SIGINT)", file=sys.stderr)
        return 0


if __name__ == "__main__":
    main()
