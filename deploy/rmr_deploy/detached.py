"""`rmr up -d`: the launcher in the background.

The command starts itself once more as the launcher, in a session of its own, and waits until that has checked the lab
and started the processes (with ``--wait``: until all robots are ready). The launcher writes its events as lines of
JSON into a pipe, until nobody reads it any more. Refusals reach the terminal; from the start on its output is the file
`OUTPUT_FILE` in the run folder.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from rmr.entry import ExitCode, print_json
from rmr_deploy.process_group import LAST_LINES

PIPE_VARIABLE = "RMR_DETACHED"
"""Environment variable with the number of the pipe's write end, by which the launcher knows that it is one."""
OUTPUT_FILE = "launcher.out"
"""What the launcher in the background writes, in the run folder."""


def start_detached(*, wait: bool, as_json: bool) -> int:
    """Start this command once more as the launcher; return the exit code, the launcher's own if it has ended."""
    read, write = os.pipe()
    launcher = subprocess.Popen(
        [sys.executable, *sys.orig_argv[1:]],
        stdin=subprocess.DEVNULL,
        env=os.environ | {PIPE_VARIABLE: str(write)},
        pass_fds=(write,),
        start_new_session=True,
    )
    os.close(write)
    told: dict[str, Any] = {}
    with open(read, encoding="utf-8") as pipe:
        try:
            for event in _events(pipe):
                told |= event
                if event["event"] == "over" or event["event"] == ("ready" if wait else "started"):
                    break
            else:
                return launcher.wait() or ExitCode.FAILED
        except KeyboardInterrupt:
            return _interrupted(launcher, told)
    if told["event"] == "over":
        _show_end(Path(told["folder"]), str(told.get("reason", "")))
        return launcher.wait() or ExitCode.FAILED
    _show_start(told, launcher.pid, as_json=as_json)
    launcher.returncode = ExitCode.OK  # it goes on: Popen must not warn of it
    return ExitCode.OK


def _events(pipe: Iterator[str]) -> Iterator[dict[str, Any]]:
    for line in pipe:
        with suppress(ValueError):
            yield json.loads(line)


def _interrupted(launcher: "subprocess.Popen[bytes]", told: dict[str, Any]) -> int:
    if told:
        print(f"rmr up: the run goes on in the background; to end it: rmr down --run {told['folder']}", file=sys.stderr)
        launcher.returncode = ExitCode.OK
    else:
        launcher.send_signal(signal.SIGTERM)
        launcher.wait()
        print("rmr up: interrupted", file=sys.stderr)
    return ExitCode.FAILED


def _show_start(told: dict[str, Any], launcher: int, *, as_json: bool) -> None:
    if "warning" in told:
        print(f"rmr up: {told['warning']}", file=sys.stderr)
    if as_json:
        keys = ("lab", "folder", "connect", "page", "ready_s")
        print_json({**{key: told[key] for key in keys if key in told}, "launcher": launcher}, indent=None)
        return
    ready = f"ready after {told['ready_s']:.1f} s" if "ready_s" in told else "starting"
    print(f"lab {told['lab']}, {told['robots']} robots, {ready}; the run folder is {told['folder']}")
    if "page" in told:
        print(f"the page: {told['page']}")


def _show_end(folder: Path, reason: str) -> None:
    print(f"rmr up: the run is over before all robots were ready: {reason}; {folder / OUTPUT_FILE}:", file=sys.stderr)
    with suppress(OSError):
        lines = (folder / OUTPUT_FILE).read_text(errors="replace").splitlines()
        print(*(f"    {line}" for line in lines[-LAST_LINES:]), sep="\n", file=sys.stderr)


class DetachedOutput:
    """The launcher's side of the pipe."""

    def __init__(self, pipe: int) -> None:
        self._pipe = pipe
        self._told: dict[str, Any] = {}

    def begin(self, folder: Path, lab: str, robots: int) -> None:
        """Send the output to the run folder from now on. Raises OSError."""
        os.set_inheritable(self._pipe, False)
        self._told = {"lab": lab, "folder": str(folder), "robots": robots}
        sys.stdout.flush()
        sys.stderr.flush()
        output = os.open(folder / OUTPUT_FILE, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        os.dup2(output, 1)
        os.dup2(output, 2)
        os.close(output)

    def heard(self, event: str, fields: dict[str, Any]) -> None:
        """Tell an event of the run, as long as somebody reads."""
        if self._pipe < 0 or event not in {"started", "ready", "over"}:
            return
        line = json.dumps({**self._told, **fields, "event": event}) + "\n"
        try:
            os.write(self._pipe, line.encode())
        except OSError:  # Python ignores SIGPIPE: the command that waited has ended
            os.close(self._pipe)
            self._pipe = -1


def detached_output() -> DetachedOutput | None:
    """Return the pipe to the command that started this launcher; None if it runs in the foreground."""
    number = os.environ.pop(PIPE_VARIABLE, "")
    return DetachedOutput(int(number)) if number.isdigit() else None
