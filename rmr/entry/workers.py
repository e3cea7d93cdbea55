"""Worker processes of a command: they end with it, and only the command itself handles Ctrl-C."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import parent_process, resource_tracker
from threading import Thread

from rmr.entry import ExitCode


def end_with_parent() -> None:
    """End this process when its parent has ended, by whatever cause: its results would be lost."""
    parent = parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(ExitCode.FAILED)

    Thread(target=follow, daemon=True).start()


@contextmanager
def interrupted_later() -> Iterator[None]:
    """Delay Ctrl-C until the block is over. Processes that are started within it never get it."""
    came: list[int] = []
    resource_tracker.ensure_running()  # first: starting it unblocks the signal
    before = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # which is inherited; other threads take it as it comes
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        signal.signal(signal.SIGINT, before)
    if came:
        signal.raise_signal(signal.SIGINT)
