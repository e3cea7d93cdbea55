"""The active runs on this machine, found by their run folders: there is no daemon.

`rmr up` leaves in the run folder where its world listens, the ids and starts of its processes and, while it runs, the
secret of its bus. A run is under way while its launcher lives and no report has been written.

A copy of this record lies in a folder of the user's, the register, until the run is over. It leads to the runs of all
folders, and to the processes of a run whose folder has been removed or cannot be read. Every record is checked against
the processes themselves: a register that was lost, or a launcher that was killed, leaves nothing that misleads. What
another user has written, as in a `runs` in a shared folder, is no record of this user's runs and signals nobody.
"""

import json
import os
import shlex
import stat
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from rmr.base.file_errors import naming
from rmr_deploy.process_identity import lives, start_mark
from rmr_deploy.run_requests import ask_launcher

PROCESSES_FILE = "processes.json"
REPORT_FILE = "report.json"
"""As `rmr_world.run_report` names it, which takes long to import."""
LAB_COPY = "lab.json"
"""The lab as the run took it, in the run folder."""
SECRET_FILE = "secret"
"""As `rmr.bus.secret` names it."""
OPERATOR_KEYS = "keys/operator"
"""The folder with the launcher's keys in that of a run."""
REGISTER_VARIABLE = "RMR_REGISTER"
"""Environment variable that names the register's folder."""
RUNS = Path("runs")
"""Where `rmr up` makes its run folders."""


class RecordedProcess(NamedTuple):
    """A process of a run, as the record names it."""

    name: str
    """``launcher``, ``world``, ``robot-4``, ``robot-4.1``, ``robot-1-20``."""
    pid: int
    mark: str | None
    """Its start (`process_identity`); None in records of older versions."""

    @property
    def lives(self) -> bool:
        """Whether it runs."""
        return lives(self.pid, self.mark)


@dataclass(frozen=True, slots=True)
class LaunchedRun:
    """A run of processes, as its record tells."""

    folder: Path
    """Its run folder, which may have been removed."""
    record: Mapping[str, Any]

    @property
    def lab(self) -> str:
        """The name of the lab; that of the folder where the record has none."""
        name = self._lab.get("name")
        return name if isinstance(name, str) else self.folder.name

    @property
    def roster(self) -> tuple[int, ...]:
        """The ids of the robots; empty where the record has none."""
        roster = self._lab.get("roster")
        return tuple(one for one in roster if type(one) is int) if isinstance(roster, list) else ()

    @property
    def endpoint(self) -> str | None:
        """Where its world listens, or listened."""
        endpoint = self.record.get("connect")
        return endpoint if isinstance(endpoint, str) else None

    @property
    def launcher(self) -> RecordedProcess | None:
        """The process of `rmr up`."""
        pid = self.record.get("launcher")
        return RecordedProcess("launcher", pid, self._mark("launcher")) if type(pid) is int else None

    @property
    def processes(self) -> list[RecordedProcess]:
        """The processes that the launcher has started, the world first."""
        pids = self.record.get("processes")
        pairs = pids.items() if isinstance(pids, dict) else ()
        return [RecordedProcess(name, pid, self._mark(name)) for name, pid in pairs if type(pid) is int]

    @property
    def living(self) -> list[RecordedProcess]:
        """The processes that the launcher has started and that run."""
        return [one for one in self.processes if one.lives]

    @property
    def launched(self) -> bool:
        """Whether its launcher lives, and had not reported its exit code when the record was read."""
        return self.exit_code is None and self.launcher is not None and self.launcher.lives

    @property
    def active(self) -> bool:
        """Whether any of it runs."""
        return self.launched or bool(self.living)

    @property
    def exit_code(self) -> int | None:
        """The exit code of `rmr up`; None while it runs, or if it was killed."""
        code = self.record.get("exit_code")
        return code if type(code) is int else None

    def ask(self, request: Mapping[str, Any], patience_s: float | None = None) -> dict[str, Any]:
        """Return the launcher's answer. Raises RequestError."""
        return ask_launcher(self.folder, request, patience_s)

    @property
    def _lab(self) -> Mapping[str, Any]:
        lab = self.record.get("lab")
        return lab if isinstance(lab, dict) else {}

    def _mark(self, name: str) -> str | None:
        marks = self.record.get("started")
        mark = marks.get(name) if isinstance(marks, dict) else None
        return mark if isinstance(mark, str) else None


