"""Where output goes that no regular file takes: full disks, pipes, links."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rmr.commands.common import write

PROGRAM = "type n(robot, int).\nn(R, 1).\nn(R, X), X < 3 -o n(R, X + 1).\n"


@pytest.mark.medium
@pytest.mark.parametrize("words", [["eval", "p.rmr"], ["check", "--explain", "p.rmr"], ["explain", "E001"]])
def test_an_output_that_takes_nothing_is_told_without_a_traceback(words: list[str], tmp_path: Path) -> None:
    (tmp_path / "p.rmr").write_text(PROGRAM)
    command = [sys.executable, "-c", "from rmr.cli import main; main()", *words]
    with open("/dev/full", "w") as full:
        answer = subprocess.run(command, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert answer.returncode == 1
    assert answer.stderr == "rmr: cannot write the output: No space left on device\n"


def test_a_pipe_gets_the_octets_and_stays_a_pipe(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    assert write(pipe, b"octets") == 0
    assert (os.read(reader, 10), pipe.is_fifo()) == (b"octets", True)
    os.close(reader)


def test_a_link_leads_to_the_file_that_is_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"old")
    (tmp_path / "link").symlink_to("file")
    assert write(tmp_path / "link", b"new") == 0
    assert ((tmp_path / "file").read_bytes(), (tmp_path / "link").is_symlink()) == (b"new", True)
