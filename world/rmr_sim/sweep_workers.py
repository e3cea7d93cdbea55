"""The runs of a sweep in worker processes. Each worker loads the lab once and runs one seed at a time."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from rmr_sim.interruption import Interruption
from rmr_sim.run_setup import Options, load
from rmr_sim.seed_run import Result, lost, run_seed
from rmr_sim.worker_pool import WorkerPool
from rmr_world.finding import LabError
from rmr_world.lab_program import ProgramError


def shared(
    path: Path, options: Options, seeds: Sequence[int], jobs: int, interruption: Interruption
) -> Iterator[Result]:
    """Yield the result of each seed as it comes, from `jobs` processes; end early when Ctrl-C comes."""
    with WorkerPool(min(jobs, len(seeds)), partial(_runner, path, options), lost) as pool:
        for _, result in pool.outcomes(seeds, interruption):
            yield result


def _runner(path: Path, options: Options) -> Callable[[int], Result]:
    """Return the runner of a seed. The files were valid when the sweep began; a later mistake in them is reported."""
    try:
        return partial(run_seed, load(path, options))
    except (LabError, ProgramError, OSError) as error:
        return partial(lost, error=str(error))
