"""A server of the page's routes for a captured run, on a thread of its own.

With `live` the run plays at the speed of the wall clock from `begin_s` on, over the WebSocket.
"""

import asyncio
import socket
import threading
import time
from pathlib import Path
from typing import Any

import uvicorn
from captured_run import CapturedRun
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

import rmr_view

PAGE = Path(rmr_view.__file__).parent / "page"
HEADERS = {"Content-Security-Policy": "default-src 'self'", "Cache-Control": "no-store"}


class FixtureServer:
    """Serves one run; `posted` collects what came to /api/control."""

    def __init__(self, run: CapturedRun, *, live: bool = False, begin_s: float = 0.0, port: int = 0, **about: Any):
        self.run, self.live, self.begin_s, self.about = run, live, begin_s, about
        self.posted: list[dict[str, Any]] = []
        self.began = time.monotonic()
        self.paused_at: float | None = None
        self.app = Starlette(
            routes=[
                Route("/", lambda _: FileResponse(PAGE / "index.html", headers=HEADERS)),
                Mount("/static", StaticFiles(directory=PAGE)),
                Route("/api/control", self._control, methods=["POST"]),
                Route("/api/robot/{robot:int}", self._robot),
                Route("/api/{name}", self._api),
                WebSocketRoute("/ws", self._ws),
            ]
        )
        self.socket = socket.socket()
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(("127.0.0.1", port))
        self.port = self.socket.getsockname()[1]
        config = uvicorn.Config(self.app, log_level="error", ws="websockets-sansio", lifespan="off")
        self.server = uvicorn.Server(config)
        self.thread = threading.Thread(target=self.server.run, args=([self.socket],), daemon=True)
        self.thread.start()

    @property
    def address(self) -> str:
        """The page's address."""
        return f"http://127.0.0.1:{self.port}/"

    def stop(self) -> None:
        """End the server and its connections."""
        self.server.should_exit = self.server.force_exit = True
        self.thread.join(5)
        self.socket.close()

    def now(self) -> float:
        """Return the lab time of a live run."""
        if not self.live:
            return self.run.end_s
        return min(self.run.end_s, self.begin_s + time.monotonic() - self.began)

    async def _control(self, request: Request) -> Response:
        if request.headers.get("x-rmr-token") != "secret":
            return JSONResponse({"error": "the token of this request is wrong"}, 403)
        self.posted.append(await request.json())
        return JSONResponse({})

    async def _robot(self, request: Request) -> Response:
        robot = request.path_params["robot"]
        return JSONResponse(self.run.robot(robot, float(request.query_params.get("t", self.now()))))

    async def _api(self, request: Request) -> Response:
        run, now, name = self.run, self.now(), request.path_params["name"]
        begin = float(request.query_params.get("begin", 0))
        end = min(now, float(request.query_params.get("end", 1e9)))
        if name == "run":
            return JSONResponse(run.run(end_s=now, live=self.live, **self.about))
        if name == "poses":
            keep = [i for i, t in enumerate(run.t) if begin <= t <= end]
            cut = slice(keep[0], keep[-1] + 1) if keep else slice(0, 0)
            robots = {r: {k: v[cut] for k, v in p.items()} for r, p in run.poses.items()}
            estimates = {r: {k: v[cut] for k, v in p.items()} for r, p in run.estimates.items()}
            return JSONResponse({"t": run.t[cut], "robots": robots, "estimates": estimates})
        if name == "timeline":
            return JSONResponse(run.timeline())
        entries = {"frames": run.frames, "trace": run.trace, "routes": run.routes, "log": []}.get(name)
        if entries is None:
            return JSONResponse({"error": f"there is nothing called {name}"}, 404)
        found = [e for e in entries if begin <= e.get("t", e.get("start_s", 0)) <= end]
        return JSONResponse({"entries": found[:5000], "more": len(found) > 5000})

    async def _ws(self, socket: WebSocket) -> None:
        await socket.accept()
        try:
            await self._play(socket)
        except (WebSocketDisconnect, RuntimeError):
            return

    async def _play(self, socket: WebSocket) -> None:
        run = self.run
        clock = {"type": "clock", "t": self.now(), "end_s": self.now(), "running": self.live, "speed": 1.0}
        await socket.send_json(clock)
        last = self.now()
        while self.live and last < run.end_s:
            await asyncio.sleep(0.1)
            now = self.now()
            for i, t in enumerate(run.t):
                if last < t <= now:
                    robots = {r: [p["x"][i], p["y"][i], p["heading"][i]] for r, p in run.poses.items()}
                    await socket.send_json({"type": "poses", "t": t, "robots": robots, "estimates": robots})
            for kind, entries in (("trace", run.trace), ("frames", run.frames), ("routes", run.routes)):
                found = [e for e in entries if last < e.get("t", e.get("start_s", 0)) <= now]
                if found:
                    await socket.send_json({"type": kind, "entries": found})
            await socket.send_json(clock | {"t": now, "end_s": now})
            last = now
        if self.live:
            await socket.send_json({"type": "end", "report": run.report})
        while True:
            await socket.receive_text()
