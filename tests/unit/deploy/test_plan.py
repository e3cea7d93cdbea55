"""What a run needs before it starts: mistakes are refused, whatever they are about."""

import os
from pathlib import Path

import pytest

from rmr_deploy.plan import USAGE, RefusedError, Wishes, make_plan

DASH = Path(__file__).parents[2] / "integration" / "labs" / "dash"


def test_an_empty_run_folder_that_may_not_be_written_is_wrong_usage(tmp_path, monkeypatch):
    def denied(path, *_args, **_options):
        raise PermissionError(13, os.strerror(13), str(path))

    folder = tmp_path / "run"
    folder.mkdir()
    monkeypatch.setattr(Path, "write_bytes", denied)
    with pytest.raises(RefusedError, match=r"dash\.rbc: Permission denied; name a run folder") as refusal:
        make_plan(Wishes(lab=DASH, folder=folder), color=False)
    assert refusal.value.exit_code == USAGE
