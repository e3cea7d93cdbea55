"""The routes of the page's server, as a Starlette application over one `RunSource`.

    GET  /  /static/...                          the page: files of the folder `page`
    GET  /api/run  /api/poses  /api/timeline     what there is to see
    GET  /api/trace /frames /log /routes         entries
    GET  /api/robot/ID  /why  /missed  /step     one robot's mind
    WS   /ws                                     what is new, as it comes
    POST /api/control                            orders

A request that is wrong is answered with its status and `{"error": "one sentence"}`. Nothing of another site is loaded:
the header Content-Security-Policy forbids it.
"""

import asyncio
import contextlib
import json
import re
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from math import isfinite
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from rmr.base.mistake import words
from rmr_view.access_guard import TOKEN_HEADER, AccessGuard
from rmr_view.broadcast import Broadcast, PageClient, json_text
from rmr_view.control_order import STEERING, checked_order
from rmr_view.run_source import ENTRIES_MAX, RequestRefusedError, RunSource, WhyOptions

PAGE = Path(__file__).with_name("page")
"""The files of the page."""
BODY_MAX = 65_536
"""Octets of an order at most."""
CLIENTS_MAX = 500
"""WebSockets at once: more are a mistake of some program, and each costs memory."""
DEPTH_MAX = 100
"""Levels of an explanation at most."""
MORE = re.compile(r"[0-9]{1,9}(\.[0-9]{1,9})?")
"""The number of an item of an explanation."""
FACT_MAX = 2_000
"""Characters of a fact in a query at most."""
HEADERS = (
    (
        b"content-security-policy",
        b"default-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-cache"),
)
"""Headers of every answer."""

Handler = Callable[[Request], Awaitable[Response]]


def answer(value: Any, status: int = 200) -> Response:
    """Return `value` as a JSON response."""
    return Response(json_text(value), status, media_type="application/json")


def told(function: Handler) -> Handler:
    """Return a handler that answers a RequestRefusedError with its status and its sentence."""

    async def handler(request: Request) -> Response:
        try:
            return await function(request)
        except RequestRefusedError as error:
            return answer({"error": str(error)}, error.status)
        except Exception as error:  # ours: the client gets a sentence, and the others go on
            return answer({"error": f"the page's server failed at this request: {words(error)}"}, 500)

    return handler


class PageGuard:
    """ASGI middleware: refuses what `AccessGuard` refuses, and adds `HEADERS`."""

    def __init__(self, app: ASGIApp, guard: AccessGuard) -> None:
        self._app = app
        self._guard = guard

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one connection."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refusal = self._guard.refusal(scope["headers"], scope.get("client"))
        if refusal is None:
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "http":
            await answer({"error": refusal}, 403)(scope, receive, _with_headers(send))
        else:
            await send({"type": "websocket.close", "code": 1008, "reason": refusal[:100]})  # before accept: a 403


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", ()), *HEADERS]
        await send(message)

    return sending


class RunRoutes:
    """The routes over one source."""

    def __init__(self, source: RunSource, guard: AccessGuard) -> None:
        self._source = source
        self._guard = guard
        self.broadcast = Broadcast(source)

    def routes(self) -> list[BaseRoute]:
        """Return the table of routes."""
        return [
            Route("/", self._index),
            Route("/api/run", told(self._run)),
            Route("/api/poses", told(self._poses)),
            Route("/api/timeline", told(self._timeline)),
            Route("/api/trace", told(self._entries)),
            Route("/api/frames", told(self._entries)),
            Route("/api/log", told(self._entries)),
            Route("/api/routes", told(self._entries)),
            Route("/api/robot/{robot}", told(self._robot)),
            Route("/api/why", told(self._why)),
            Route("/api/missed", told(self._missed)),
            Route("/api/step", told(self._step)),
            Route("/api/control", told(self._control), methods=["POST"]),
            WebSocketRoute("/ws", self._follow),
            Mount("/static", StaticFiles(directory=PAGE)),
        ]

    async def _index(self, _request: Request) -> Response:
        return FileResponse(PAGE / "index.html")

    async def _run(self, _request: Request) -> Response:
        await self.broadcast.refresh()
        return answer(self._source.about())

    async def _poses(self, request: Request) -> Response:
        begin, end = window(request)
        await self.broadcast.refresh()
        return Response(
            await asyncio.to_thread(lambda: json_text(self._source.history.poses(begin, end))),
            media_type="application/json",
        )

    async def _timeline(self, request: Request) -> Response:
        reject_unknown(request, ())
        await self.broadcast.refresh()
        now = self._source.clock.end_s
        text = await asyncio.to_thread(lambda: json_text(self._source.history.timeline(now)))
        return Response(text, media_type="application/json")

    async def _entries(self, request: Request) -> Response:
        begin, end = window(request)
        kind = request.url.path.rsplit("/", 1)[-1]
        await self.broadcast.refresh()
        entries = await self._source.entries(kind, begin, end)
        return answer({"entries": entries[:ENTRIES_MAX], "more": len(entries) > ENTRIES_MAX})

    async def _robot(self, request: Request) -> Response:
        reject_unknown(request, ("t",))
        robot = self._known_robot(request.path_params["robot"])
        return answer(await self._source.robot(robot, instant_of(request, "t")))

    async def _why(self, request: Request) -> Response:
        reject_unknown(request, ("robot", "fact", "t", "not", "depth", "more"))
        fact = request.query_params.get("fact", "").strip()
        if not fact or len(fact) > FACT_MAX:
            raise RequestRefusedError(f"fact: write a fact, such as at(@4, exit), of {FACT_MAX} characters at most")
        robot = self._known_robot(request.query_params.get("robot", ""))
        return answer(await self._source.why(robot, fact, instant_of(request, "t"), why_options(request)))

    async def _missed(self, request: Request) -> Response:
        reject_unknown(request, ("robot",))
        return answer(await self._source.missed(self._known_robot(request.query_params.get("robot", ""))))

    async def _step(self, request: Request) -> Response:
        reject_unknown(request, ("robot", "at", "do"))
        at, commands = request.query_params.get("at", "-1"), request.query_params.get("do", "")
        if not re.fullmatch("-1|[0-9]{1,9}", at):
            raise RequestRefusedError("at: write the number of a stop, or -1 for before the first one")
        if len(commands) > FACT_MAX * 10:
            raise RequestRefusedError(f"do: write commands of {FACT_MAX * 10} characters at most")
        robot = self._known_robot(request.query_params.get("robot", ""))
        return answer(await self._source.step(robot, int(at), commands))

    def _known_robot(self, text: str) -> int:
        robot = int(text) if text.isascii() and text.isdecimal() and len(text) < 6 else None
        if robot not in self._source.history.robots:
            raise RequestRefusedError(f"there is no robot {text!r:.20} in this run", 404 if robot is not None else 400)
        assert robot is not None
        return robot

    async def _control(self, request: Request) -> Response:
        if refusal := self._guard.order_refusal(request.headers.get(TOKEN_HEADER)):
            raise RequestRefusedError(refusal, 403)
        order = checked_order(await _body(request), self._source.history.robots)
        about = self._source.about()
        if order["do"] in STEERING and not about["steer"]:
            raise RequestRefusedError(f"{order['do']}: only the time of a simulated run can be steered", 409)
        if order["do"] not in STEERING and not about["control"]:
            raise RequestRefusedError(f"{order['do']}: faults need a run that goes on, and a page with --control", 403)
        return answer(await self._source.control(order))

    async def _follow(self, websocket: WebSocket) -> None:
        """Send a client what is new; what it sends itself is ignored."""
        if len(self.broadcast.clients) >= CLIENTS_MAX:
            await websocket.close(1013, "too many clients")
            return
        await websocket.accept()
        client = self.broadcast.join()
        sending = asyncio.create_task(_send_all(websocket, client))
        try:
            while True:
                await websocket.receive()
        except (WebSocketDisconnect, RuntimeError):  # RuntimeError: received after the end
            pass
        finally:
            self.broadcast.leave(client)
            sending.cancel()
            with contextlib.suppress(asyncio.CancelledError, Exception):
                await sending