# --- writing


def write_processes(folder: Path, endpoint: str, pids: dict[str, int], lab: Mapping[str, Any]) -> str:
    """Write the endpoint, the ids of the processes and what runs (`lab`) into the run folder. Raises OSError.

    The register is written first: of a run whose folder has the record, every verb knows.
    Called again when a process was started: the starts of those that have ended since are kept. Returns a warning if
    the run is not in the register; empty if it is.
    """
    before = _read(folder).get("started")
    known = before if isinstance(before, dict) else {}
    launcher = os.getpid()
    found = {name: start_mark(pid) or known.get(name) for name, pid in {"launcher": launcher, **pids}.items()}
    record: dict[str, Any] = {"launcher": launcher, "connect": endpoint, "processes": pids}
    record |= {"started": {name: mark for name, mark in found.items() if mark}, "lab": dict(lab)}
    why = _register(f"{launcher}.json", {**record, "folder": str(folder.resolve())})
    _write(folder / PROCESSES_FILE, record)
    if not why:
        return ""
    by = f"other commands find it by --run {shlex.quote(str(folder))} alone"
    return f"this run is not in the register: {why}; {by}"


def _register(name: str, record: Mapping[str, Any]) -> str:
    """Write a record into the register; return why it is not there, empty if it is."""
    place = register()
    if place is None:
        return f"there is no folder for it that only you can write ({', '.join(map(str, register_places()))})"
    try:
        _write(place / name, record)
    except OSError as error:
        return f"{place}: {error.strerror or error}"
    return ""


def write_end(folder: Path, exit_code: int) -> str:
    """Note the exit code of the run in its folder, and take it out of the register.

    Returns why it could not be noted, empty if it was, or if the folder was removed.
    """
    record = _read(folder)
    problem = ""
    try:
        if record:
            _write(folder / PROCESSES_FILE, record | {"exit_code": exit_code})
    except OSError as error:
        problem = f"{error.filename}: {error.strerror}; rmr wait will not know that the exit code was {exit_code}"
    for place in _registers():
        with suppress(OSError):
            (place / f"{os.getpid()}.json").unlink(missing_ok=True)
    return problem


def _write(path: Path, record: Mapping[str, Any]) -> None:
    draft = path.with_suffix(".new")
    try:
        with naming(path):
            draft.write_text(json.dumps(record, indent=1) + "\n")
            draft.chmod(0o644)  # whatever the umask: what others can write is believed by nobody
    except OSError:
        draft.unlink(missing_ok=True)
        raise
    with suppress(OSError):  # the age of a record is that of its run
        os.utime(draft, ns=(path.stat().st_atime_ns, path.stat().st_mtime_ns))
    draft.replace(path)


# --- the register


def register_places() -> list[Path]:
    """Return the folders that the register may be in, the one to write first.

    The first ones do not depend on the environment, which differs between shells, cron, services and build steps.
    """
    named = os.environ.get(REGISTER_VARIABLE)
    if named:
        return [Path(named)]
    own = f"rmr-{os.getuid()}"
    places = [(Path("/run/user", str(os.getuid())), "rmr"), (Path("/tmp"), own)]
    for name, inside in (("XDG_RUNTIME_DIR", "rmr"), ("TMPDIR", own)):
        if given := os.environ.get(name):
            places.append((Path(given), inside))
    return list(dict.fromkeys(folder / inside for folder, inside in places if folder.is_dir()))


