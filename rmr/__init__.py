"""RMR: one logic program for a whole ensemble of robots, with deadlines that hold.

`from rmr import action, ActionFailed, RobotHandle` is what a file of user actions needs; all are loaded on first use.
"""

from typing import TYPE_CHECKING, Any

from rmr.compiled import prefer

if TYPE_CHECKING:  # so that type checkers know what `__getattr__` returns
    from rmr.node.actions import ActionFailed, RobotHandle, action

__version__ = "0.1.0"

__all__ = ["ActionFailed", "RobotHandle", "action"]

prefer()


def __getattr__(name: str) -> Any:
    if name in __all__:
        from rmr.node import actions  # noqa: PLC0415 - `rmr --help` and the compiler need no robot

        return getattr(actions, name)
    raise AttributeError(f"module 'rmr' has no attribute {name!r}")
