"""Chromium, and runs that are shown."""

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from page_driver import PageDriver
from playwright.sync_api import Browser, sync_playwright
from shown_run import FASTEST, LABS, ShownRecording, ShownRun

from rmr_sim.main import main as simulate


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """A browser for the tests of a module.

    While it is open, playwright has an event loop running in this thread, and `asyncio.run` of other tests would fail.
    """
    path = shutil.which("chromium")
    if path is None and os.environ.get("CI") != "true":
        pytest.skip("no chromium on the PATH: apt-get install chromium")
    assert path is not None, "CI is true and there is no chromium: .ci/run installs it"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def over() -> Iterator[ShownRun]:
    """The run of the corridor, at its end."""
    run = ShownRun("corridor", speed=FASTEST)
    yield run
    run.close()


@pytest.fixture(scope="session")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Return the recording of `rmr sim LAB WORDS...`, made when it is first asked for."""
    made: dict[tuple[str, ...], Path] = {}

    def recording(lab: str, *words: str) -> Path:
        key = (lab, *words)
        if key not in made:
            folder = tmp_path_factory.mktemp("recording") / "run"
            with pytest.MonkeyPatch.context() as patch:
                patch.chdir(LABS.parents[1])
                assert simulate([str(LABS / lab), *words, "--run", str(folder)]) == 0
            made[key] = folder
        return made[key]

    return recording


@pytest.fixture(scope="module")
def recorded(recordings: Callable[..., Path]) -> Iterator[ShownRecording]:
    """The recording of the corridor with a page."""
    shown = ShownRecording(recordings("corridor"))
    yield shown
    shown.close()


@pytest.fixture
def shown() -> Iterator[Callable[..., ShownRun]]:
    """Start runs that are shown while they go on."""
    runs: list[ShownRun] = []

    def start(*words: str, **options: Any) -> ShownRun:
        runs.append(ShownRun(*words, **options))
        return runs[-1]

    yield start
    for run in runs:
        run.close()


@pytest.fixture
def visit(chromium: Browser) -> Iterator[Callable[..., PageDriver]]:
    """Open pages. At the end of the test the console must be without errors, unless it cleared `troubles`."""
    drivers: list[PageDriver] = []

    def open_page(address: str, **options: Any) -> PageDriver:
        drivers.append(PageDriver(chromium, address, **options))
        return drivers[-1]

    yield open_page
    for driver in drivers:
        driver.close()
    troubles = [trouble for driver in drivers for trouble in driver.troubles]
    assert troubles == []
