"""A pool of worker processes that share the runs of a sweep or of a hunt.

A worker gets one task at a time. If it dies, that task is reported as lost and a new worker replaces it. No worker
outlives the pool: they ignore Ctrl-C, which the parent handles, and end with their parent.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from types import TracebackType
from typing import TYPE_CHECKING, Generic, TypeVar

from rmr.entry.workers import end_with_parent, interrupted_later
from rmr_sim.interruption import Interruption

if TYPE_CHECKING:
    from rmr_sim.cluster_pool import ClusterPool

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")


def pool_of(
    jobs: int, on: str | None, perform: Callable[[Task], Outcome], lost: Callable[[Task, str], Outcome]
) -> "WorkerPool[Task, Outcome] | ClusterPool[Task, Outcome]":
    """Return `jobs` processes, or the cluster at `on`: a context manager."""
    if on is None:
        return WorkerPool(jobs, perform, lost)
    from rmr_sim.cluster_pool import ClusterPool  # noqa: PLC0415 - few sweeps have one

    return ClusterPool(on, perform, lost)


class WorkerPool(Generic[Task, Outcome]):
    """Processes that carry out tasks. A context manager: at its end no process is left."""

    def __init__(self, jobs: int, perform: Callable[[Task], Outcome], lost: Callable[[Task, str], Outcome]) -> None:
        """Each of `jobs` processes calls `perform`, which can be pickled, with each task.

        `lost` returns the outcome of a task whose process has died, given the reason.
        """
        self._perform = perform
        self._lost = lost
        self._workers = [_Worker(perform, lost) for _ in range(jobs)]

    def __enter__(self) -> "WorkerPool[Task, Outcome]":
        return self

    def __exit__(self, _kind: type | None, _error: BaseException | None, _where: TracebackType | None) -> None:
        for worker in self._workers:
            worker.end()

    def outcomes(self, tasks: Sequence[Task], interruption: Interruption) -> Iterator[tuple[int, Outcome]]:
        """Yield the index and the outcome of each task as it comes; end early when Ctrl-C comes."""
        waiting = list(reversed(list(enumerate(tasks))))
        busy = list(range(min(len(self._workers), len(tasks))))
        for place in busy:
            self._workers[place].give(*waiting.pop())
        while busy and not interruption.came:
            # Period of the check for Ctrl-C while all workers are busy.
            ready = wait([self._workers[place].results for place in busy], 0.2)
            for place in [place for place in busy if self._workers[place].results in ready]:
                yield self._workers[place].take()
                if not self._workers[place].alive:
                    self._workers[place] = _Worker(self._perform, self._lost)
                if waiting:
                    self._workers[place].give(*waiting.pop())
                else:
                    busy.remove(place)


class _Worker(Generic[Task, Outcome]):
    """One process and what it works on."""

    def __init__(self, perform: Callable[[Task], Outcome], lost: Callable[[Task, str], Outcome]) -> None:
        self._lost = lost
        context = get_context("spawn")
        self.results, theirs = context.Pipe()
        with interrupted_later():
            self._process: BaseProcess = context.Process(target=_work, args=(theirs, perform), daemon=True)
            self._process.start()
        theirs.close()  # so that the end of the process ends the pipe
        self.alive = True
        self._given: tuple[int, Task] | None = None

    def give(self, index: int, task: Task) -> None:
        """Let the process carry out `task`."""
        self._given = (index, task)
        with suppress(OSError):  # it has died: `take` tells
            self.results.send(task)

    def take(self) -> tuple[int, Outcome]:
        """Return the outcome of the task given last, with its index."""
        assert self._given is not None
        index, task = self._given
        try:
            outcome: Outcome = self.results.recv()
        except (EOFError, OSError):
            self.end()
            return index, self._lost(task, f"its process ended with exit code {self._process.exitcode}")
        return index, outcome

    def end(self) -> None:
        """End the process, whatever it does."""
        self.alive = False
        self.results.close()
        self._process.kill()
        self._process.join()


def _work(results: Connection, perform: Callable[[Task], Outcome]) -> None:
    """Carry out the tasks that come until no more do."""
    end_with_parent()
    sys.stdout = sys.stderr  # standard output is the parent's: of what users' files print it has nothing
    while True:
        try:
            task = results.recv()
        except EOFError:
            return
        results.send(perform(task))
