"""The HTTP server of the page: uvicorn on a loopback port, in a thread of its own.

No access log, and no compression of the WebSocket: deflating a message of poses costs more than sending it.
"""

import errno
import logging
import socket
import threading
import time
from collections.abc import Sequence

import uvicorn

from rmr_view.access_guard import AccessGuard
from rmr_view.run_source import RunSource
from rmr_view.web_app import RunRoutes, make_app

LOOPBACK_ADDRESS = "127.0.0.1"
BACKLOG = 128


class PageServerError(Exception):
    """The server cannot start: one sentence."""


def bind(port: int) -> socket.socket:
    """Return a listening socket on loopback; port 0 is a free one. Raises PageServerError."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((LOOPBACK_ADDRESS, port))
        listener.listen(BACKLOG)
    except OSError as error:
        listener.close()
        if error.errno == errno.EADDRINUSE:
            message = f"port {port} is in use by another program: choose another one with --port, or 0 for a free one"
        else:
            message = f"cannot listen on port {port}: {error.strerror}; choose another one with --port"
        raise PageServerError(message) from None
    return listener


class PageServer:
    """A server that runs in a thread until `stop`."""

    def __init__(self, source: RunSource, listener: socket.socket, token: str | None) -> None:
        """`token` is what orders must bear; without one all are refused."""
        self.port: int = listener.getsockname()[1]
        self.token = token
        self._listener = listener
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
        guard = AccessGuard(self.port, token)
        self._routes = RunRoutes(source, guard)
        config = uvicorn.Config(
            make_app(self._routes, source, guard),
            access_log=False,
            log_config=None,
            ws="wsproto",
            ws_per_message_deflate=False,
            ws_max_size=65_536,
            http="h11",
            loop="asyncio",
            lifespan="on",
            server_header=False,
            proxy_headers=False,
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._run, args=([listener],), name="page", daemon=True)

    @property
    def address(self) -> str:
        """The address to open, with the token in its fragment."""
        fragment = "" if self.token is None else f"#token={self.token}"
        return f"http://{LOOPBACK_ADDRESS}:{self.port}/{fragment}"

    @property
    def serves(self) -> bool:
        """Whether the thread runs."""
        return self._thread.is_alive()

    @property
    def idle_s(self) -> float | None:
        """Seconds since the last client of the WebSocket has left, or since the start; None while there is one."""
        left_at = self._routes.broadcast.left_at
        return None if left_at is None else time.monotonic() - left_at

    def start(self) -> None:
        """Start the thread. Connections wait in the socket's queue until the server is ready."""
        self._thread.start()

    def _run(self, listeners: Sequence[socket.socket]) -> None:
        self._server.run(sockets=list(listeners))

    def stop(self) -> None:
        """End the server and its connections."""
        self._server.should_exit = True
        self._thread.join(3.0)  # in which the server ends its connections
        self._listener.close()
