"""The display of a run while it goes on; `rmr_world.run_report` has the table at its end.

On a terminal there is one line per robot, updated in place. Elsewhere a plain line is written when a robot's state or
activity changes; a change of measured values alone writes none, so that a log file stays short. With `--json` all of
it goes to standard error, and standard output is one JSON document. When the output is closed, or cannot be written, a
run continues without display and writes its report.
"""

import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple, Protocol, TextIO

from rmr.base.printable import Paint, printable
from rmr.entry.terminal import LiveLines, has_colour, moves_cursor
from rmr_world.quorum import DIED

MEASURED = re.compile(r"-?\d+\.\d+")
"""Measured values such as seconds and metres, which are left out when two lines are compared."""

COLOURS = {"waiting": "yellow", "ready": "cyan", "running": "blue", "finished": "green", DIED: "bold red"}
"""Colour of each state: those that robots publish, and the fate that the launcher adds."""


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


def make_screen(*, json: bool) -> Screen:
    """Return the screen for standard output, or for standard error when that is kept for JSON."""
    stream = sys.stderr if json else sys.stdout
    return LiveScreen(stream) if moves_cursor(stream) else PlainScreen(stream)


class LiveScreen:
    """One line per robot on a terminal, redrawn in place."""

    def __init__(self, stream: TextIO) -> None:
        self._paint = Paint(has_colour(stream))
        self._live = LiveLines(stream).begin()

    def show(self, lab_s: float | None, lines: Sequence[RobotLine]) -> None:
        """Redraw."""
        done = sum(line.state == "finished" for line in lines)
        time = "starting" if lab_s is None else f"{lab_s:.1f} s"
        head = self._paint("bold", f"{time}, {done} of {len(lines)} finished")
        self._live.show([head, *map(self._drawn, lines)])

    def say(self, message: str) -> None:
        """Write `message` above the lines."""
        self._live.write(f"{printable(message)}\n")

    def close(self) -> None:
        """Take the lines away; the table follows."""
        self._live.close()

    def _drawn(self, line: RobotLine) -> str:
        on = f"on {line.host:<4} " if line.host else ""
        state = self._paint(COLOURS.get(line.state, ""), f"{line.state:<9} ")
        return f"robot {line.robot:<4}{on}{state}{printable(line.progress)}"


class PlainScreen:
    """A line of text for each change of a robot's state or activity."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
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
            print(printable(message), file=self._stream, flush=True)

    def close(self) -> None:
        """Do nothing: what is written is written."""
