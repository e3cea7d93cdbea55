"""`--on tcp://SCHEDULER:8786`: the runs of a sweep or of a hunt on the workers of a Dask cluster.

Before the first task all workers are compared with this process: RMR, its sources, Python, platform and libraries; a
worker that joins later compares itself. Dask gives the task of a worker that dies to another one. A task with which
workers die again and again is tried once more with no other beside it, for Dask may suspect it for its company alone.
A scheduler that ends takes all tasks with it: what has come until then is kept, and `PoolLostError` says so.

The library is imported only where a cluster is asked for: it takes a second.
"""

import logging
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import lru_cache
from importlib import import_module
from queue import Empty, SimpleQueue
from sys import stderr
from time import monotonic
from types import TracebackType
from typing import Any, Generic, TypeVar
from uuid import uuid4

from rmr.entry.command_line import remedy
from rmr_sim.interruption import LOOK_S, Interruption, PoolError, PoolLostError
from rmr_sim.sweep_rows import differences, versions

INSTALL = "pip install 'rmr-robots[cluster]'"
CONNECT_S = 10
"""Longest time until the scheduler answers."""
COUNT_S = 2.0
"""Period in which the workers are counted anew: they come and go."""
WINDOW = 4
"""Tasks given out for each thread of the workers: none waits for the next one, and few are lost with a scheduler."""
TOLD_MAX = 5
"""Workers that an error names."""

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")


class OtherRmrError(Exception):
    """A worker that joined later is of another rmr."""


