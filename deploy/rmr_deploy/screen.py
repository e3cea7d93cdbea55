"""The display of a run: progress while it goes on, and the table at its end.

On a terminal there is one line per robot, updated in place. Elsewhere a plain line is written when a robot's state or
activity changes; a change of measured values alone writes none, so that a log file stays short. With `--json` all of
it goes to standard error, and standard output is one JSON document. When the output is closed, or cannot be written, a
run continues without display and writes its report.
"""

import re
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple, Protocol

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from rmr.base.printable import printable
from rmr_world.quorum import DIED
from rmr_world.run_report import COLUMNS, rows, several_jobs

MEASURED = re.compile(r"-?\d+\.\d+")
"""Measured values such as seconds and metres, which are left out when two lines are compared."""

COLOURS = {"waiting": "yellow", "ready": "cyan", "running": "blue", "finished": "green", DIED: "bold red"}
"""Colour of each state: those that robots publish, and the fate that the launcher adds."""

MET_COLOURS = {True: "green", False: "bold red", None: ""}


class RobotLine(NamedTuple):
    """The state and progress of one robot."""

    robot: int
    state: str
    """``starting``, a state of `rmr.bus.wire.STATES`, or a fate of `rmr_world.quorum`."""
    progress: str
    """For people: one short line."""
    host: str = ""
    """Where its process is, in a lab over several hosts."""


class Screen(Protocol):
    """The display of a run."""

    def show(self, lab_s: float | None, lines: Sequence[RobotLine]) -> None:
        """Show the robots' states at lab time `lab_s` (None: it has not begun)."""

    def say(self, message: str) -> None:
        """Write a permanent message."""

    def close(self) -> None:
        """End the progress display; messages can still be written."""


class Unread(Console):
    """A console that raises BrokenPipeError where rich would end the process."""

    def on_broken_pipe(self) -> None:
        """Raise it, for the screen to handle."""
        raise BrokenPipeError


def make_screen(*, json: bool) -> Screen:
    """Return the screen for standard output, or for standard error when that is kept for JSON."""
    console = Unread(stderr=json, highlight=False, soft_wrap=not (sys.stderr if json else sys.stdout).isatty())
    return LiveScreen(console) if console.is_terminal else PlainScreen(console)


class LiveScreen:
    """One line per robot on a terminal, redrawn in place."""

    def __init__(self, console: Console) -> None:
        self.console = console
        self._live = Live(console=console, auto_refresh=False, transient=True)
        self._live.start()

    def show(self, lab_s: float | None, lines: Sequence[RobotLine]) -> None:
        """Redraw."""
        with suppress(OSError):  # a terminal that is gone
            self._live.update(Group(_head(lab_s, lines), *map(_drawn, lines)), refresh=True)

    def say(self, message: str) -> None:
        """Write `message` above the lines."""
        with suppress(OSError):
            self._live.console.print(Text(printable(message)))

    def close(self) -> None:
        """Take the lines away; the table follows."""
        with suppress(OSError):
            self._live.stop()


class PlainScreen:
    """A line of text for each change of a robot's state or activity."""

    def __init__(self, console: Console) -> None:
        self.console = console
        self._shown: dict[int, tuple[str, str]] = {}

    def show(self, lab_s: float | None, lines: Sequence[RobotLine]) -> None:
        """Write the lines that have changed."""
        for line in lines:
            news = line.state, MEASURED.sub("", line.progress)
            if self._shown.get(line.robot) != news:
                self._shown[line.robot] = news
                when = "" if lab_s is None else f"{lab_s:7.1f} s  "
                on = f" on {line.host}" if line.host else ""
                self.say(f"{when}robot {line.robot}{on}  {line.state}  {line.progress}".rstrip())

    def say(self, message: str) -> None:
        """Write `message`; an output that cannot be written is ignored."""
        with suppress(OSError):  # reported at the end of the command
            self.console.print(Text(printable(message)))

    def close(self) -> None:
        """Do nothing: what is written is written."""


def _head(lab_s: float | None, lines: Sequence[RobotLine]) -> Text:
    done = sum(line.state == "finished" for line in lines)
    time = "starting" if lab_s is None else f"{lab_s:.1f} s"
    return Text(f"{time}, {done} of {len(lines)} finished", style="bold", no_wrap=True)


def _drawn(line: RobotLine) -> Text:
    on = f"on {line.host:<4} " if line.host else ""
    text = Text(f"robot {line.robot:<4}{on}", no_wrap=True, overflow="ellipsis")
    return text.append(f"{line.state:<9} ", COLOURS.get(line.state, "")).append(printable(line.progress))


def table(report: Mapping[str, Any]) -> Table:
    """Return the table of a report: robot, deadline, finish, lateness, met; the job where a robot has several."""
    drawn = Table(box=None, pad_edge=False, header_style="bold")
    for name in COLUMNS:
        drawn.add_column(name, justify="right")
    several = several_jobs(report)
    if several:
        drawn.add_column("job")
    for row in rows(report):
        *cells, met = row.cells()
        drawn.add_row(*cells, Text(met, MET_COLOURS[row.met]), *([Text(printable(row.job))] if several else []))
    return drawn
