"""A page's server over a source that the test fills, and clients of it."""

import json
import urllib.error
import urllib.request
from contextlib import contextmanager
from typing import Any

from websockets.sync.client import ClientConnection, connect

from rmr_view.page_server import PageServer, bind
from rmr_view.run_history import RunHistory
from rmr_view.run_source import ENTRIES_MAX, RequestRefusedError, RunClock

TOKEN = "a-token-of-the-tests"
ROBOTS = (1, 2, 3)


class FilledSource:
    """A run that holds what the test puts into `history`."""

    def __init__(self, *, live: bool = True, steer: bool = True, control: bool = True) -> None:
        self.history = RunHistory(ROBOTS)
        self.live = live
        self.steer = steer
        self.may_control = control
        self.report: dict[str, Any] | None = None
        self.orders: list[Any] = []
        self.asked: list[Any] = []
        self.speed = 1.0

    @property
    def clock(self) -> RunClock:
        t = max(0.0, self.history.newest[0])
        return RunClock(t, t, self.live, self.speed)

    def about(self) -> dict[str, Any]:
        return {
            "lab": "bench", "robots": list(ROBOTS), "live": self.live, "steer": self.steer, "control": self.may_control
        }  # fmt: skip

    async def start(self) -> None:
        pass

    async def refresh(self) -> None:
        pass

    async def entries(self, kind, begin, end):
        return self.history.between(kind, begin, end, ENTRIES_MAX + 1)

    async def robot(self, robot, t):
        self.asked.append((robot, t))
        return {"robot": robot, "t": t}

    async def missed(self, robot):
        self.asked.append((robot, "missed"))
        return {"delays": [], "problems": []}

    async def step(self, robot, at, commands):
        self.asked.append((robot, at, commands))
        return {"robot": robot, "at": at}

    async def why(self, robot, fact, t, options):
        if fact == "nix(@1)":
            raise RequestRefusedError("the program knows no fact `nix`")
        self.asked.append((robot, fact, t, options))
        return {"question": fact}

    async def control(self, order):
        self.orders.append(order)
        return {"done": order["do"]}

    async def close(self) -> None:
        pass


class Browser:
    """What a browser would do with the page at `port`."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.base = f"http://127.0.0.1:{port}"

    def fetch(self, path: str, body: bytes | None = None, **headers: str) -> tuple[int, Any, Any]:
        """Return status, content (JSON as a value) and headers of the answer."""
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        request = urllib.request.Request(self.base + path, body, named, method="GET" if body is None else "POST")
        try:
            with urllib.request.urlopen(request, timeout=20) as answer:
                return answer.status, _content(answer), answer.headers
        except urllib.error.HTTPError as error:
            with error:
                return error.code, _content(error), error.headers

    def get(self, path: str) -> Any:
        """Return the JSON at `path`, which is there."""
        status, content, _ = self.fetch(path)
        assert status == 200, content
        return content

    def order(self, token: str = TOKEN, **order: Any) -> tuple[int, Any]:
        """Return status and content of the answer to an order."""
        status, content, _ = self.fetch("/api/control", json.dumps(order).encode(), X_RMR_Token=token)
        return status, content

    def follow(self, **options: Any) -> ClientConnection:
        """Return a WebSocket."""
        return connect(f"ws://127.0.0.1:{self.port}/ws", max_size=None, compression=None, **options)


def _content(answer: Any) -> Any:
    octets = answer.read()
    return json.loads(octets) if answer.headers.get_content_type() == "application/json" else octets


def heard(socket: ClientConnection, kind: str, within_s: float = 20.0) -> dict[str, Any]:
    """Return the next message of `kind`."""
    while True:
        message: dict[str, Any] = json.loads(socket.recv(within_s))
        if message["type"] == kind:
            return message


@contextmanager
def served(source: Any, token: str | None = TOKEN):
    """Serve `source` on a free port; give the browser."""
    server = PageServer(source, bind(0), token)
    server.start()
    try:
        yield Browser(server.port)
    finally:
        server.stop()
        assert not server.serves
