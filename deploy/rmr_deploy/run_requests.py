"""Requests to the launcher of a run, as files in its run folder: how the robots are, and orders about their processes.

The launcher alone may signal its processes and start them again. The run folder is closed to other users, so whoever
can write there may ask. A request is a file of JSON that appears by a rename; the launcher takes it by another one, so
that it is carried out once whatever fails, and writes the answer beside it, which the asker removes:

    requests/0f3a.ask       {"do": "stall", "robot": 3, "for_s": 2.0}
    requests/0f3a.taken     the same, while it is carried out
    requests/0f3a.answer    {"refused": ""}
    requests/0f3a.done-28   the same as .taken: it was carried out, and error 28 kept the answer from being written

An answer may have `told`, an object with what was asked for. A name needs no room on a full disk. Importing this
module does not load asyncio, which takes longer than an answer.
"""

import json
import os
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from rmr.base.file_errors import disk_of, naming
from rmr.bus.keys import WORLD

if TYPE_CHECKING:
    from asyncio import Future

REQUESTS_FOLDER = "requests"
ASK = ".ask"
TAKEN = ".taken"
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


ROUTER: Final = "router"
"""The name of the router of a lab over several hosts, in place of a robot's id."""

Service = Literal["world", "router"]
"""A process without which no run goes on."""

Who = int | Service
"""Whom an order is about."""


def called(who: object) -> str:
    """Return ``robot 3``, ``the world`` or ``the router``."""
    return f"the {who}" if isinstance(who, str) else f"robot {who}"


def service_named(name: object) -> Service | None:
    """Return the service that a request calls `name`, or a person."""
    return "world" if name == WORLD else "router" if name == ROUTER else None


def base_name(process: str) -> str:
    """Return ``robot-3`` of ``c/robot-3.1``: the name without the host, and the number of a later process."""
    return process.rpartition("/")[2].partition(".")[0]


class RequestError(Exception):
    """A request was refused, or nobody answered: one sentence."""


class UnansweredError(RequestError):
    """The launcher does not answer: it is starting, ending or overloaded, or it is dead."""


class UnwrittenError(RequestError):
    """The launcher has taken the request, and could not write its answer: the file and the disk are named."""

    def __init__(self, became: str, answer: Path, code: int) -> None:
        """`became` is a key of `UNWRITTEN`; `answer` could not be written for the error `code`."""
        super().__init__(f"{UNWRITTEN[became]}: {answer}: {os.strerror(code)}, on the disk at {disk_of(answer)}")
        self.done = became == "done"
        """Whether the request was carried out."""


UNWRITTEN = {
    "done": "the order was carried out, though the launcher could not write its answer",
    "refused": "the order was refused, and the launcher could not write why",
    "told": "the launcher could not write its answer",
}
"""What became of a request whose answer could not be written."""

Answer = str | Mapping[str, Any]
"""Why a request is refused (empty: it was carried out), or what was asked for."""


async def put_request(folder: Path, request: Mapping[str, Any]) -> None:
    """Give the launcher of the run in `folder` the order `request`, and wait for its answer. Raises RequestError."""
    import asyncio  # noqa: PLC0415 - see above

    stem = _put(folder, request)
    end = time.monotonic() + PATIENCE_S
    while (answer := _answer(stem)) is None:
        _check_patience(stem, end)
        await asyncio.sleep(POLL_S)
    try:
        told_by(answer)
    except UnwrittenError as error:
        if not error.done:
            raise


def ask_launcher(folder: Path, request: Mapping[str, Any], patience_s: float | None = None) -> dict[str, Any]:
    """Ask as `put_request` does, outside of an event loop; return what the launcher tells. Raises RequestError."""
    stem = _put(folder, request)
    end = time.monotonic() + (PATIENCE_S if patience_s is None else patience_s)
    while (answer := _answer(stem)) is None:
        _check_patience(stem, end)
        time.sleep(POLL_S)
    return told_by(answer)


def _put(folder: Path, request: Mapping[str, Any]) -> Path:
    stem = folder / REQUESTS_FOLDER / os.urandom(8).hex()
    try:
        stem.parent.mkdir(exist_ok=True)
        draft = stem.with_suffix(".new")
        with naming(draft):
            draft.write_text(json.dumps(dict(request)))
        draft.rename(stem.with_suffix(ASK))
    except OSError as error:
        with suppress(OSError):
            stem.with_suffix(".new").unlink(missing_ok=True)
        where = f"{error.filename}: {error.strerror}, on the disk at {disk_of(stem.parent)}"
        raise RequestError(f"the launcher cannot be asked: {where}") from None
    return stem


