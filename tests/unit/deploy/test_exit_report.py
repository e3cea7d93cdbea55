"""The exit report of a process: its exit code or signal, and the end of its output."""

import subprocess
import sys

import pytest

from rmr_deploy.process_group import LAST_LINES, Child, exit_report, how, last_lines


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0, "ended with exit code 0"),
        (3, "ended with exit code 3"),
        (-9, "was killed by SIGKILL"),
        (-40, "was killed by signal 40"),
    ],
)
def test_an_exit_code_or_signal_is_put_into_words(code, words):
    assert how(code) == words


def test_an_exit_report_names_the_process_its_exit_code_and_its_last_output(tmp_path):
    output = tmp_path / "robot-3.out"
    output.write_text("robot 3: no handler for action blink\n")
    process = subprocess.Popen([sys.executable, "-S", "-c", "raise SystemExit(3)"])
    process.wait()
    assert exit_report(Child("robot-3", process, output)) == (
        f"robot-3 (pid {process.pid}) ended with exit code 3; its last words:\n    robot 3: no handler for action blink"
    )


def test_only_the_end_of_a_long_output_is_read(tmp_path):
    output = tmp_path / "robot-1.out"
    with output.open("wb") as file:
        file.truncate(1 << 36)  # sparse: it takes no room, and nobody reads it whole
    with output.open("a") as file:
        file.write("".join(f"line {number}\n" for number in range(200_000)))
    assert last_lines(output) == [f"line {number}" for number in range(200_000 - LAST_LINES, 200_000)]


def test_octets_that_are_no_text_do_not_hide_the_rest(tmp_path):
    output = tmp_path / "robot-1.out"
    output.write_bytes(b"\xff\xfe broken\nlast\n")
    assert last_lines(output)[-1] == "last"
