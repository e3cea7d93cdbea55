"""Lines that are redrawn in place, on a pseudo-terminal whose screen is modelled here; styles and widths of texts."""

import fcntl
import io
import os
import re
import struct
import sys
import termios
from contextlib import suppress
from unicodedata import category, east_asian_width

import pytest

from rmr.base.printable import Paint, columns_of, cut
from rmr.entry.terminal import LiveLines, has_colour, moves_cursor, size, text_columns
from rmr_deploy.screen import LiveScreen, RobotLine

SEQUENCE = re.compile(r"\x1b\[([?\d;]*)([A-Za-z])|(.)", re.DOTALL)

END = "\a"
"""Written to know that all before has passed the terminal."""


class Shown:
    """The screen of a terminal, as far as what is written to it uses one."""

    def __init__(self, columns, rows):
        self.columns, self.rows = columns, rows
        self.lines = [""]  # those that have scrolled away, and the screen
        self.row = 0
        self.begins = True  # whether the cursor is in the first column
        self.cursor = True

    def feed(self, text):
        for numbers, name, char in SEQUENCE.findall(text):
            if name == "A":
                self.row = max(self.row - int(numbers), len(self.lines) - self.rows, 0)
            elif name == "J":
                assert self.begins
                del self.lines[self.row :]
                self.lines.append("")
            elif name in "hl" and numbers == "?25":
                self.cursor = name == "h"
            elif char == "\r":
                self.begins = True
            elif char == "\n":
                assert self.begins, "a terminal adds a carriage return"
                self.row += 1
                if self.row == len(self.lines):
                    self.lines.append("")
            elif char:
                width = 0 if category(char) == "Mn" else 2 if east_asian_width(char) == "W" else 1
                assert columns_of(self.lines[self.row]) + width < self.columns, "it may wrap"
                assert not (self.begins and self.lines[self.row]), "it is written over"
                self.lines[self.row] += char
                self.begins = False
            else:
                assert name in ("", "m"), name
        return self.lines


