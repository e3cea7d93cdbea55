"""The command `rmr lsp`."""
# ruff: noqa: PLC0415 - see rmr.entry

import sys
from collections.abc import Sequence

from rmr.entry import ExitCode, run
from rmr.entry.command_line import Command, Parser

ABOUT = """\
Serve an editor over the Language Server Protocol: on stdin and stdout, until it says to exit.

Editors start this command themselves: docs/editor.md says how they are set up. It needs pygls, which
pip install 'rmr[editor]' brings.
"""


def _declare(parser: Parser) -> None:
    parser.flag("--stdio", help="Accepted because some editors say so; there is no other way.")


def _serve(stdio: bool) -> int:  # noqa: ARG001 - there is no other way
    from importlib.util import find_spec

    if find_spec("pygls") is None:
        print("rmr lsp: pygls is not installed; pip install 'rmr[editor]' brings it", file=sys.stderr)
        return ExitCode.FAILED
    from rmr_editor.answers import answering
    from rmr_editor.language_server import serve

    return serve(answering())


command = Command(ABOUT, _declare, _serve)


def main(words: Sequence[str] | None = None, name: str = "rmr lsp") -> int:
    """Run `rmr lsp`; return its exit code."""
    return run(name, lambda: command.main(words, name))


if __name__ == "__main__":
    sys.exit(main())
