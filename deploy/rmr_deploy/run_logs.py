"""`rmr logs` and `rmr events`: the logs of a run's processes as one, in the order of lab time; also after its end.

A line that has no lab time, such as "robot 4 is here", gets it from its wall time. The difference of the two clocks is
the smallest over all lines that have both: a line is written some time after what it tells.
"""

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from math import inf
from pathlib import Path
from typing import Any, NamedTuple, TextIO

from rmr.entry import ExitCode
from rmr_deploy.active_runs import LaunchedRun
from rmr_deploy.event_log import EVENTS_FILE, WHO
from rmr_deploy.run_choice import FleetError, Remote, check_robots, chosen_run, shown
from rmr_deploy.run_requests import Who, base_name

POLL_S = 0.1
"""Period with which logs are read on."""
HOLD_S = 0.5
"""Time for which a line is held back while others that happened before may still be written: robots write the trace
of a tick up to a quarter of a second later."""

FRAME = ("time", "level", "who", "message", "t", "robot", "what", "event")
"""Keys of a line that are not shown again behind its message."""


class LogLine(NamedTuple):
    """A line of a log."""

    lab_s: float | None
    """When it happened, in lab time; None if no line has told the difference of the clocks."""
    wall_s: float
    who: str
    """``world``, ``robot-4``, ``rmr up``."""
    fields: dict[str, Any]


class RunLogs:
    """The logs of a run, read as they grow."""

    def __init__(self, folder: Path, robots: Sequence[Who] = (), *, events_only: bool = False) -> None:
        """`robots` are those that are wanted, the world or the router; without any all are."""
        self._folder = folder
        self._robots = frozenset(robots)
        self._processes = {robot if isinstance(robot, str) else f"robot-{robot}" for robot in robots}
        self._events_only = events_only
        self.host = ""
        """The host of the run and a slash, before the names of its processes; empty for a run on this machine."""
        self._read: dict[Path, int] = {}
        """Octets of each file that have been read."""
        self._offset_s: float | None = None
        """Wall time at lab time 0."""
        self._held: list[tuple[float, str, dict[str, Any]]] = []

    def lines(self, *, held: bool = False) -> list[LogLine]:
        """Return the new lines in order; with `held` those that were written in the last `HOLD_S` are held back."""
        for path, octets in self._new():
            self._held += [(fields["time"], _who(path, fields), fields) for fields in self._fields(octets)]
        until_s = self.clock_s - HOLD_S if held else inf
        ready = [one for one in self._held if one[0] <= until_s]
        self._held = [one for one in self._held if one[0] > until_s]
        found = [LogLine(self._lab_s(wall_s, fields), wall_s, self.host + who, fields) for wall_s, who, fields in ready]
        return sorted((one for one in found if self._wanted(one)), key=by_lab_time)

    @property
    def clock_s(self) -> float:
        """Wall time on the machine of the run."""
        return time.time()

    @property
    def now_s(self) -> float | None:
        """Lab time now; None if no line has told the difference of the clocks."""
        return None if self._offset_s is None else self.clock_s - self._offset_s

    def _new(self) -> Iterator[tuple[Path, bytes]]:
        """Yield the files and what was added to them, whole lines only."""
        for path in log_files(self._folder, events_only=self._events_only):
            whole, self._read[path] = _added(path, self._read.get(path, 0))
            yield path, whole

    def _fields(self, octets: bytes) -> Iterator[dict[str, Any]]:
        """Yield the lines in `octets` that are lines of a log."""
        for line in octets.splitlines():
            try:
                fields = json.loads(line)
            except ValueError:
                continue
            if isinstance(fields, dict) and isinstance(fields.get("time"), int | float):
                if isinstance(fields.get("t"), int | float):
                    offset_s = fields["time"] - fields["t"]
                    self._offset_s = offset_s if self._offset_s is None else min(offset_s, self._offset_s)
                yield fields

    def _lab_s(self, wall_s: float, fields: dict[str, Any]) -> float | None:
        told = fields.get("t")
        if isinstance(told, int | float):
            return float(told)
        return None if self._offset_s is None else wall_s - self._offset_s

    def _wanted(self, line: LogLine) -> bool:
        if self._events_only or not self._robots:
            return True
        process = base_name(line.who)
        # Whatever world or router say, of robots, too, and what is said of their processes.
        if process in self._robots or base_name(str(line.fields.get("process", ""))) in self._robots:
            return True
        robot = line.fields.get("robot")
        return process in self._processes if robot is None else type(robot) in (int, str) and robot in self._robots


def log_files(folder: Path, *, events_only: bool = False) -> list[Path]:
    """Return the logs of the run in `folder`."""
    return [*([] if events_only else sorted((folder / "logs").glob("*.jsonl"))), folder / EVENTS_FILE]