def register() -> Path | None:
    """Return the folder to write the register in, which nobody else can write; None if there can be none."""
    for folder in register_places():
        with suppress(OSError):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _safe(folder):
            return folder
    return None


def _registers() -> list[Path]:
    return [folder for folder in register_places() if _safe(folder)]


def _safe(folder: Path) -> bool:
    """Whether a folder is there, is the user's, and nobody else can write it."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    return (
        stat.S_ISDIR(found.st_mode)
        and found.st_uid == os.getuid()
        and not found.st_mode & 0o022
        and os.access(folder, os.W_OK | os.X_OK)
    )


def _registered() -> Iterator[LaunchedRun]:
    for path in (path for folder in _registers() for path in sorted(folder.glob("*.json"))):
        record = _read_file(path)
        where = record.get("folder")
        run = LaunchedRun(Path(where if isinstance(where, str) else "?"), record)
        if run.active:
            yield run
        else:  # its launcher was killed, and nothing is left of it
            with suppress(OSError):
                path.unlink()


# --- reading


def active_runs() -> list[LaunchedRun]:
    """Return the runs of which any process lives: those of the register, and those in `RUNS`; the oldest first."""
    found = {run.folder: run for run in _registered()}
    for folder in _folders():
        run = recorded_run(folder)
        if run.folder not in found and run.active:
            found[run.folder] = run
    return sorted(found.values(), key=lambda run: (_written(run.folder), str(run.folder)))


def past_runs() -> list[LaunchedRun]:
    """Return the runs in `RUNS` of which no process lives, the oldest first."""
    return [run for run in map(recorded_run, reversed(_folders())) if not run.active]


def is_ours(folder: Path) -> bool:
    """Return whether the record in `folder` is this user's own, whom alone it lets write it."""
    try:
        found = (folder / PROCESSES_FILE).stat()
    except OSError:
        return False
    return found.st_uid == os.getuid() and not found.st_mode & 0o022


def recorded_run(folder: Path) -> LaunchedRun:
    """Return the run in `folder`; its record is empty if no processes ran there."""
    return LaunchedRun(folder.resolve(), _read(folder))


def endpoint_of(folder: Path) -> str | None:
    """Return where the world of the run in `folder` listens, or listened; None if no processes ran there."""
    return recorded_run(folder).endpoint


def lab_of_run(folder: Path) -> dict[str, Any]:
    """Return what runs in `folder`: `file`, `robots` (their number), `seed`; empty if no processes ran there."""
    lab = _read(folder).get("lab")
    return lab if isinstance(lab, dict) else {}


def under_way(folder: Path) -> bool:
    """Return whether the run in `folder` goes on: its launcher lives, and there is no report yet."""
    return not (folder / REPORT_FILE).exists() and recorded_run(folder).launched


def secret_of(folder: Path) -> Path | None:
    """Return the file with the secret of the run in `folder`, or the folder of its keys; None if it is over."""
    found = (folder / name for name in (SECRET_FILE, OPERATOR_KEYS))
    return next((path for path in found if path.exists()), None)


def _folders() -> list[Path]:
    """Return the folders in `RUNS` in which processes of this user ran, the newest first."""
    folders = [path.parent for path in RUNS.glob(f"*/{PROCESSES_FILE}") if is_ours(path.parent)]
    return sorted(folders, key=lambda folder: (_written(folder), folder), reverse=True)


def _read(folder: Path) -> dict[str, Any]:
    return _read_file(folder / PROCESSES_FILE)


def _read_file(path: Path) -> dict[str, Any]:
    try:
        record = json.loads(path.read_text())
    except (OSError, ValueError, RecursionError):
        return {}
    return record if isinstance(record, dict) else {}


def _written(folder: Path) -> int:
    """Return when the folder's record was written; 0 if it has just been removed."""
    try:
        return (folder / PROCESSES_FILE).stat().st_mtime_ns
    except OSError:
        return 0
