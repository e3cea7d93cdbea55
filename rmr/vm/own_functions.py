"""Calls of the program's functions (docs/language.md, "Functions"): bounds on recursion, and their messages.

A function may call itself. To bound the time of an expression, one call may lead to calls nested at most
`NESTED_CALLS_MAX` deep and to `CALLS_MAX` calls altogether; beyond that it has no value. Both engines count alike: a
call is counted after its arguments have been evaluated and before its own expression is.
"""

from collections.abc import Sequence
from typing import Final

from rmr.base.values import Value, format_value
from rmr.bytecode.arithmetic import NoValue

NESTED_CALLS_MAX: Final = 250
"""Bound on the depth of nested calls: generated code recurses, and Python allows a thousand frames in all."""

CALLS_MAX: Final = 10_000
"""Calls that one call leads to: some milliseconds. A robot fires rules between two of its 60 ticks a second."""

SHOWN_MAX: Final = 60
"""Characters of the arguments that a message shows."""


def beyond(name: str, depth: int, args: Sequence[Value]) -> NoValue:
    """Return the reason why a call of a function at nesting depth `depth` has no value."""
    shown = ", ".join([format_value(arg) for arg in args])
    shown = shown if len(shown) <= SHOWN_MAX else shown[: SHOWN_MAX - 3] + "..."
    if depth > NESTED_CALLS_MAX:
        return NoValue(f"{name}({shown}): more than {NESTED_CALLS_MAX} calls within one another")
    return NoValue(f"{name}({shown}): more than {CALLS_MAX} calls in one expression")
