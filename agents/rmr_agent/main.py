"""The program `rmr-agent`: its options alone, so that help and wrong usage cost little; `perform` does the work."""

import os
from collections.abc import Sequence

from rmr.entry import run


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command; ends the process."""
    code = run("rmr-agent", lambda: _command(arguments))
    os._exit(code)  # zenoh's threads and a user's action must not keep the process


def _command(arguments: Sequence[str] | None) -> int:
    from rmr_agent.options import parser  # noqa: PLC0415 - see rmr.entry

    options = parser().parse_args(arguments)
    from rmr_agent.perform import perform  # noqa: PLC0415 - the bus and the node load only where a robot runs

    return perform(options)


if __name__ == "__main__":
    main()
