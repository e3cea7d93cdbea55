"""The command lines of a run's processes: the world, and the agents of robots."""

import sys
from collections.abc import Sequence

from rmr.base.ids import spelled
from rmr_deploy.preparation import RunPlan


def world_command(plan: RunPlan, endpoint: str) -> list[str]:
    """Return the command that starts the world."""
    lab = plan.lab
    options = ["--listen", endpoint, "--seed", str(lab.seed), "--robots", str(len(lab.robots)), "--when-ready"]
    return [*python("rmr_world.main"), "--config", str(lab.path), *options, "--secret", str(plan.secret)]


def agent_command(plan: RunPlan, robots: Sequence[int], endpoint: str) -> list[str]:
    """Return the command that starts the process of the robots `robots`."""
    actions = ["--actions", str(plan.options.actions)] if plan.options.actions else []
    files = (["--radio-key", str(plan.lab.key_file)] if plan.lab.key_file else []) + plan.state(robots)
    options = ["--id", spelled(robots), "--connect", endpoint, "--lab", plan.lab.name, *actions, *files]
    return [*python("rmr_agent.main"), *options, "--secret", str(plan.secret), str(plan.byte_code)]


def python(module: str) -> list[str]:
    """Return the command that runs `module` with this interpreter; -P: without the current folder in its path."""
    return [sys.executable, "-P", "-m", module]
