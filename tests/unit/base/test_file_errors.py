"""An error of a file names the file."""

from pathlib import Path

import pytest

from rmr.base.file_errors import naming


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_names_the_file_that_was_written(tmp_path):
    path = tmp_path / "report"
    path.symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left on device") as full, naming(path):
        path.write_text("x")
    assert full.value.filename == str(path)
