"""The frame of every process of a run: logging, signals, the lifeline to its launcher.

A process never shows a traceback. An error is one line on standard error and, under ``--log``, a line of JSON; the exit
code gives its kind.
"""

import asyncio
import contextlib
import json
import logging
import os
import signal
import sys
import time
from collections.abc import Callable, Coroutine
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

from rmr.base.mistake import expect_ctrl_c
from rmr.base.printable import printable
from rmr.bus.bridge import PreciseLoop
from rmr.bus.endpoint import BusError
from rmr.entry import ExitCode

Result = TypeVar("Result")

LIFELINE = "RMR_LIFELINE"
"""Environment variable with the number of a file descriptor, at whose end-of-file the launcher has ended."""


def run_precisely(main: Coroutine[Any, Any, Result]) -> Result:
    """Run `main` as `asyncio.run` does, on a loop for robots and worlds (`rmr.bus.bridge`)."""
    with asyncio.Runner(loop_factory=PreciseLoop) as runner:
        return runner.run(main)


class JsonLines(logging.Formatter):
    """One JSON object per record: time (seconds since 1970), level, who, message, and whatever `extra` holds."""

    def __init__(self, who: str) -> None:
        super().__init__()
        self._who = who

    def format(self, record: logging.LogRecord) -> str:
        """Return `record` as one line."""
        line = {
            "time": round(record.created, 6),
            "level": record.levelname.lower(),
            "who": self._who,
            "message": record.getMessage(),
            **getattr(record, "data", {}),
        }
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return json.dumps(line, ensure_ascii=False, default=str)


class Plain(logging.Formatter):
    """One printable line for a person; a traceback goes to the log file alone."""

    def __init__(self, who: str) -> None:
        super().__init__()
        self._who = who

    def format(self, record: logging.LogRecord) -> str:
        """Return `record` as one line."""
        return f"{self._who}: {printable(record.getMessage())}"


class LogFile(logging.FileHandler):
    """A log file that reports once that it cannot be written (a full disk), and is closed then."""

    failure = ""
    """Why the log file of this process was closed early; empty while it is written. A process has one log file."""

    def handleError(self, _record: logging.LogRecord) -> None:  # noqa: N802 - logging's name
        """Close the file and report it."""
        logger = logging.getLogger("rmr")
        error = sys.exc_info()[1]
        logger.removeHandler(self)
        with contextlib.suppress(OSError, ValueError):
            self.close()
        reason = getattr(error, "strerror", None) or error
        LogFile.failure = f"{self.baseFilename}: {reason}"
        logger.error("cannot write the log %s any more: %s", self.baseFilename, reason)


def start_logging(who: str, file: Path | None) -> logging.Logger:
    """Return the process's logger: plain lines on standard error, JSON lines in `file`. Raises OSError.

    A second start in one process replaces the first: no line goes to a stream or a file of an earlier one.
    """
    logger = logging.getLogger("rmr")
    stop_logging(logger)
    logger.setLevel(logging.DEBUG if file is not None else logging.INFO)
    logger.propagate = False
    people = logging.StreamHandler(sys.stderr)
    people.setFormatter(Plain(who))
    people.setLevel(logging.INFO)
    logger.addHandler(people)
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        programs = LogFile(file, encoding="utf-8")
        programs.setFormatter(JsonLines(who))
        logger.addHandler(programs)
    return logger


def stop_logging(logger: logging.Logger) -> None:
    """Remove and close what `start_logging` gave to `logger`; handlers of others stay."""
    for handler in list(logger.handlers):
        if isinstance(handler.formatter, Plain | JsonLines):
            logger.removeHandler(handler)
            handler.close()


class Ending:
    """The request to end the process: its reason and exit code. The first request counts."""

    def __init__(self) -> None:
        self._event = asyncio.Event()
        self.code: int = ExitCode.OK
        self.reason = ""

    @property
    def asked(self) -> bool:
        """Whether the end has been asked for."""
        return self._event.is_set()

    def ask(self, reason: str, code: int = ExitCode.OK) -> None:
        """Ask for an orderly end."""
        if not self.asked:
            self.reason = reason
            self.code = code
            self._event.set()

    def break_down(self, error: BaseException) -> None:
        """Ask for the end because of a mistake in rmr itself; the traceback goes to the log file alone."""
        logging.getLogger("rmr").debug("internal error", exc_info=error)
        self.ask(f"internal error: {type(error).__name__}: {error}", ExitCode.FAILED)

    async def unless_asked(self, task: asyncio.Future[Any]) -> bool:
        """Wait for `task`; return False, and cancel it, when the end is asked for first."""
        ended = asyncio.ensure_future(self._event.wait())
        await asyncio.wait([task, ended], return_when=asyncio.FIRST_COMPLETED)
        ended.cancel()
        if task.done():
            task.result()
            return True
        task.cancel()
        return False

    async def wait(self) -> None:
        """Return once the end has been asked for."""
        await self._event.wait()


def handle_signals(ending: Ending) -> None:
    """Make the first SIGINT or SIGTERM request an orderly end, and a second one end the process at once.

    The second one works even while something blocks the event loop, such as a user's action that never returns.
    """
    loop = asyncio.get_running_loop()
    signals: list[int] = []

    def asked(number: int, _frame: FrameType | None) -> None:
        if ending.asked or signals:
            os._exit(ExitCode.FAILED)
        signals.append(number)
        with contextlib.suppress(RuntimeError):  # the loop is closed: the process is ending
            loop.call_soon_threadsafe(ending.ask, signal.Signals(number).name)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, asked)
    expect_ctrl_c(raised=False)


def run_to_end(main: Coroutine[Any, Any, None], ending: Ending, log: logging.Logger) -> int:
    """Run `main`, the life of a process, until its end; log why it has ended, and return the exit code."""
    try:
        run_precisely(main)
    except BusError as error:
        ending.ask(str(error), ExitCode.FAILED)
    except Exception as error:
        ending.break_down(error)
    if ending.code and ending.reason:
        log.error("%s", ending.reason)
    elif ending.reason:
        log.info("ended (%s)", ending.reason)
    logging.shutdown()
    return ending.code


def hold_lifeline() -> None:
    """End the process at once when the launcher that started it has ended, by whatever cause.

    Nothing is cleaned up, since no launcher is left to report to: the processes of a killed launcher must end even
    while one of them is stuck.
    """
    number = os.environ.get(LIFELINE, "")
    if not number.isdigit():
        return
    descriptor = int(number)
    with contextlib.suppress(OSError):
        os.set_inheritable(descriptor, False)
        os.set_blocking(descriptor, False)

    def readable() -> None:
        with contextlib.suppress(BlockingIOError):
            if not os.read(descriptor, 64):
                os._exit(ExitCode.FAILED)

    with contextlib.suppress(OSError, ValueError):
        asyncio.get_running_loop().add_reader(descriptor, readable)


class Throttle:
    """A call that is made the first time, and then at most once in `period_s` seconds."""

    def __init__(self, say: Callable[[], None], period_s: float) -> None:
        self._say = say
        self._period_s = period_s
        self._next_s = 0.0

    def __call__(self) -> None:
        """Make the call unless the period has not passed."""
        now_s = time.monotonic()
        if now_s >= self._next_s:
            self._next_s = now_s + self._period_s
            self._say()

    def over(self) -> None:
        """Make the next call at once, as the first."""
        self._next_s = 0.0
