"""Replays and explanations in a process of their own, so that the server's loop never waits for them.

The process is started at the first request, with lower priority, and keeps the replays of the run that it is asked
about.
"""

import asyncio
import os
import signal
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from rmr.entry.workers import end_with_parent
from rmr_view.run_source import RequestRefusedError, WhyOptions

PATIENCE_S = 120.0
"""Limit for one answer: replay takes about a hundredth of the run's time per robot."""


class MindWorker:
    """The process that answers about one run."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._pool: ProcessPoolExecutor | None = None

    async def state(self, robot: int, t: float | None) -> dict[str, Any]:
        """Return what `robot` knew and did at `t`. Raises RequestRefusedError."""
        return await self._run(_state, robot, t)

    async def why(self, robot: int, fact: str, t: float | None, options: WhyOptions) -> dict[str, Any]:
        """Return the explanation of a fact of `robot` as of `t`. Raises RequestRefusedError."""
        return await self._run(_why, robot, fact, t, options)

    async def missed(self, robot: int) -> dict[str, Any]:
        """Return what the time of each deadline that `robot` missed went into. Raises RequestRefusedError."""
        return await self._run(_missed, robot)

    async def step(self, robot: int, at: int, commands: str) -> dict[str, Any]:
        """Carry out commands of `rmr replay --step`, one a line, from stop `at`. Raises RequestRefusedError."""
        return await self._run(_step, robot, at, commands)

    async def _run(self, function: Callable[..., Any], *arguments: Any) -> dict[str, Any]:
        if self._pool is None:
            self._pool = ProcessPoolExecutor(1, get_context("spawn"), _begin)
        loop = asyncio.get_running_loop()
        try:
            answer = loop.run_in_executor(self._pool, function, self._path, *arguments)
            found = await asyncio.wait_for(answer, PATIENCE_S)
        except BrokenProcessPool:
            self.close()
            raise RequestRefusedError("the process that replays robots has died: ask again", 503) from None
        except TimeoutError:
            raise RequestRefusedError(f"the replay takes more than {PATIENCE_S:g} s: ask again", 503) from None
        if "refused" in found:
            raise RequestRefusedError(found["refused"], found["status"])
        return dict(found)

    def close(self) -> None:
        """End the process."""
        if self._pool is not None:
            processes = list(getattr(self._pool, "_processes", {}).values())  # a replay under way is not waited for
            self._pool.shutdown(wait=False, cancel_futures=True)
            for process in processes:
                process.terminate()
            self._pool = None


# --- in the worker's process


def _begin() -> None:
    """Leave Ctrl-C to the server, and end with it."""
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(5)  # lower priority than the run and the server


_followed: dict[Path, Any] = {}
"""What is replayed of the run, by its path."""


def _state(path: Path, robot: int, t: float | None) -> dict[str, Any]:
    from rmr.mind.mind_reader import MindLogError  # noqa: PLC0415 - the server does not need them
    from rmr.record.mcap_scan import RecordingError  # noqa: PLC0415
    from rmr_view.followed_minds import FollowedMinds  # noqa: PLC0415

    try:
        if path not in _followed:
            _followed[path] = FollowedMinds(path)
        state: dict[str, Any] = _followed[path].state(robot, t)
    except (RecordingError, MindLogError) as error:
        return {"refused": str(error), "status": 501}
    return state


_pasts: dict[Path, Any] = {}
"""The explained minds of the runs that are over, by path."""


def _why(path: Path, robot: int, question_text: str, t: float | None, options: WhyOptions) -> dict[str, Any]:
    from rmr.base.time import seconds  # noqa: PLC0415 - the server does not need them
    from rmr.record.mcap_scan import RecordingError  # noqa: PLC0415
    from rmr.why.absence import why_not  # noqa: PLC0415
    from rmr.why.question import WhyError, question  # noqa: PLC0415
    from rmr.why.replayed_histories import UnexplainableError  # noqa: PLC0415
    from rmr.why.rule_words import seconds_text  # noqa: PLC0415
    from rmr.why.why_answer import why  # noqa: PLC0415

    try:
        recording, histories, past = _pasts.get(path) or _opened(path)
        asked = question(question_text, past.program, list(past.robots), robot)
        if not past.minds(robot):
            raise UnexplainableError("; ".join(histories.problems) or f"what robot {robot} did was not recorded")
        if not recording.complete:
            histories.end_with(robot)
        at = None if t is None else seconds(t)
        answer = (
            why_not(past, asked, at, options.depth)
            if options.absent
            else why(past, asked, at, options.depth, options.more)
        )
    except WhyError as error:
        return {"refused": str(error), "status": 400}
    except (RecordingError, UnexplainableError) as error:
        return {"refused": str(error), "status": 501}
    if not recording.complete:
        until = seconds_text(past.known_until)
        answer.notes.append(f"the recording has not been finished: robot {robot} is known until {until}")
    told: dict[str, Any] = answer.as_data() | {"lab": recording.about.lab, "problems": list(histories.problems)}
    return told


def _missed(path: Path, robot: int) -> dict[str, Any]:
    from rmr.record.mcap_scan import RecordingError  # noqa: PLC0415 - the server does not need them
    from rmr.why.delay_text import delay_data  # noqa: PLC0415
    from rmr.why.missed_jobs import missed_delays  # noqa: PLC0415
    from rmr.why.replayed_histories import UnexplainableError  # noqa: PLC0415

    try:
        _, histories, _ = _pasts.get(path) or _opened(path)
        run = histories.whole_run()
    except (RecordingError, UnexplainableError) as error:
        return {"refused": str(error), "status": 501}
    delays = [delay_data(delay) for delay in missed_delays(run) if delay.robot == robot]
    return {"delays": delays, "problems": list(run.problems)}


_stepped: dict[tuple[Path, int], tuple[int, Any]] = {}
"""How far each robot was known when its stops were made, and the stops, by path and robot."""


def _step(path: Path, robot: int, at: int, commands: str) -> dict[str, Any]:
    from rmr.mind.mind_reader import MindLogError  # noqa: PLC0415 - the server does not need them
    from rmr.mind.recorded_minds import minds, program_of  # noqa: PLC0415
    from rmr.record.mcap_scan import RecordingError  # noqa: PLC0415
    from rmr.why.replayed_histories import UnexplainableError  # noqa: PLC0415
    from rmr.why.step_session import NowhereError, StepError, StepSession  # noqa: PLC0415
    from rmr.why.stops import Stops  # noqa: PLC0415

    try:
        recording, histories, _ = _pasts.get(path) or _opened(path)
        until, stops = _stepped.get((path, robot), (-1, None))
        if until != recording.span[1]:
            stops = Stops(robot)
            for mind in minds(recording):
                if mind.robot == robot:
                    for _ in stops.replay(mind, program_of(recording)):
                        pass
            _stepped[path, robot] = recording.span[1], stops
    except (RecordingError, MindLogError, UnexplainableError) as error:
        return {"refused": str(error), "status": 501}
    problems = [*stops.problems, *histories.problems]
    if not stops.all:
        return {"refused": "; ".join(problems) or f"what robot {robot} did was not recorded", "status": 501}
    session = StepSession(stops, histories)
    session.at = min(at, len(stops.all) - 1)
    nowhere = None
    try:
        for line in commands.splitlines():
            list(session.perform(line))
    except NowhereError as error:
        nowhere = str(error)
    except StepError as error:
        return {"refused": str(error), "status": 400}
    return session.as_data() | {"nowhere": nowhere, "problems": problems}


def _opened(path: Path) -> tuple[Any, Any, Any]:
    """Return the recording at `path` with its histories; they are kept once it is complete."""
    from rmr.why.past import Past  # noqa: PLC0415
    from rmr.why.replayed_histories import ReplayedHistories  # noqa: PLC0415
    from rmr_view.followed_minds import opened  # noqa: PLC0415

    recording = opened(path)
    histories = ReplayedHistories(recording)
    found = recording, histories, Past(histories, histories.variables)
    if recording.complete:
        _pasts[path] = found
    return found
