"""The program `rmr-sim`: its options alone, so that help and wrong usage cost little; `perform` does the work."""

import sys

from rmr.entry import run


def main(argv: list[str] | None = None) -> int:
    """Run the command; return its exit code."""
    return run("rmr sim", lambda: _command(argv))


def _command(argv: list[str] | None) -> int:
    from rmr_sim.arguments import parse  # noqa: PLC0415 - see rmr.entry

    arguments = parse(argv)
    from rmr_sim.sim_command import perform  # noqa: PLC0415 - lab, nodes and world load only where something runs

    return perform(arguments)


if __name__ == "__main__":
    sys.exit(main())