def _added(path: Path, begin: int, octets_max: int = -1) -> tuple[bytes, int]:
    """Return the whole lines of a file from `begin` on, of `octets_max` at most, and where they end."""
    try:
        with path.open("rb") as file:
            file.seek(begin)
            octets = file.read(octets_max)
    except OSError:  # not there yet, or no more
        return b"", begin
    whole = octets[: octets.rfind(b"\n") + 1]
    return whole, begin + (len(whole) if whole or len(octets) != octets_max else octets_max)


def told_log(folder: Path, request: Mapping[str, Any]) -> dict[str, Any] | str:
    """Answer `rmr logs` on another machine: the sizes of all logs, or what one `file` has from `begin` on."""
    files = {path.name: path for path in log_files(folder) if path.exists()}
    name = request.get("file")
    begin = request.get("begin")
    if name is None:
        sizes = {name: path.stat().st_size for name, path in files.items()}
        return {"files": sizes, "clock_s": time.time()}
    if name not in files or type(begin) is not int or begin < 0:
        return f"there is no log {name}"
    whole, end = _added(files[name], begin, 1 << 17)  # as JSON it is twice as long at most, which fits an answer
    return {"lines": whole.decode(errors="replace"), "end": end}


def _who(path: Path, fields: dict[str, Any]) -> str:
    """Return the process of a line; of one that carries several robots, the robot that it is about."""
    if path.name == EVENTS_FILE:
        return WHO
    robot = fields.get("robot")
    return f"robot-{robot}" if type(robot) is int and "." not in path.stem else path.stem


def by_lab_time(line: LogLine) -> tuple[float, float]:
    """Return the place of a line in the order of lab time."""
    return (line.lab_s if line.lab_s is not None else -1e18, line.wall_s)


def shown_line(line: LogLine) -> str:
    """Return a line for people."""
    when = " " * 11 if line.lab_s is None else f"{line.lab_s:9.3f} s"
    rest = [f"{key}={_value(value)}" for key, value in line.fields.items() if key not in FRAME and value is not None]
    if line.who.rpartition("/")[2] == WHO:
        rest = []  # its messages are whole sentences
    return " ".join([when, f"{line.who:10}", str(line.fields.get("message", "")), *rest])


def _value(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3f}"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def json_line(line: LogLine) -> str:
    """Return a line as JSON, with its lab time `t` and its process."""
    stamp = {} if line.lab_s is None else {"t": round(line.lab_s, 6)}
    return json.dumps({**line.fields, **stamp, "process": line.who}, ensure_ascii=False)


def show_logs(
    folder: Path | None,
    lab: str | None,
    robots: Sequence[Who] = (),
    *,
    follow: bool,
    since_s: float | None,
    tail: int | None,
    as_json: bool,
    events_only: bool = False,
    there: Remote | None = None,
) -> int:
    """Print the logs of a run, of the lab that runs `there`, with `follow` until it is over. Raises FleetError.

    `since_s` leaves out what was earlier before now, or before the end of a run that is over; `tail` is the number of
    lines at most, of those that are there.
    """
    run = there or chosen_run(folder, lab, past=True)
    check_robots(run, robots)
    if isinstance(run, LaunchedRun):
        logs: list[RunLogs] = [RunLogs(_present(run.folder), robots, events_only=events_only)]
    else:
        logs = run.logs(robots, events_only=events_only)
    follow = follow and run.launched
    lines = _merged(logs, held=follow)
    last_s = max((one.lab_s for one in lines if one.lab_s is not None), default=None)
    first_s = next((one.now_s for one in logs if one.now_s is not None), last_s) if run.launched else last_s
    if since_s is not None and first_s is not None:
        lines = [one for one in lines if one.lab_s is not None and one.lab_s >= first_s - since_s]
    write = json_line if as_json else shown_line
    _print(lines if tail is None else lines[max(0, len(lines) - tail) :], write, sys.stdout)
    with suppress(KeyboardInterrupt):  # the usual way out
        while follow:
            if follow := run.launched:
                time.sleep(POLL_S)
            _print(_merged(logs, held=follow), write, sys.stdout)
            if isinstance(run, LaunchedRun):
                _present(run.folder)
    return ExitCode.OK


def _present(folder: Path) -> Path:
    """Return the run folder. Raises FleetError if it was removed."""
    if not folder.is_dir():
        raise FleetError(f"the run folder {shown(folder)} was removed, and its logs with it", ExitCode.FAILED)
    return folder


def _merged(logs: Sequence[RunLogs], *, held: bool) -> list[LogLine]:
    return sorted((line for one in logs for line in one.lines(held=held)), key=by_lab_time)


def _print(lines: Sequence[LogLine], write: Callable[[LogLine], str], stream: TextIO) -> None:
    stream.writelines(f"{write(line)}\n" for line in lines)
    stream.flush()


def last_event(run: LaunchedRun, event: str) -> dict[str, Any] | None:
    """Return the fields of the last `event` of a run; None if there was none."""
    found = [line.fields for line in RunLogs(run.folder, events_only=True).lines() if line.fields["event"] == event]
    return found[-1] if found else None
