"""Notification that a router has refused a session, which zenoh reports in its log alone.

zenoh can only log to standard output. So standard output becomes a pipe, which a thread reads: a line about a refusal
is reported, other lines of that module of zenoh are dropped, and the rest goes to the former standard output. The pipe
never blocks zenoh: lines that do not fit into it are lost, which takes some hundred refusals at a time.
"""

import contextlib
import os
import threading
from collections.abc import Callable
from typing import BinaryIO, Final

import zenoh

PART: Final = "zenoh_transport::unicast::establishment::accept"
"""The module of zenoh that logs refusals, among much else."""

REASONS: Final = {
    b"UsrPwd extension - Recv InitSyn. Expected extension": "that has no secret",
    b"UsrPwd extension - Recv OpenSyn. Invalid": "that has another secret",
}
"""Mark of a refusal in that log -> its reason, as a clause about the refused process."""

VARIABLE: Final = "RUST_LOG"
"""Environment variable with the log filter of zenoh, to which the module of refusals is added."""


def watch(refused: Callable[[str], None]) -> None:
    """Call `refused` with a clause of `REASONS` for each session that this process's router refuses, on a thread.

    To be called once, before the router is opened.
    """
    os.environ[VARIABLE] = ",".join(filter(None, [os.environ.get(VARIABLE), f"{PART}=debug"]))
    onward = os.fdopen(os.dup(1), "wb", buffering=0)
    source, sink = os.pipe()
    os.dup2(sink, 1)
    os.close(sink)
    os.set_blocking(1, False)
    threading.Thread(
        target=_read, args=(os.fdopen(source, "rb"), onward, refused), name="refusals", daemon=True
    ).start()
    zenoh.init_log_from_env_or("off")


def _read(lines: BinaryIO, onward: BinaryIO, refused: Callable[[str], None]) -> None:
    for line in lines:
        if PART.encode() not in line:
            with contextlib.suppress(OSError):  # where standard output went may be gone
                onward.write(line)
            continue
        reason = next((words for mark, words in REASONS.items() if mark in line), None)
        if reason is not None:
            refused(reason)
