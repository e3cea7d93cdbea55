"""Runs of `rmr up` for the tests of this folder."""

import pytest
from launched import Launched


@pytest.fixture
def up(tmp_path):
    """Return a function that starts `rmr up`."""
    started = []

    def start(lab, *options):
        launched = Launched(lab, tmp_path, *options)
        started.append(launched)
        return launched

    yield start
    for launched in started:
        launched.clean_up()
