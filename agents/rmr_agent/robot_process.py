"""The robots of one process: they share its session on the bus and its event loop, nothing else.

Normally a process has one robot, so a failure affects no other robot. Several robots in a process are for density:
fifty robots then need a few interpreters, and one subscription for each cell of the floor instead of fifty.
"""

import asyncio
import logging
from collections.abc import Sequence

from rmr.bus.admission import why_no_session
from rmr.bus.process import Ending, Throttle
from rmr.bus.process_recorder import ProcessRecorder
from rmr.bus.secret import Secret
from rmr.bus.session import open_when_there, watch_admission
from rmr_agent.robot import SAY_AGAIN_S, HostedRobot
from rmr_agent.robot_setup import RobotSetup

log = logging.getLogger("rmr")


async def live(
    robots: Sequence[int],
    connect: str,
    lab: str | None,
    setup: RobotSetup,
    ending: Ending,
    secret: Secret | None = None,
    recorder: ProcessRecorder | None = None,
) -> None:
    """Let `robots` live until `ending` is asked for, or each of them has been asked to leave."""
    whose = f"lab {lab}'s" if lab else "the"
    waiting = Throttle(
        lambda: log.info("waiting for %s world at %s%s", whose, connect, why_no_session(connect)),
        SAY_AGAIN_S,
    )
    opening = asyncio.ensure_future(open_when_there(robots[0], connect, waiting, secret))
    if not await ending.unless_asked(opening):
        return
    bus = opening.result()
    buses = [bus, *map(bus.seat, robots[1:])]
    seated = zip(robots, buses, strict=True)
    hosted = [HostedRobot(robot, robots[0], seat, connect, lab, setup, ending, recorder) for robot, seat in seated]
    tasks = [] if recorder is None else [asyncio.ensure_future(recorder.keep_flushed())]
    lives = asyncio.gather(*(robot.run() for robot in hosted))
    asking = asyncio.ensure_future(_pass_on(ending, hosted))
    admission = asyncio.ensure_future(watch_admission(bus, connect, secret, lambda why: log.warning("%s", why)))
    try:
        await lives
    finally:
        for task in (asking, admission, *tasks):
            task.cancel()
        if recorder is not None:
            recorder.end()
    ending.ask(hosted[-1].leaving.reason)


async def _pass_on(ending: Ending, hosted: Sequence[HostedRobot]) -> None:
    """Ask every robot to leave once the process shall end."""
    await ending.wait()
    for robot in hosted:
        robot.leaving.ask(ending.reason, ending.code)
