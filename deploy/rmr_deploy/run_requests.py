"""Requests to the launcher of a run, as files in its run folder: how the robots are, and orders about their processes.

The launcher alone may signal its processes and start them again. The run folder is closed to other users, so whoever
can write there may ask. A request is a file of JSON that appears by a rename; the launcher removes it, and writes the
answer beside it, which the asker removes:

    requests/0f3a.ask       {"do": "stall", "robot": 3, "for_s": 2.0}
    requests/0f3a.answer    {"refused": ""}

An answer may have `told`, an object with what was asked for. Importing this module does not load asyncio, which takes
longer than an answer.
"""

import json
import os
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from rmr.base.file_errors import naming

REQUESTS_FOLDER = "requests"
ASK = ".ask"
ANSWER = ".answer"
POLL_S = 0.02
"""Period with which an asker looks for the answer."""
PATIENCE_S = 5.0
"""Limit for the answer: the launcher looks twenty times a second."""
OCTETS_MAX = 4096
FAULT_S_MAX = 86_400.0
"""Length of a fault at most; one that is not told lasts to the end of the run, which comes sooner."""
REQUEST_FIELDS = ("do", "robot", "signal", "for_s", "every_s")
"""What a request may have."""


class RequestError(Exception):
    """A request was refused, or nobody answered: one sentence."""


class UnansweredError(RequestError):
    """The launcher does not answer: it is starting, ending or overloaded, or it is dead."""


Answer = str | Mapping[str, Any]
"""Why a request is refused (empty: it was carried out), or what was asked for."""


async def put_request(folder: Path, request: Mapping[str, Any]) -> None:
    """Ask the launcher of the run in `folder` for `request`, and wait for its answer. Raises RequestError."""
    import asyncio  # noqa: PLC0415 - see above

    stem = _put(folder, request)
    end = time.monotonic() + PATIENCE_S
    while (answer := _answer(stem)) is None:
        _check_patience(stem, end)
        await asyncio.sleep(POLL_S)
    _told(answer)


def ask_launcher(folder: Path, request: Mapping[str, Any], patience_s: float | None = None) -> dict[str, Any]:
    """Ask as `put_request` does, outside of an event loop; return what the launcher tells. Raises RequestError."""
    stem = _put(folder, request)
    end = time.monotonic() + (PATIENCE_S if patience_s is None else patience_s)
    while (answer := _answer(stem)) is None:
        _check_patience(stem, end)
        time.sleep(POLL_S)
    return _told(answer)


def _put(folder: Path, request: Mapping[str, Any]) -> Path:
    stem = folder / REQUESTS_FOLDER / os.urandom(8).hex()
    try:
        stem.parent.mkdir(exist_ok=True)
        draft = stem.with_suffix(".new")
        with naming(draft):
            draft.write_text(json.dumps(dict(request)))
        draft.rename(stem.with_suffix(ASK))
    except OSError as error:
        raise RequestError(f"{error.filename}: {error.strerror}") from None
    return stem


def _check_patience(stem: Path, end: float) -> None:
    if time.monotonic() > end:
        with suppress(OSError):
            stem.with_suffix(ASK).unlink(missing_ok=True)
        raise UnansweredError("the launcher of this run does not answer")


def _told(answer: Mapping[str, Any]) -> dict[str, Any]:
    if refused := answer.get("refused"):
        raise RequestError(str(refused))
    told = answer.get("told")
    return told if isinstance(told, dict) else {}


def _answer(stem: Path) -> dict[str, Any] | None:
    path = stem.with_suffix(ANSWER)
    try:
        answer = json.loads(path.read_text())
    except (OSError, ValueError):
        return None
    path.unlink(missing_ok=True)
    return answer if isinstance(answer, dict) else {}


def serve_requests(folder: Path, perform: Callable[[Mapping[str, Any]], Answer]) -> None:
    """Answer the requests that wait in `folder`; `perform` carries one out."""
    with suppress(OSError):
        for path in sorted((folder / REQUESTS_FOLDER).glob(f"*{ASK}")):
            answer = _performed(path, perform)
            path.unlink(missing_ok=True)
            draft = path.with_suffix(".out")
            draft.write_text(json.dumps({"refused": answer} if isinstance(answer, str) else {"told": answer}))
            draft.rename(path.with_suffix(ANSWER))


def end_requests(folder: Path) -> None:
    """Remove the folder of requests, with those that came too late."""
    requests = folder / REQUESTS_FOLDER
    with suppress(OSError):
        for path in requests.glob("*"):
            path.unlink(missing_ok=True)
        requests.rmdir()


def _performed(path: Path, perform: Callable[[Mapping[str, Any]], Answer]) -> Answer:
    with path.open("rb") as file:
        octets = file.read(OCTETS_MAX)
    try:
        request = json.loads(octets)
    except (ValueError, RecursionError):
        return "the request is no JSON"
    return perform(request) if isinstance(request, dict) else "the request is no JSON object"
