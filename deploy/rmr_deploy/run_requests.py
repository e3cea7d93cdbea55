"""Requests to the launcher of a run, as files in its run folder: kill, restart or stall the process of a robot.

The launcher alone may signal its processes and start them again. The run folder is closed to other users, so whoever
can write there may ask. A request is a file of JSON that appears by a rename; the launcher removes it, and writes the
answer beside it, which the asker removes:

    requests/0f3a.ask       {"do": "stall", "robot": 3, "for_s": 2.0}
    requests/0f3a.answer    {"refused": ""}
"""

import asyncio
import json
import secrets
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

REQUESTS_FOLDER = "requests"
ASK = ".ask"
ANSWER = ".answer"
POLL_S = 0.02
"""Period with which an asker looks for the answer."""
PATIENCE_S = 5.0
"""Limit for the answer: the launcher looks twenty times a second."""
OCTETS_MAX = 4096


class RequestError(Exception):
    """A request was refused, or nobody answered: one sentence."""


async def put_request(folder: Path, request: Mapping[str, Any]) -> None:
    """Ask the launcher of the run in `folder` for `request`, and wait for its answer. Raises RequestError."""
    stem = folder / REQUESTS_FOLDER / secrets.token_hex(8)
    try:
        stem.parent.mkdir(exist_ok=True)
        draft = stem.with_suffix(".new")
        draft.write_text(json.dumps(dict(request)))
        draft.rename(stem.with_suffix(ASK))
    except OSError as error:
        raise RequestError(f"{error.filename}: {error.strerror}") from None
    end = time.monotonic() + PATIENCE_S
    while (refused := _answer(stem)) is None:
        if time.monotonic() > end:
            stem.with_suffix(ASK).unlink(missing_ok=True)
            raise RequestError("the launcher of this run does not answer")
        await asyncio.sleep(POLL_S)
    if refused:
        raise RequestError(refused)


def _answer(stem: Path) -> str | None:
    path = stem.with_suffix(ANSWER)
    try:
        told = json.loads(path.read_text())
    except (OSError, ValueError):
        return None
    path.unlink(missing_ok=True)
    return str(told.get("refused", "")) if isinstance(told, dict) else ""


def serve_requests(folder: Path, perform: Callable[[Mapping[str, Any]], str]) -> None:
    """Answer the requests that wait in `folder`: `perform` carries one out and returns why it refuses, or nothing."""
    with suppress(OSError):
        for path in sorted((folder / REQUESTS_FOLDER).glob(f"*{ASK}")):
            refused = _performed(path, perform)
            path.unlink(missing_ok=True)
            draft = path.with_suffix(".out")
            draft.write_text(json.dumps({"refused": refused}))
            draft.rename(path.with_suffix(ANSWER))


def end_requests(folder: Path) -> None:
    """Remove the folder of requests, with those that came too late."""
    requests = folder / REQUESTS_FOLDER
    with suppress(OSError):
        for path in requests.glob("*"):
            path.unlink(missing_ok=True)
        requests.rmdir()


def _performed(path: Path, perform: Callable[[Mapping[str, Any]], str]) -> str:
    with path.open("rb") as file:
        octets = file.read(OCTETS_MAX)
    try:
        request = json.loads(octets)
    except (ValueError, RecursionError):
        return "the request is no JSON"
    return perform(request) if isinstance(request, dict) else "the request is no JSON object"
