"""The fixture of the tests of `rmr eval`."""

import pytest
from eval_command import Bench


@pytest.fixture
def bench(tmp_path):
    """A folder of programs and the command run on them."""
    return Bench(tmp_path)