class Terminal:
    """A pseudo-terminal: a stream to write to, and what it shows."""

    def __init__(self, columns, rows):
        self._reader, writer = os.openpty()
        fcntl.ioctl(writer, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        self.stream = os.fdopen(writer, "w", encoding="utf-8")
        self._shown = Shown(columns, rows)

    def shows(self):
        self.stream.write(END)
        self.stream.flush()
        octets = b""
        while not octets.endswith(END.encode()):
            octets += os.read(self._reader, 1 << 16)
        return self._shown.feed(octets.decode().removesuffix(END))

    @property
    def cursor(self):
        return self._shown.cursor

    def leave(self):
        """Take the terminal away from the one who writes to it."""
        if self._reader >= 0:
            os.close(self._reader)
        self._reader = -1

    def close(self):
        with suppress(OSError):
            self.stream.close()
        self.leave()


@pytest.fixture(params=[(80, 24), (40, 10)], ids=str)
def terminal(request, monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.delenv("COLUMNS", raising=False)
    made = Terminal(*request.param)
    yield made
    made.close()


def test_lines_are_redrawn_in_place_and_messages_stay_above(terminal, monkeypatch):
    monkeypatch.setattr(sys, "stdout", terminal.stream)
    with LiveLines(terminal.stream) as live:
        live.show(["1.0 s", "robot 1  running"])
        assert terminal.shows() == ["1.0 s", "robot 1  running"]
        assert not terminal.cursor
        live.show(["1.2 s", "robot 1  waits", "robot 2  waits"])
        assert terminal.shows() == ["1.2 s", "robot 1  waits", "robot 2  waits"]
        print("half a", end="")
        live.show(["1.4 s"])
        assert terminal.shows() == ["1.4 s"]
        print(" message")
        assert terminal.shows() == ["half a message", "1.4 s"]
    assert terminal.shows() == ["half a message", ""]
    assert terminal.cursor
    assert sys.stdout is terminal.stream


def test_what_has_no_row_is_counted_and_messages_scroll_away_above(terminal):
    _, rows = size(terminal.stream)
    with LiveLines(terminal.stream) as live:
        for _ in range(3):
            live.show([f"robot {number}" for number in range(rows + 5)])
        assert terminal.shows() == [*(f"robot {number}" for number in range(rows - 1)), "... and 6 more"]
        live.write("message\n")
        assert terminal.shows()[:2] == ["message", "robot 0"]
    assert terminal.shows() == ["message", ""]


@pytest.mark.parametrize(
    "text", ["a" * 200, "長" * 100, "e\u0301" * 200, "a\nb" * 100], ids=["narrow", "wide", "combining", "feeds"]
)
def test_no_line_wraps(terminal, text):
    columns, _ = size(terminal.stream)
    with LiveLines(terminal.stream) as live:
        live.show([Paint(True)("bold red", text), "last"])
        line, last = terminal.shows()
    assert line.endswith("...")
    assert columns - 2 <= columns_of(line) < columns
    assert last == "last"


def test_an_exception_leaves_the_cursor_and_the_streams_as_they_were(terminal, monkeypatch):
    monkeypatch.setattr(sys, "stdout", terminal.stream)

    def stopped():
        with LiveLines(terminal.stream) as live:
            live.show(["runs"])
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert terminal.shows() == [""]
    assert terminal.cursor
    assert sys.stdout is terminal.stream


def test_a_terminal_that_is_gone_is_no_error(terminal, monkeypatch):
    monkeypatch.setattr(sys, "stdout", terminal.stream)
    screen = LiveScreen(terminal.stream)
    screen.show(None, [RobotLine(1, "starting", "")])
    terminal.leave()
    with pytest.raises(OSError, match="Input/output error"):
        print("is it gone?", file=terminal.stream, flush=True)
    screen.show(1.0, [RobotLine(1, "running", "waits")])
    screen.say("message")
    screen.close()
    assert sys.stdout is terminal.stream


def test_a_run_has_a_line_for_each_robot_without_control_characters(terminal):
    screen = LiveScreen(terminal.stream)
    screen.show(1.5, [RobotLine(1, "running", "go \x1b[2J"), RobotLine(2, "finished", "", "b")])
    assert [line.rstrip() for line in terminal.shows()] == [
        "1.5 s, 1 of 2 finished",
        "robot 1   running   go ?[2J",
        "robot 2   on b    finished",
    ]
    screen.say("robot 1 \x1b[2J")
    assert terminal.shows()[0] == "robot 1 ?[2J"
    screen.close()
    screen.say("over")
    assert terminal.shows() == ["robot 1 ?[2J", "over", ""]


@pytest.mark.parametrize(
    ("environment", "redraws", "coloured"),
    [
        ({}, True, True),
        ({"NO_COLOR": ""}, True, True),
        ({"NO_COLOR": "1"}, True, False),
        ({"TERM": "dumb"}, False, False),
    ],
    ids=str,
)
def test_a_terminal_has_what_it_and_its_user_want(terminal, monkeypatch, environment, redraws, coloured):
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert (moves_cursor(terminal.stream), has_colour(terminal.stream)) == (redraws, coloured)


def test_a_file_is_no_terminal():
    file = io.StringIO()
    assert (moves_cursor(file), has_colour(file), size(file)) == (False, False, (80, 24))


@pytest.mark.parametrize(("told", "columns"), [(None, None), ("30", 30), ("500", 100), ("0", None), ("wide", None)])
def test_text_is_as_wide_as_the_user_or_the_terminal_says(terminal, monkeypatch, told, columns):
    monkeypatch.setattr(sys, "stdout", terminal.stream)
    if told is not None:
        monkeypatch.setenv("COLUMNS", told)
    assert text_columns() == (columns or size(terminal.stream)[0])


@pytest.mark.parametrize(
    ("text", "columns_max", "shown"),
    [
        ("abcdef", 6, "abcdef"),
        ("abcdefg", 6, "abc..."),
        ("長長長", 6, "長長長"),
        ("長長長長", 6, "長..."),
        ("e\u0301" * 7, 6, "e\u0301" * 3 + "..."),
        ("\x1b[31mabcdefg\x1b[0m", 6, "\x1b[31mabc\x1b[0m..."),
        ("\x1b[31mabc\x1b[0mdef", 6, "\x1b[31mabc\x1b[0mdef"),
        ("abcdef", 2, ".."),
        ("abc", 0, ""),
    ],
)
def test_a_line_is_cut_by_columns_and_keeps_its_styles(text, columns_max, shown):
    assert cut(text, columns_max) == shown


def test_styles_are_words_and_without_colour_there_are_none():
    assert Paint(True)("bold red", "no") == "\x1b[1;31mno\x1b[0m"
    assert Paint(True)("", "no") == Paint(False)("bold red", "no") == "no"
