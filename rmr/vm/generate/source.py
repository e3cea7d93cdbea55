"""The parts of generated source: single Python expressions, and the names that they use.

A Source can stand as an operand or argument. Python evaluates from left to right like the stack machine, so source
that keeps the order of the operands fails where the byte-code fails and with the same message. Expressions have no
other effect: the order of operands matters only when more than one of them may have no value.
"""

from math import copysign
from typing import Any

from rmr.base.record import record
from rmr.base.values import Robot, Symbol, Value
from rmr.vm.generate.form import Equality
from rmr.vm.generate.known import Known

DRAWS = "draws"
"""The variable of generated code that holds the numbers of a firing (`rmr.vm.derive.Draws`)."""


@record
class Source:
    """One Python expression."""

    text: str
    known: Known
    """Abstract value: type and bounds of its value."""
    fails: bool
    """Whether it may raise NoValue; nothing else is ever raised."""
    repeatable: bool = False
    """Whether it is a variable, a number or a global constant, which costs nothing to evaluate again."""
    constant: Value | None = None
    """Its value, if it is a constant."""
    equality: Equality | None = None
    """The same as a comparison with a constant, if it is one."""


class Pool:
    """The names of one generated module: temporaries ``t0`` .., constants ``k0`` .., and the functions it calls."""

    def __init__(self) -> None:
        self.globals: dict[str, Any] = {}
        """The globals that the generated module needs."""
        self._temporaries = 0
        self._constants: dict[tuple[type, Symbol | Robot], str] = {}

    def temporary(self) -> str:
        """Return the name of a new local variable."""
        self._temporaries += 1
        return f"t{self._temporaries - 1}"

    def constant(self, value: Value) -> str:
        """Return the text that stands for `value`, with its type: a literal if there is one, else a global."""
        if type(value) is int or type(value) is float:
            return f"({value!r})" if copysign(1, value) < 0 else repr(value)
        if type(value) in (bool, str):
            return repr(value)
        if type(value) is tuple:
            return self.object(value)
        assert isinstance(value, Symbol | Robot)
        key = (type(value), value)
        if key not in self._constants:
            self._constants[key] = self.object(value)
        return self._constants[key]

    def object(self, thing: Any) -> str:
        """Return a new global that holds `thing`."""
        name = f"k{len(self.globals)}"
        self.globals[name] = thing
        return name

    def helper(self, name: str, thing: Any) -> str:
        """Return `name`, the global that holds `thing`, mostly a function."""
        assert self.globals.setdefault(name, thing) is thing, f"{name} is taken"
        return name

    def held(self, source: Source) -> tuple[str, str]:
        """Return the text for the first use of a value that is needed again, and the text for each later use."""
        if source.repeatable:
            return source.text, source.text
        name = self.temporary()
        return f"({name} := {source.text})", name


def fails(*sources: Source) -> bool:
    """Return whether one of `sources` may have no value."""
    return any(source.fails for source in sources)


def movable(*sources: Source) -> bool:
    """Return whether `sources` may be evaluated in any order: at most one of them can fail."""
    return sum(source.fails for source in sources) <= 1
