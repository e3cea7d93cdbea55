"""The one action that charging.rmr has of its own."""

from rmr import action

CHARGING_S = 4.0


@action("charge", wheels=True)
async def charge(robot, place):
    """Stand at the charging place until the battery is full."""
    robot.stop()
    await robot.sleep(CHARGING_S)
    robot.say(f"full at {place}")
