"""Start and end of every command: exit codes, Ctrl-C, JSON, an output that cannot be written. No traceback for a user.

- *Loading.* Loading a command takes up to a second, in which Ctrl-C may come. So the module that a console script
  names imports this package alone; it imports the rest inside of the function that it hands to `run`.
- *Ctrl-C* that a command does not handle itself ends it as failed.
- *Standard output.* A closed one is reported before anything is done: the next file that is opened would get its
  number. One that cannot be written any more, as on a full disk, is reported when a write fails.
"""

import gc
import os
import signal
import sys
from collections.abc import Callable, Mapping
from enum import IntEnum
from types import TracebackType

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # nobody multiplies matrices, and each idle thread waits in a loop
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # else it looks for some in each installed package


JSON_VERSION = 1
"""The form of all JSON documents that commands print or write (docs/commands.md says what raises it)."""


class ExitCode(IntEnum):
    """The exit codes of all commands; docs/labs.md says what each means."""

    OK = 0
    FAILED = 1
    USAGE = 2
    INVALID = 3
    STRICT = 4


def run(name: str, command: Callable[[], int | None]) -> int:
    """Run `command` as the program `name`; return its exit code. SystemExit passes through."""
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115 - for as long as the process lives
    if sys.stdout is None:
        print(f"{name}: standard output is closed; send it to /dev/null if nobody wants it", file=sys.stderr)
        return ExitCode.FAILED
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        try:
            return command() or 0
        finally:
            sys.stdout.flush()
    except KeyboardInterrupt:
        print(f"{name}: interrupted", file=sys.stderr)
        return ExitCode.FAILED
    except OSError as error:  # of the output: commands handle all others themselves
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # else the rest of the buffer is written at exit, and fails again
        if not isinstance(error, BrokenPipeError):  # the reader has closed the pipe on purpose
            print(f"{name}: cannot write the output: {error.strerror or error}", file=sys.stderr)
        return ExitCode.FAILED


def print_json(value: Mapping[str, object], indent: int | None = 2) -> None:
    """Print `value` as a JSON document on standard output, its version first."""
    import json  # noqa: PLC0415 - most commands print none

    print(json.dumps({"version": JSON_VERSION, **value}, indent=indent))


class Loading:
    """Around the import of a command's work: none of what a module makes is garbage, so none is looked for.

    Afterwards all objects are set aside for good: the collector walks through none of them while the command runs, nor
    when the process ends. Where the module is loaded already nothing is done: what there is may become garbage.
    """

    def __init__(self, module: str) -> None:
        self._new = module not in sys.modules and gc.isenabled()

    def __enter__(self) -> None:
        if self._new:
            gc.disable()

    def __exit__(self, _kind: type | None, _error: BaseException | None, _where: TracebackType | None) -> None:
        if self._new:
            gc.freeze()
            gc.enable()