class ClusterPool(Generic[Task, Outcome]):
    """The workers of a cluster, which carry out tasks. A context manager: it is connected while it is entered."""

    def __init__(self, address: str, perform: Callable[[Task], Outcome], lost: Callable[[Task, str], Outcome]) -> None:
        """`perform` can be pickled; `lost` returns the outcome of a task whose worker dies each time."""
        self._address = address
        self._perform = perform
        self._lost = lost

    def __enter__(self) -> "ClusterPool[Task, Outcome]":
        try:
            distributed: Any = import_module("distributed")
            cloudpickle: Any = import_module("cloudpickle")
        except ModuleNotFoundError as error:
            raise PoolError(f"--on: {remedy(error)}") from None
        for name in ("distributed", *logging.root.manager.loggerDict):  # what befalls the cluster is said here, once
            if name.startswith("distributed"):
                logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        self._octets: bytes = cloudpickle.dumps(self._perform)
        self._killed: type[Exception] = distributed.KilledWorker
        if self._address.startswith("tls:"):
            tls = distributed.Security().get_connection_args("client").get("ssl_context")
            if tls is None:  # else the library fails, and says so once more at its end
                need = "its configuration needs distributed.comm.tls.ca-file and .client.cert and .key"
                raise PoolError(f"--on {self._address}: Dask has no certificates here; {need}")
        try:
            self._client: Any = distributed.Client(self._address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise PoolError(f"no Dask scheduler answers at {self._address}: {_words(error)}") from None
        try:
            self._compare()
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(self, _kind: type | None, _error: BaseException | None, _where: TracebackType | None) -> None:
        self._close()

    def _close(self) -> None:
        with suppress(Exception):  # a scheduler that is gone needs no farewell
            self._client.close(timeout=1)

    def _compare(self) -> None:
        """Raise PoolError unless there are workers and all are of the same rmr."""
        try:
            # The first worker may take a while to show itself: a script starts it just before the sweep.
            self._client.wait_for_workers(1, timeout=30)
            found: dict[str, Any] = self._client.run(versions, on_error="return")
        except OSError:
            start = f"dask worker {self._address} --nthreads 1"
            raise PoolError(f"the scheduler at {self._address} has no worker; start some: {start}") from None
        here = versions()
        wrong = [
            f"worker {worker} has no rmr that can be asked: {_words(there)}; there too: {INSTALL}"
            if isinstance(there, BaseException)
            else f"worker {worker} is of another rmr; {differences(there, here, here)[0]}"
            for worker, there in sorted(found.items())
            if there != here
        ]
        if wrong:
            more = [f"and {len(wrong) - TOLD_MAX} more workers"] if len(wrong) > TOLD_MAX else []
            raise PoolError("\n".join([*wrong[:TOLD_MAX], *more]))

    def outcomes(self, tasks: Sequence[Task], interruption: Interruption) -> Iterator[tuple[int, Outcome]]:
        """Yield the index and the outcome of each task as it comes; end early when Ctrl-C comes.

        Raises PoolLostError.
        """
        given = _Given(self._client, self._address, self._octets, tasks)
        waiting = deque(range(len(tasks)))
        suspects: deque[int] = deque()
        alone: set[int] = set()
        try:
            while waiting or suspects or given.flying:
                if interruption.came:
                    return
                if waiting:
                    for _ in range(min(given.room(), len(waiting))):
                        given.give(waiting.popleft())
                elif suspects and not given.flying:
                    alone.add(suspects[0])
                    given.give(suspects.popleft())
                for index, future in given.ended():
                    outcome = self._outcome(future)
                    if outcome is not None:
                        yield index, outcome
                    elif index in alone:
                        yield index, self._lost(tasks[index], "its worker died each time")
                    else:
                        suspects.append(index)
        finally:
            given.drop()

    def _outcome(self, future: Any) -> Outcome | None:
        """Return what came of a task; None where workers have died of it. Raises PoolLostError."""
        try:
            outcome: Outcome = future.result()
        except self._killed:
            return None
        except OtherRmrError as error:
            raise PoolLostError(str(error)) from None
        except Exception as error:  # a task itself reports what goes wrong in a run
            raise PoolLostError(f"a worker cannot carry out runs: {type(error).__name__}: {_words(error)}") from None
        return outcome


class _Given(Generic[Task]):
    """The tasks that the cluster has been given and that have not ended."""

    def __init__(self, client: Any, address: str, octets: bytes, tasks: Sequence[Task]) -> None:
        self._client = client
        self._address = address
        self._octets = octets
        self._tasks = tasks
        self._name = f"rmr-{uuid4().hex[:12]}"
        self._over: SimpleQueue[tuple[int, Any]] = SimpleQueue()
        self._window = 0
        self._counted_s = -COUNT_S
        self.flying: dict[int, Any] = {}

    def give(self, index: int) -> None:
        """Give the cluster a task."""
        future = self._client.submit(
            _carried_out,
            versions(),
            self._octets,
            self._tasks[index],
            key=f"{self._name}-{index}-{uuid4().hex[:8]}",
            pure=False,
        )
        self.flying[index] = future
        future.add_done_callback(lambda future: self._over.put((index, future)))

    def room(self) -> int:
        """Return how many more tasks the cluster should be given."""
        self._count()
        return max(0, self._window - len(self.flying))

    def ended(self) -> Iterator[tuple[int, Any]]:
        """Yield the index and the future of a task that has ended, if there is one soon. Raises PoolLostError."""
        try:
            index, future = self._over.get(timeout=LOOK_S)
        except Empty:
            self._count()
            return
        del self.flying[index]
        if future.status not in {"finished", "error"}:
            raise self._gone()
        yield index, future

    def drop(self) -> None:
        """Take back what has not ended."""
        with suppress(Exception):  # of a scheduler that is gone there is nothing to take back
            if self._client.status == "running":
                self._client.cancel(list(self.flying.values()), force=True)
        self.flying.clear()

    def _count(self) -> None:
        """Count the workers, now and then. Raises PoolLostError."""
        if monotonic() < self._counted_s + COUNT_S:
            return
        try:
            if self._client.status != "running":
                raise self._gone()
            threads = sum(self._client.nthreads().values())
        except (OSError, TimeoutError) as error:
            raise self._gone() from error
        self._counted_s = monotonic()
        if not threads and self._window != 1:
            print(f"no worker is left at {self._address}; waiting for one", file=stderr, flush=True)
        self._window = max(1, WINDOW * threads)

    def _gone(self) -> PoolLostError:
        return PoolLostError(f"the scheduler at {self._address} is gone, or was restarted")


def _carried_out(wanted: dict[str, str], octets: bytes, task: Any) -> Any:
    """Carry out a task, in a worker."""
    if different := differences(versions(), wanted, wanted):
        worker: Any = import_module("distributed").get_worker()
        raise OtherRmrError(f"worker {worker.address}, which joined later, is of another rmr; {different[0]}")
    return _performer(octets)(task)


@lru_cache(1)
def _performer(octets: bytes) -> Any:
    cloudpickle: Any = import_module("cloudpickle")
    return cloudpickle.loads(octets)


def _words(error: BaseException) -> str:
    """Return what a library says, in one line."""
    return " ".join(str(error).split()) or type(error).__name__
