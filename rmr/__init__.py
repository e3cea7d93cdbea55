"""RMR: one logic program for a whole ensemble of robots, with deadlines that hold.

`from rmr import action, ActionFailed, RobotHandle` is what a file of user actions needs; `rmr.compile`,
`rmr.evaluate`, `rmr.simulate` and `rmr.sweep` do what the commands do (docs/python.md). Each name is loaded on its
first use, so that `import rmr` costs nothing: a robot process never loads the compiler or the simulator.
"""

from importlib import import_module
from typing import Any

from rmr.compiled import prefer

__version__ = "0.1.0"

_HOMES = {
    "ActionFailed": "rmr.node.actions.dispatcher",
    "RobotHandle": "rmr.node.actions.dispatcher",
    "action": "rmr.node.actions.dispatcher",
    "CompileError": "rmr.base.errors",
    "Error": "rmr.base.errors",
    "ProgramError": "rmr.base.errors",
    "UsageError": "rmr.base.errors",
    "Compiled": "rmr.eval.api",
    "Evaluation": "rmr.eval.api",
    "compile": "rmr.eval.api",
    "evaluate": "rmr.eval.api",
    "EventError": "rmr_sim.event",
    "invariant": "rmr_sim.user_events",
    "LabError": "rmr_world.finding",
    "Run": "rmr_sim.simulation_api",
    "simulate": "rmr_sim.simulation_api",
    "Sweep": "rmr_sim.sweep_api",
    "sweep": "rmr_sim.sweep_api",
}
"""Name -> the module that defines it."""

__all__ = list(_HOMES)

prefer()


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'rmr' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*_HOMES, *(name for name in globals() if name.startswith("__"))})
