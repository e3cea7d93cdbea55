"""The page of `rmr up`: its address at once, its process when somebody opens it.

The launcher holds a listening socket and prints the address. Nothing else happens, and nothing is loaded, until the
first connection comes; then `rmr view` is started as a process of its own and inherits the socket, in whose queue that
connection waits. The page outlives the run, and shows what was, as long as it is open in a browser.
"""

import asyncio
import os
import secrets
import socket
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from rmr_deploy.preparation import RunPlan

LEAVE_S = 60.0
"""The page's process ends so long after the run is over and the last page is closed."""
TOKEN_VARIABLE = "RMR_VIEW_TOKEN"
"""Environment variable by which the page's process gets its token: other users cannot read it."""


def open_page(plan: RunPlan, say: Callable[[str], None]) -> "PageStart | None":
    """Return the page of a run and `say` its address: where it is asked for, and to a person at a terminal."""
    options = plan.options
    asked = options.view or options.control or options.port is not None
    if options.no_view or not (asked or (sys.stdout.isatty() and not options.as_json)):
        return None
    try:
        # What the page's process writes, in the folder of logs.
        page = PageStart(plan.folder, plan.logs / "page.out", port=options.port or 0, control=options.control)
    except OSError as error:
        say(f"no page: port {options.port or 0}: {error.strerror}; choose another one with --port")
        return None
    page.watch()
    say(f"the page: {page.address}")
    return page


class PageStart:
    """The page of one run, until its process takes over."""

    def __init__(self, folder: Path, output: Path, *, port: int = 0, control: bool = False) -> None:
        """Listen on loopback; port 0 is a free one. Raises OSError."""
        self._folder = folder
        self._output = output
        self._token = secrets.token_urlsafe(16) if control else None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._socket.bind(("127.0.0.1", port))
            self._socket.listen(128)
        except OSError:
            self._socket.close()
            raise
        self.process: subprocess.Popen[bytes] | None = None

    @property
    def address(self) -> str:
        """The address to open, with the token in its fragment."""
        fragment = "" if self._token is None else f"#token={self._token}"
        return f"http://127.0.0.1:{self._socket.getsockname()[1]}/{fragment}"

    def watch(self) -> None:
        """Start the page's process at the first connection; on the event loop."""
        asyncio.get_running_loop().add_reader(self._socket, self._start)

    def _start(self) -> None:
        self._unwatch()
        control = ["--control"] if self._token is not None else []
        words = [str(self._folder), "--listener", str(self._socket.fileno()), "--leave", f"{LEAVE_S:g}", *control]
        with suppress(OSError), self._output.open("ab") as sink:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-m", "rmr_view.view", *words],
                stdin=subprocess.DEVNULL,
                stdout=sink,
                stderr=sink,
                env=os.environ | ({} if self._token is None else {TOKEN_VARIABLE: self._token}),
                pass_fds=(self._socket.fileno(),),
                start_new_session=True,
            )

    def _unwatch(self) -> None:
        with suppress(OSError, ValueError):
            asyncio.get_running_loop().remove_reader(self._socket)

    def close(self) -> None:
        """Leave the socket to the page's process, if there is one."""
        self._unwatch()
        self._socket.close()
