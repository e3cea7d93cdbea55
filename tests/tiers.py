"""The tiers of the tests, a plugin of pytest.

A test belongs to exactly one tier: `medium` or `slow` where a marker says so, else `medium` in the folders of
`MEDIUM_FOLDERS` and `slow` in those of `SLOW_FOLDERS`, else `fast`. `make test` runs the fast and the medium tests,
`make test-slow` the slow ones, `make test-all` both.
"""

import gc
from collections.abc import Iterator
from pathlib import Path

import pytest

TESTS = Path(__file__).parent

TIERS = ("fast", "medium", "slow")

MEDIUM_FOLDERS = frozenset({"eval", "evaluation", "fuzz", "integration", "paper", "properties", "sim", "validation"})
"""Folders of tests/ whose tests run whole programs, labs, drawn examples or processes."""

SLOW_FOLDERS = frozenset({"page"})
"""Folders of tests/ whose tests drive a browser."""

TIERS_OF = pytest.StashKey[dict[str, list[str]]]()
"""The tiers of each collected test by its node id, those that `-m` leaves out included."""


@pytest.hookimpl(tryfirst=True)  # before `-m` selects
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Give each test that names no tier the one of its folder, note the tiers of all, and let long tests begin first.

    Long is what was given more time than others: begun last, it would keep one worker busy while the others have ended.
    """
    for item in items:
        if not _tiers(item):
            folder = item.path.relative_to(TESTS).parts[0] if item.path.is_relative_to(TESTS) else ""
            medium = "medium" if folder in MEDIUM_FOLDERS else "fast"
            item.add_marker("slow" if folder in SLOW_FOLDERS else medium)
    config.stash[TIERS_OF] = {item.nodeid: _tiers(item) for item in items}
    items.sort(key=_timeout_s, reverse=True)  # stable: all others stay in their order


def _timeout_s(item: pytest.Item) -> float:
    mark = item.get_closest_marker("timeout")
    return 0.0 if mark is None else float(mark.args[0])


def _tiers(item: pytest.Item) -> list[str]:
    return [mark.name for mark in item.iter_markers() if mark.name in TIERS]


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[object]:
    """Collect tests without garbage collection, and take their million objects out of it for good.

    Nearly all that is made meanwhile is kept. A full collection costs 0.3 s with them, benchmarks under test make
    hundreds, and the interpreter does so by itself.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.collect()
        gc.freeze()
