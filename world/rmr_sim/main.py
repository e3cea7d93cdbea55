"""The command `rmr sim`: its options alone, so that help and wrong usage cost little; `perform` does the work."""

import sys

from rmr_sim.arguments import parse

EXIT_FAILED = 1


def main(argv: list[str] | None = None) -> int:
    """Run the command; return its exit code."""
    try:
        arguments = parse(argv)
        from rmr_sim.perform import perform  # noqa: PLC0415 - lab, nodes and world load only where something runs

        return perform(arguments)
    except KeyboardInterrupt:
        print("rmr sim: interrupted", file=sys.stderr)
        return EXIT_FAILED


if __name__ == "__main__":
    sys.exit(main())
