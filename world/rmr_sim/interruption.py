"""What ends runs early: Ctrl-C, the first one in order, the second one at once; and a cluster that is lost."""

import signal
from collections.abc import Callable
from types import TracebackType

from rmr.base.mistake import expect_ctrl_c

LOOK_S = 0.2
"""Period of the check for Ctrl-C while all who share the runs are busy."""


class PoolError(Exception):
    """A cluster cannot be used; the message says why and what to do."""


class PoolLostError(PoolError):
    """A cluster was lost on the way; what has come until then is good."""


class Interruption:
    """Context manager: the first Ctrl-C ends the present run, the second raises KeyboardInterrupt."""

    def __init__(self) -> None:
        self.came = False
        self._stop: Callable[[], None] = lambda: None

    def __enter__(self) -> "Interruption":
        self._before = signal.signal(signal.SIGINT, self._interrupt)
        expect_ctrl_c(raised=False)
        return self

    def __exit__(self, _kind: type | None, _error: BaseException | None, _where: TracebackType | None) -> None:
        signal.signal(signal.SIGINT, self._before)
        expect_ctrl_c(raised=True)

    def ends(self, stop: Callable[[], None]) -> None:
        """Call `stop` on Ctrl-C; at once if that has come already."""
        self._stop = stop
        if self.came:
            stop()

    def _interrupt(self, *_: object) -> None:
        self.came = True
        signal.signal(signal.SIGINT, signal.default_int_handler)
        expect_ctrl_c(raised=True)
        self._stop()
