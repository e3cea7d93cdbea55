"""A long run tells on a terminal how it is getting on, and takes the line away in the end."""

import io
import sys

import pytest

from rmr.commands import eval_command as command
from rmr.eval.ensemble import LOOK_EVERY


class Terminal(io.StringIO):
    """A standard error that says whether it is a terminal."""

    def __init__(self, terminal):
        super().__init__()
        self._terminal = terminal

    def isatty(self):
        return self._terminal


class Run:
    """What the line tells of."""

    firings = 1200
    busy = 2
    now = 1_500_000_000


@pytest.mark.parametrize(
    ("terminal", "after_s", "shown"), [(True, 0.0, True), (True, 3600.0, False), (False, 0.0, False)]
)
def test_the_line_is_shown_on_a_terminal_after_a_while(monkeypatch, terminal, after_s, shown):
    monkeypatch.setattr(sys, "stderr", Terminal(terminal))
    monkeypatch.setattr(command, "PROGRESS_AFTER_S", after_s)
    progress = command.ProgressLine(Run, 60_000_000_000)
    progress.refresh()
    progress.refresh()
    progress.clear()
    told = sys.stderr.getvalue()
    assert told.count("1.500 s of 60 s, 1200 firings, 2 robots not idle") == int(shown)
    assert told.endswith("\r\x1b[K") == shown


def test_a_run_is_looked_at_now_and_then(bench, monkeypatch):
    looks = []
    monkeypatch.setattr(command.ProgressLine, "refresh", lambda self: looks.append(1))
    bench.run("a(R, 0). a(R, N), N < 1 -o a(R, N + 1).", "--robots", str(3 * LOOK_EVERY))
    assert len(looks) >= 3
