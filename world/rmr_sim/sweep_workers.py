"""Worker processes that share the seeds of a sweep. Each loads the lab once.

A worker gets one seed at a time. If it dies, that seed is reported as failed and a new worker replaces it. No worker
outlives the sweep: they ignore Ctrl-C, which the parent handles, and end with their parent.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

from rmr.entry.workers import end_with_parent, interrupted_later
from rmr_sim.interruption import Interruption
from rmr_sim.run_setup import Options, load
from rmr_sim.seed_run import Result, lost, run_seed
from rmr_world.finding import LabError
from rmr_world.lab_program import ProgramError

LOOK_S = 0.2
"""Period of the check for Ctrl-C while all workers are busy."""


def shared(
    path: Path, options: Options, seeds: Sequence[int], jobs: int, interruption: Interruption
) -> Iterator[Result]:
    """Yield the result of each seed as it comes, from `jobs` processes; end early when Ctrl-C comes."""
    waiting = list(reversed(seeds))
    workers = [_Worker(path, options) for _ in range(min(jobs, len(seeds)))]
    try:
        for worker in workers:
            worker.give(waiting.pop())
        while workers and not interruption.came:
            for ready in wait([worker.results for worker in workers], LOOK_S):
                worker = next(worker for worker in workers if worker.results is ready)
                yield worker.take()
                if not worker.alive:
                    workers[workers.index(worker)] = worker = _Worker(path, options)
                if waiting:
                    worker.give(waiting.pop())
                else:
                    worker.end()
                    workers.remove(worker)
    finally:
        for worker in workers:
            worker.end()


class _Worker:
    """One process and what it works on."""

    def __init__(self, path: Path, options: Options) -> None:
        context = get_context("spawn")
        self.results, theirs = context.Pipe()
        with interrupted_later():
            self._process: BaseProcess = context.Process(target=_work, args=(theirs, path, options), daemon=True)
            self._process.start()
        theirs.close()  # so that the end of the process ends the pipe
        self.alive = True
        self._seed = 0

    def give(self, seed: int) -> None:
        """Let the process run `seed`."""
        self._seed = seed
        with suppress(OSError):  # it has died: `take` tells
            self.results.send(seed)

    def take(self) -> Result:
        """Return the result of the seed given last."""
        try:
            result = self.results.recv()
            assert isinstance(result, Result)
        except (EOFError, OSError):
            self.end()
            return lost(self._seed, f"its process ended with exit code {self._process.exitcode}")
        return result

    def end(self) -> None:
        """End the process, whatever it does."""
        self.alive = False
        self.results.close()
        self._process.kill()
        self._process.join()


def _work(results: Connection, path: Path, options: Options) -> None:
    """Run the seeds that come until no more do."""
    end_with_parent()
    sys.stdout = sys.stderr  # standard output is the parent's: of what users' files print it has nothing
    run = _runner(path, options)
    while True:
        try:
            seed = results.recv()
        except EOFError:
            return
        results.send(run(seed))


def _runner(path: Path, options: Options) -> Callable[[int], Result]:
    """Return the runner of a seed. The files were valid when the sweep began; a later mistake in them is reported."""
    try:
        return partial(run_seed, load(path, options))
    except (LabError, ProgramError, OSError) as error:
        return partial(lost, error=str(error))
