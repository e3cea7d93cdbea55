"""`rmr up` whose world and robots are the stand-ins of `standin.py`."""

import os
import sys
from pathlib import Path

import rmr_deploy.launch as launching
from rmr_deploy.up import main

STANDIN = Path(__file__).with_name("standin.py")


def world_command(plan, endpoint):
    """Return the command of a stand-in for the world."""
    return [sys.executable, str(STANDIN), "world", "--listen", endpoint, "--secret", str(plan.secret)]


def agent_command(plan, robots, endpoint):
    """Return the command of a stand-in for a robot."""
    options = ["--id", str(robots[0]), "--connect", endpoint, "--lab", plan.lab.name, "--secret", str(plan.secret)]
    return [sys.executable, str(STANDIN), "robot", *options]


if __name__ == "__main__":
    os.environ.setdefault("STANDIN_LAB", "standin")
    launching.world_command = world_command
    launching.agent_command = agent_command
    sys.exit(main())
