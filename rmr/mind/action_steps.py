"""Steps of a user's handler in the log: lists that begin with a code and the number of the action.

An action is numbered from 0 in the order in which the handlers of one incarnation begin. What the dispatcher makes of
the handler is an *activation*. It has a step at its begin, then a step for each thing that the handler does to its
robot, and a step at its end:

    activation                begins with   ends with one of
    the handler is called     RUN           BEGUN, NO_AWAITABLE, FAILED
    it goes on                RESUME        PAUSE, STEP_PAUSE, FOREIGN, RETURN, FAILED
    it is broken off          CLOSE         CLOSED, CLOSE_FAILED
    its condition is asked    (nothing)     TRUE, CONDITION_FAILED, or nothing if the condition is not true
"""

from typing import Any, Final

from rmr.base.values import Robot, Symbol

RUN: Final = "run"
RESUME: Final = "resume"
CLOSE: Final = "close"

BEGUN: Final = "begun"
NO_AWAITABLE: Final = "no awaitable"
FAILED: Final = "failed"
"""Reason, lines of the traceback."""
PAUSE: Final = "pause"
"""Instant, whether there is a condition."""
STEP_PAUSE: Final = "step pause"
"""Number of the step whose pause it is."""
FOREIGN: Final = "foreign"
"""It awaits what no robot offers: its kind."""
RETURN: Final = "return"
CLOSED: Final = "closed"
CLOSE_FAILED: Final = "close failed"
"""Type and text of the exception."""
TRUE: Final = "true"
CONDITION_FAILED: Final = "condition failed"
"""Reason, lines of the traceback."""
ENDS: Final = (BEGUN, NO_AWAITABLE, FAILED, PAUSE, STEP_PAUSE, FOREIGN, RETURN, CLOSED, CLOSE_FAILED)

DRIVE: Final = "drive"
"""Speed, turn rate."""
HALT: Final = "halt"
INSERT: Final = "insert"
"""Predicate, arguments."""
WITHDRAW: Final = "withdraw"
"""Predicate, arguments."""
TRACE: Final = "trace"
"""Word, names and values of its fields."""
STEP: Final = "step"
"""A provided action as a part of this one: its number, from 0; the action; its arguments."""
NEXT: Final = "next"
"""Number of the step that goes on."""
THROW: Final = "throw"
"""Number of the step into which an exception is raised."""
STOP: Final = "stop"
"""Number of the step that is broken off."""
STATE: Final = "state"
"""What `robot.state` is now (`kept_state`); only of durable robots."""
DONE: Final = (DRIVE, HALT, INSERT, WITHDRAW, TRACE, STEP, NEXT, THROW, STOP, STATE)
"""What a handler may do to its robot."""

_EXACT: Final = (bool, int, float, str, Symbol, Robot)


def as_value(value: Any) -> Any:
    """Return an argument in the form in which the log holds it; None, which fits no predicate, for what is no value."""
    kind = type(value)
    if kind is tuple:
        return tuple([as_value(item) for item in value])
    if kind in _EXACT:
        return value if kind is not int or -(1 << 63) <= value < 1 << 63 else None
    return None
