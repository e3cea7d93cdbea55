"""What a start fact binds, and what a finish fact's pattern is then (paper III.E).

The robot of a job and the one that watches for its finish fact work this out alike, each for itself, from the
same start fact.
"""

from rmr.base.values import Robot, Value
from rmr.bytecode.octets import identity
from rmr.bytecode.program import SELF_SLOT, Constant, Pattern, Slot
from rmr.vm.match import pattern_agrees
from rmr.vm.store import Args

Bindings = tuple[Value | None, ...]
"""What an assertion's slots are; None: nothing yet."""


def bind(slots: int, patterns: tuple[Pattern, ...], args: Args, robot: Robot) -> Bindings | None:
    """Return the slots as `args` bind them through `patterns`, or None if they do not match; slot 0 is `robot`."""
    bindings: list[Value | None] = [None] * slots
    bindings[SELF_SLOT] = robot
    if not pattern_agrees(patterns, args, tuple(bindings)):
        return None
    for pattern, value in zip(patterns, args, strict=True):
        if isinstance(pattern, Slot):
            bindings[pattern.index] = value
    return tuple(bindings)


def instantiate(pattern: Pattern, bindings: Bindings) -> Pattern:
    """Return `pattern` with its variable replaced by what it is bound to."""
    if isinstance(pattern, Slot):
        value = bindings[pattern.index]
        return pattern if value is None else Constant(value)
    return pattern


def robot_of(pattern: Pattern, bindings: Bindings) -> Robot | None:
    """Return the robot that `pattern` names under `bindings`; None if it is none."""
    named = instantiate(pattern, bindings)
    return named.value if isinstance(named, Constant) and type(named.value) is Robot else None


def key_of(patterns: tuple[Pattern, ...]) -> tuple[object, ...]:
    """Return a key that two patterns share if they are the same; values that Python calls equal may not be."""
    return tuple([identity(p.value) if isinstance(p, Constant) else repr(p) for p in patterns])