async def _send_all(websocket: WebSocket, client: PageClient) -> None:
    """Send what waits for `client`; waits itself while the client does not read."""
    while True:
        for text in await client.next_messages():
            await websocket.send_text(text)


async def _body(request: Request) -> Any:
    octets = b""
    async for chunk in request.stream():
        octets += chunk
        if len(octets) > BODY_MAX:
            raise RequestRefusedError(f"an order is {BODY_MAX} octets at most", 413)
    try:
        return json.loads(octets)
    except (ValueError, RecursionError):
        raise RequestRefusedError("the order is no JSON") from None


def reject_unknown(request: Request, known: tuple[str, ...]) -> None:
    """Raise RequestRefusedError for a query with another name than `known`, or one that comes twice."""
    names = [name for name, _ in request.query_params.multi_items()]
    for name in names:
        if name not in known:
            allowed = f"known are {', '.join(known)}" if known else "this route has none"
            raise RequestRefusedError(f"unknown parameter {name!r:.40}; {allowed}")
        if names.count(name) > 1:
            raise RequestRefusedError(f"{name}: write it once")


def instant_of(request: Request, name: str) -> float | None:
    """Return the instant of a query in seconds; None without one. Raises RequestRefusedError."""
    text = request.query_params.get(name)
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not (isfinite(value) and value >= 0.0):
        raise RequestRefusedError(f"{name}: write seconds of lab time from 0 on, such as 12.5, not {text!r:.40}")
    return value


def why_options(request: Request) -> WhyOptions:
    """Return how a fact is to be explained. Raises RequestRefusedError."""
    query = request.query_params
    absent = query.get("not", "0")
    depth = query.get("depth", "3")
    more = query.get("more")
    if absent not in {"0", "1"}:
        raise RequestRefusedError("not: write 1, or leave it out")
    if not (depth.isascii() and depth.isdecimal() and len(depth) < 4 and int(depth) <= DEPTH_MAX):
        raise RequestRefusedError(f"depth: write a whole number from 0 to {DEPTH_MAX}")
    if more is not None and not MORE.fullmatch(more):
        raise RequestRefusedError("more: write the number at which an answer was cut, such as 17 or 3.17")
    return WhyOptions(absent == "1", int(depth), more)


def window(request: Request) -> tuple[float, float]:
    """Return begin and end of a query in seconds. Raises RequestRefusedError."""
    reject_unknown(request, ("begin", "end"))
    begin = instant_of(request, "begin")
    end = instant_of(request, "end")
    if begin is not None and end is not None and begin > end:
        raise RequestRefusedError("begin comes after end: write the earlier instant as begin")
    return begin or 0.0, 1e12 if end is None else end


def make_app(routes: RunRoutes, source: RunSource, guard: AccessGuard) -> ASGIApp:
    """Return the application."""

    @contextlib.asynccontextmanager
    async def lifespan(_app: Starlette) -> AsyncIterator[Mapping[str, Any]]:
        await source.start()
        passing = asyncio.create_task(routes.broadcast.run())
        try:
            yield {}
        finally:
            passing.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await passing
            await source.close()

    return PageGuard(Starlette(routes=routes.routes(), lifespan=lifespan), guard)
