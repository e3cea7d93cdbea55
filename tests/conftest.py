"""What all tests share: their tiers, the importable helpers of this folder (`vm_hand`), settings of hypothesis."""

import os
import signal
import sys
from collections.abc import Iterator

import parts
import pytest
import tiers
import vm_hand
from hypothesis import HealthCheck, settings

from rmr.vm.engines import Engine

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A suite that runs in a shell's background is started with SIGINT ignored, and so would be every process it starts.
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Python's cache of byte-code is written, whatever the shell says: each of the many processes that tests start would
# compile all that it imports, and each worker would rewrite the assertions of all tests.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# The same examples in every run, so that only a change makes a test fail; campaigns over seeds run outside the suite.
# No example is judged by its wall time: another program on the machine would make it fail.
settings.register_profile(
    "suite", derandomize=True, print_blob=True, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("suite")


SLOW_WORKERS_PER_CORE = 1.5
"""A run of `rmr up` with one to five robots takes 0.2 to 0.6 of a core; the rest of its time it waits for its clock."""


def pytest_configure(config: pytest.Config) -> None:
    """Give each test its tier and its part."""
    config.pluginmanager.register(tiers)
    config.pluginmanager.register(parts)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """Return the number of workers of `-n auto` for slow real tests; None: one a core, as pytest-xdist has it."""
    if config.option.markexpr != "(slow) and real" or "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ:
        return None
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, round(SLOW_WORKERS_PER_CORE * cores))


@pytest.fixture(scope="session", autouse=True)
def _register_of_runs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep the runs of tests out of the user's register, those of the user from tests, and keys out of the home."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("states", numbered=True)))
        patch.setenv("RMR_REGISTER", str(tmp_path_factory.mktemp("register", numbered=True)))
        yield


@pytest.fixture(scope="module", params=Engine, ids=lambda engine: engine.value)
def each_engine(request: pytest.FixtureRequest) -> Iterator[None]:
    """Let all machines that `vm_hand` makes for a module be of one engine, then of the next."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(vm_hand, "engine", request.param)
        yield
