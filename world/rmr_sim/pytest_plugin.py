"""The pytest fixture `rmr_sim`, for tests of labs; the simulator is loaded by the first test that uses it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture
def rmr_sim(request: pytest.FixtureRequest) -> Callable[..., Any]:
    """Return `rmr.simulate`; a relative path of a lab is looked for beside the test first, then where pytest runs."""
    import rmr  # noqa: PLC0415 - tests that use no lab load nothing

    folder = request.path.parent

    def simulate(lab: str | Path, seed: int | None = None, **options: Any) -> Any:
        beside = folder / lab
        return rmr.simulate(beside if beside.exists() else lab, seed, **options)

    return simulate
