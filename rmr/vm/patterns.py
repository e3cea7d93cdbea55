"""Binding of a start fact's variables and instantiation of the finish pattern (paper III.E).

The robot of a job and the robot that watches for its finish fact both compute this from the same start fact, so the
bindings need not be sent.
"""

from rmr.base.values import Robot, Value
from rmr.bytecode.octets import identity
from rmr.bytecode.program import SELF_SLOT, Constant, Pattern, Slot
from rmr.vm.match import pattern_agrees
from rmr.vm.store import Args

Bindings = tuple[Value | None, ...]
"""Values of an assertion's slots; None: unbound."""


def bind(slots: int, patterns: tuple[Pattern, ...], args: Args, robot: Robot) -> Bindings | None:
    """Return the slots that `args` bind through `patterns`, or None if they do not match; slot 0 is `robot`."""
    bindings: list[Value | None] = [None] * slots
    bindings[SELF_SLOT] = robot
    if not pattern_agrees(patterns, args, tuple(bindings)):
        return None
    for pattern, value in zip(patterns, args, strict=True):
        if isinstance(pattern, Slot):
            bindings[pattern.index] = value
    return tuple(bindings)


def instantiate(pattern: Pattern, bindings: Bindings) -> Pattern:
    """Return `pattern` with a bound variable replaced by its value."""
    if isinstance(pattern, Slot):
        value = bindings[pattern.index]
        return pattern if value is None else Constant(value)
    return pattern


def robot_of(pattern: Pattern, bindings: Bindings) -> Robot | None:
    """Return the robot that `pattern` denotes under `bindings`; None if its value is no robot."""
    named = instantiate(pattern, bindings)
    return named.value if isinstance(named, Constant) and type(named.value) is Robot else None


def key_of(patterns: tuple[Pattern, ...]) -> tuple[object, ...]:
    """Return a key that is equal for identical patterns only; it distinguishes 1, 1.0 and True, unlike Python's ==."""
    return tuple([identity(p.value) if isinstance(p, Constant) else repr(p) for p in patterns])