def _check_patience(stem: Path, end: float) -> None:
    if time.monotonic() > end:
        try:
            stem.with_suffix(ASK).unlink()
        except FileNotFoundError:
            taken = "the launcher of this run has taken the request and does not answer; rmr ps shows what came of it"
            raise UnansweredError(taken) from None
        except OSError:
            pass
        raise UnansweredError("the launcher of this run does not answer")


def told_by(answer: Mapping[str, Any] | UnwrittenError) -> dict[str, Any]:
    """Return what a launcher tells in its `answer`. Raises RequestError."""
    if isinstance(answer, UnwrittenError):
        raise answer
    if refused := answer.get("refused"):
        raise RequestError(str(refused))
    told = answer.get("told")
    return told if isinstance(told, dict) else {}


def read_answer(octets: bytes) -> dict[str, Any] | None:
    """Return the answer in `octets`; None where that is no JSON, as of a file that is still written."""
    try:
        answer = json.loads(octets)
    except (ValueError, RecursionError):
        return None
    return answer if isinstance(answer, dict) else {}


def _answer(stem: Path) -> dict[str, Any] | UnwrittenError | None:
    path = stem.with_suffix(ANSWER)
    try:
        answer = read_answer(path.read_bytes())
    except OSError:
        answer = None
    if answer is None:
        return _unwritten(path)
    path.unlink(missing_ok=True)
    return answer


def serve_requests(folder: Path, perform: "Callable[[Mapping[str, Any]], Answer | Future[str]]") -> None:
    """Answer the requests that wait in `folder`; `perform` carries one out, or has it carried out elsewhere."""
    with suppress(OSError):
        for path in sorted((folder / REQUESTS_FOLDER).glob(f"*{ASK}")):
            _serve(path, perform)


def _serve(path: Path, perform: "Callable[[Mapping[str, Any]], Answer | Future[str]]") -> None:
    taken = path.rename(path.with_suffix(TAKEN))
    answer = _performed(taken, perform)
    if isinstance(answer, str | Mapping):
        _write_answer(taken, answer)
    else:
        answer.add_done_callback(lambda told: _write_late(taken, told))


def _write_late(taken: Path, told: "Future[str]") -> None:
    """Write an answer that came from elsewhere; the run may be over, and its requests removed."""
    if not told.cancelled() and taken.exists():
        with suppress(OSError):
            _write_answer(taken, told.result())


def _write_answer(taken: Path, answer: Answer) -> None:
    path = taken.with_suffix(ASK)
    draft = path.with_suffix(".out")
    try:
        draft.write_text(json.dumps({"refused": answer} if isinstance(answer, str) else {"told": answer}))
        draft.rename(path.with_suffix(ANSWER))
    except OSError as error:
        became = "told" if not isinstance(answer, str) else "refused" if answer else "done"
        draft.unlink(missing_ok=True)
        taken.rename(path.with_suffix(f".{became}-{error.errno}"))
    else:
        taken.unlink()


def _unwritten(answer: Path) -> UnwrittenError | None:
    """Return what the launcher says by the name of a file, where it could not write its `answer`."""
    for path in answer.parent.glob(f"{answer.stem}.*-*"):
        became, _, code = path.suffix[1:].partition("-")
        path.unlink(missing_ok=True)
        if became in UNWRITTEN and code.isdecimal():
            return UnwrittenError(became, answer, int(code))
    return None


def end_requests(folder: Path) -> None:
    """Remove the folder of requests, with those that came too late."""
    requests = folder / REQUESTS_FOLDER
    with suppress(OSError):
        for path in requests.glob("*"):
            path.unlink(missing_ok=True)
        requests.rmdir()


def _performed(path: Path, perform: "Callable[[Mapping[str, Any]], Answer | Future[str]]") -> "Answer | Future[str]":
    with path.open("rb") as file:
        octets = file.read(OCTETS_MAX)
    try:
        request = json.loads(octets)
    except (ValueError, RecursionError):
        return "the request is no JSON"
    return perform(request) if isinstance(request, dict) else "the request is no JSON object"
