"""The processes of a benchmark: a router first, then the others; spoken to over pipes, and ended in order."""

import multiprocessing
import os
import platform
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any

PATIENCE_S = 60.0
"""How long a process may say nothing."""


def machine() -> dict[str, Any]:
    """Return what a taking says of the machine."""
    return {"cores": os.cpu_count(), "python": platform.python_version(), "system": platform.system()}


def free_endpoint() -> str:
    """Return an endpoint of this machine that nobody uses."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def said(pipe: Connection) -> Any:
    """Return what a process says. Raises RuntimeError when it says nothing."""
    if not pipe.poll(PATIENCE_S):
        raise RuntimeError(f"a process said nothing for {PATIENCE_S:g} s")
    return pipe.recv()


@contextmanager
def hosts(target: Callable[..., None], case: Any, parts: Sequence[Any]) -> Iterator[list[Connection]]:
    """Start ``target(case, part, endpoint, pipe)`` for each of `parts`, of which the first is the router.

    Yields their pipes when each has said a word. In the end each gets one, the last first, and ends.
    """
    context, endpoint = multiprocessing.get_context("spawn"), free_endpoint()
    pipes, processes = [], []
    try:
        for part in parts:
            pipe, theirs = context.Pipe()
            started = context.Process(target=target, args=(case, part, endpoint, theirs), daemon=True)
            started.start()
            pipes.append(pipe)
            processes.append(started)
            if len(pipes) == 1:
                said(pipe)
        for pipe in pipes[1:]:
            said(pipe)
        yield pipes
        for pipe in reversed(pipes):
            pipe.send("end")
        for each in reversed(processes):
            each.join(PATIENCE_S)
    finally:
        for each in processes:
            if each.is_alive():
                each.kill()
