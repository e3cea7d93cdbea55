"""A lab whose one robot has handlers that fail in every way."""

FAILING = """
import asyncio
from rmr import ActionFailed, action

@action("at_once")
async def at_once(robot):
    raise ActionFailed("at once")

@action("midway")
async def midway(robot):
    await robot.sleep(0.1)
    return 1 / 0

@action("condition")
async def condition(robot):
    await robot.until(lambda: robot.now() > 0.2 and robot.unheard_of)

@action("stopped", wheels=True)
async def stopped(robot):
    try:
        await robot.moveto("far")
    finally:
        robot.say("stopped")

@action("stopped_badly", wheels=True)
async def stopped_badly(robot):
    try:
        await robot.sleep(60.0)
    finally:
        raise KeyError("on the way out")

@action("goes_on", wheels=True)
async def goes_on(robot):
    try:
        await robot.face(170.0)
    except GeneratorExit:
        await robot.sleep(1.0)

@action("stop_goes_on")
async def stop_goes_on(robot):
    raise GeneratorExit

@action("leaves")
async def leaves(robot):
    raise SystemExit(3)

@action("loop")
async def loop(robot):
    await asyncio.sleep(1.0)

@action("sets")
async def sets(robot):
    robot.level = 3

@action("keeps")
async def keeps(robot):
    robot.state["level"] = 3

@action("catches", wheels=True)
async def catches(robot):
    try:
        await robot.reach(0.3, 1.3, 0.0, 0.1)
    except ActionFailed as failure:
        robot.say(str(failure))
    await robot.goto(0.6, 0.6)

@action("forgets")
async def forgets(robot):
    await robot.goto(0.5, 0.5)

@action("no_coroutine")
def no_coroutine(robot):
    pass

@action("too_few")
async def too_few():
    pass
"""
"""Handlers that fail in every way: at the first resume, midway, on the way out, in what they await."""
NAMES = [line.split('"')[1] for line in FAILING.splitlines() if line.startswith("@action")]
LATER = ("stopped_badly", "goes_on", "catches")
PROGRAM = """
type action stop(R: robot).
type action wait(R: robot, T: float) -o waited(R, T).
type action lineup(R: robot, A: area, K: int).
start(R).
start(R) -o AT_ONCE, wait(R, 1.0).
waited(R, 1.0) -o stop(R), stopped_badly(R), wait(R, 1.5).
waited(R, 1.5) -o stop(R), goes_on(R), wait(R, 0.5).
waited(R, 0.5) -o stop(R), lineup(R, queue, 3), wait(R, 2.5).
waited(R, 2.5) -o lineup(R, queue, 2), catches(R), wait(R, 20.0).
waited(R, 20.0) -o over(R).
"""
FAILING_LAB = """
lab: failing
program: failing.rmr
duration: 30s
finish: over(R)
arena: {size: [1.5, 1.5], cell: 0.05}
areas:
  far: {at: [1.3, 1.3]}
  queue: {at: [1.3, 0.2], queue: {path: [[1.2, 0.2], [0.2, 0.2]], spacing: 0.2}}
robots: [{id: 1, pose: [0.3, 0.7, 0deg]}]
"""


def failing_lab(folder):
    """Return a lab whose one robot has each of its actions fail, some by `stop` and some by a later one."""
    declared = [f"type action {name}(R: robot) -o ended(R) else ended(R)." for name in NAMES]
    at_once = ", ".join(f"{name}(R)" for name in NAMES if name not in LATER)
    (folder / "failing.rmr").write_text("\n".join([*declared, PROGRAM.replace("AT_ONCE", at_once)]))
    (folder / "lab.yaml").write_text(FAILING_LAB)
    (folder / "failing.py").write_text(FAILING)
    return str(folder), 1, False, str(folder / "failing.py")
