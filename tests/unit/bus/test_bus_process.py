"""What processes have in common: their ends, signals and logs."""

import asyncio
import json
import logging
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from rmr.bus.process import Ending, LogFile, handle_signals, start_logging
from rmr.entry import ExitCode


@pytest.fixture
def logger():
    """Return the process's logger and leave it as it was."""
    it = logging.getLogger("rmr")
    before = it.level, it.propagate, list(it.handlers)
    yield it
    for handler in set(it.handlers) - set(before[2]):
        it.removeHandler(handler)
        handler.close()
    it.setLevel(before[0])
    it.propagate = before[1]


@pytest.fixture
def handlers():
    """Restore the handlers of signals."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


# --- ends and signals -----------------------------------------------------------------------------------------


def test_first_reason_for_stopping_is_kept():
    ending = Ending()
    ending.ask("finished")
    ending.ask("too late", ExitCode.FAILED)
    assert (ending.asked, ending.reason, ending.code) == (True, "finished", 0)


def test_a_breakdown_is_a_failure_that_names_the_error():
    ending = Ending()
    ending.break_down(ValueError("no"))
    assert (ending.reason, ending.code) == ("internal error: ValueError: no", ExitCode.FAILED)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_asks_for_an_orderly_end(handlers, number):
    async def play():
        ending = Ending()
        handle_signals(ending)
        os.kill(os.getpid(), number)
        await asyncio.wait_for(ending.wait(), 5)
        return ending

    ending = asyncio.run(play())
    assert (ending.reason, ending.code) == (number.name, 0)


def test_a_second_signal_ends_even_a_process_whose_event_loop_is_blocked():
    code = """
import asyncio, time
from rmr.bus.process import Ending, handle_signals

async def block():
    handle_signals(Ending())
    print("blocked", flush=True)
    while True:
        time.sleep(0.01)

asyncio.run(block())
"""
    command = [sys.executable, "-c", code]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "blocked\n"
        while process.poll() is None:  # two signals at once are one
            process.send_signal(signal.SIGINT)
        assert process.returncode == ExitCode.FAILED
        assert process.stderr.read() == ""


# --- logs -----------------------------------------------------------------------------------------------------


def test_a_log_has_a_line_for_people_and_a_json_line_for_programs(logger, tmp_path, capsys):
    start_logging("robot", tmp_path / "logs" / "robot.jsonl")
    logger.info("here", extra={"data": {"x": 1}})
    logger.debug("quiet")
    assert capsys.readouterr().err == "robot: here\n"
    lines = [json.loads(line) for line in (tmp_path / "logs" / "robot.jsonl").read_text().splitlines()]
    assert [(line["who"], line["message"], line.get("x")) for line in lines] == [
        ("robot", "here", 1),
        ("robot", "quiet", None),
    ]


def test_a_second_start_of_logging_replaces_the_first_so_that_no_line_is_doubled(logger, tmp_path, capsys):
    start_logging("first", tmp_path / "first.jsonl")
    start_logging("second", None)
    logger.info("here")
    assert capsys.readouterr().err == "second: here\n"
    assert (tmp_path / "first.jsonl").read_text() == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_full_disk_is_reported_once_and_the_process_continues_without_its_log(logger, capsys):
    start_logging("robot", Path("/dev/full"))
    logger.info("one")
    logger.info("two")
    assert capsys.readouterr().err.splitlines() == [
        "robot: one",
        "robot: cannot write the log /dev/full any more: No space left on device",
        "robot: two",
    ]
    assert LogFile.failure == "/dev/full: No space left on device"
    assert not any(isinstance(handler, LogFile) for handler in logger.handlers)
