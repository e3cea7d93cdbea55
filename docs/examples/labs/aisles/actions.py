"""The one action that aisles.rmr has of its own."""

from rmr import action

LOADING_S = 1.5


@action("load", wheels=True)
async def load(robot, aisle):
    """Take a parcel from the shelf; the robot stands meanwhile."""
    robot.stop()
    await robot.sleep(LOADING_S)
    robot.say(f"loaded in {aisle}")
