"""The program `rmr-plot`; what it does is `rmr_view.plot_command`."""

import sys

from rmr.entry import run


def main(argv: list[str] | None = None) -> int:
    """Run the command; return its exit code."""
    return run("rmr plot", lambda: _command(argv))


def _command(argv: list[str] | None) -> int:
    from rmr_view.plot_command import perform  # noqa: PLC0415 - see rmr.entry

    return perform(argv)


if __name__ == "__main__":
    sys.exit(main())
