"""Ctrl-C: once ends in order what is under way, twice ends at once."""

import signal
from collections.abc import Callable
from types import TracebackType


class Interruption:
    """While it is entered, the first Ctrl-C is noted and ends the present run; the second raises KeyboardInterrupt."""

    def __init__(self) -> None:
        self.came = False
        self._stop: Callable[[], None] = lambda: None

    def __enter__(self) -> "Interruption":
        self._before = signal.signal(signal.SIGINT, self._interrupt)
        return self

    def __exit__(self, _kind: type | None, _error: BaseException | None, _where: TracebackType | None) -> None:
        signal.signal(signal.SIGINT, self._before)

    def ends(self, stop: Callable[[], None]) -> None:
        """Let Ctrl-C call `stop`, at once if it has come."""
        self._stop = stop
        if self.came:
            stop()

    def _interrupt(self, *_: object) -> None:
        self.came = True
        signal.signal(signal.SIGINT, signal.default_int_handler)
        self._stop()
