"""The slots that have a value at some point of a rule, and of what type it is as far as the text tells.

A slot has the type of the argument that binds it first; a constant its own; of every other expression nothing
is known. Nothing known is ``Base.OPEN``.
"""

from collections.abc import Iterable, Sequence

from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import SELF_SLOT, Atom, Base, Bind, Code, Conjunct, Mode, Predicate, Slot, Type

UNKNOWN = Type(Base.OPEN)
ROBOT = Type(Base.ROBOT)

_BASES: dict[type, Base] = {
    Robot: Base.ROBOT,
    int: Base.INT,
    float: Base.FLOAT,
    bool: Base.BOOL,
    str: Base.STRING,
    Symbol: Base.SYMBOL,
}


def literal(code: Code) -> Value | None:
    """Return the constant that is all of `code`, or None."""
    return code[0].operand if len(code) == 1 and code[0].op in (Op.CONST, Op.INT) else None


def type_of_value(value: Value) -> Type:
    """Return the type of a constant; of a list nothing is said."""
    return Type(_BASES[type(value)]) if type(value) in _BASES else UNKNOWN


class Scope:
    """Grows conjunct by conjunct; at first only the robot itself has a slot with a value."""

    __slots__ = ("_outer", "_types", "bound")

    def __init__(self, outer: "Scope | None" = None) -> None:
        """Begin with what is bound in `outer`, which grows no more."""
        self._outer = outer
        self._types: dict[int, Type] = {} if outer else {SELF_SLOT: ROBOT}
        self.bound: int = outer.bound if outer else 1 << SELF_SLOT
        """A bit for each slot."""

    def has(self, slot: int) -> bool:
        """Tell whether `slot` has a value."""
        return bool(self.bound >> slot & 1)

    def bind(self, slot: int, kind: Type) -> None:
        """Note that `slot` has a value from here on."""
        if not self.has(slot):
            self._types[slot] = kind
            self.bound |= 1 << slot

    def match(self, atom: Atom, predicate: Predicate) -> None:
        """Note what an atom binds."""
        if atom.mode is Mode.ABSENT:
            return
        for pattern, kind in zip(atom.args, predicate.types, strict=True):
            if isinstance(pattern, Slot):
                self.bind(pattern.index, kind)

    def grow(self, body: Iterable[Conjunct], predicates: Sequence[Predicate]) -> None:
        """Note what a verified body binds."""
        for conjunct in body:
            if isinstance(conjunct, Atom):
                self.match(conjunct, predicates[conjunct.predicate])
            elif isinstance(conjunct, Bind):
                self.bind(conjunct.slot, self.type_of(conjunct.code))

    def type_at(self, slot: int) -> Type | None:
        """Return the type of what is in `slot`; None if it has no value."""
        scope: Scope | None = self
        while scope is not None and slot not in scope._types:
            scope = scope._outer
        return None if scope is None else scope._types[slot]

    def type_of(self, code: Code) -> Type:
        """Return the type of all values that `code` can have."""
        if len(code) != 1:
            return UNKNOWN
        value = literal(code)
        if value is not None:
            return type_of_value(value)
        operand = code[0].operand
        known = self.type_at(operand) if code[0].op is Op.LOAD and isinstance(operand, int) else None
        return UNKNOWN if known is None else known
