"""Scopes of the verifier: the slots that are bound at a point of a rule, with their static types.

A slot has the type of the argument that binds it first, a constant its own type. Every other expression has the
unknown type ``Base.OPEN``.
"""

from collections.abc import Iterable, Sequence

from rmr.base.values import Value
from rmr.bytecode.conform import CLASSES
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    SELF_SLOT,
    Atom,
    Base,
    Bind,
    Code,
    Conjunct,
    Fold,
    Mode,
    Operator,
    Predicate,
    Slot,
    Type,
)

UNKNOWN = Type(Base.OPEN)
ROBOT = Type(Base.ROBOT)

_BASES = {kind: base for base, kind in CLASSES.items()}


def literal(code: Code) -> Value | None:
    """Return the constant that is all of `code`, or None."""
    return code[0].operand if len(code) == 1 and code[0].op in (Op.CONST, Op.INT) else None


def type_of_value(value: Value) -> Type:
    """Return the type of a constant; UNKNOWN for a list."""
    return Type(_BASES[type(value)]) if type(value) in _BASES else UNKNOWN


class Scope:
    """The bound slots, extended conjunct by conjunct; initially slot 0, the robot itself."""

    __slots__ = ("_outer", "_types", "bound")

    def __init__(self, outer: "Scope | None" = None) -> None:
        """Begin with the bindings of `outer`, which must not be extended afterwards."""
        self._outer = outer
        self._types: dict[int, Type] = {} if outer else {SELF_SLOT: ROBOT}
        self.bound: int = outer.bound if outer else 1 << SELF_SLOT
        """The set of bound slots as a bit mask, so that the check of an expression is one operation."""

    def has(self, slot: int) -> bool:
        """Tell whether `slot` is bound."""
        return bool(self.bound >> slot & 1)

    def bind(self, slot: int, kind: Type) -> None:
        """Bind `slot`; a bound one keeps its type."""
        if not self.has(slot):
            self._types[slot] = kind
            self.bound |= 1 << slot

    def match(self, atom: Atom, predicate: Predicate) -> None:
        """Bind the slots of an atom; a negated one binds nothing."""
        if atom.mode is Mode.ABSENT:
            return
        for pattern, kind in zip(atom.args, predicate.types, strict=True):
            if isinstance(pattern, Slot):
                self.bind(pattern.index, kind)

    def grow(self, body: Iterable[Conjunct], predicates: Sequence[Predicate]) -> None:
        """Bind the slots of a verified body."""
        for conjunct in body:
            if isinstance(conjunct, Atom):
                self.match(conjunct, predicates[conjunct.predicate])
            elif isinstance(conjunct, Bind):
                self.bind(conjunct.slot, self.type_of(conjunct.code))
            elif isinstance(conjunct, Fold):
                counts = conjunct.operator is Operator.COUNT
                self.bind(conjunct.result, Type(Base.INT) if counts else UNKNOWN)

    def type_at(self, slot: int) -> Type | None:
        """Return the type of `slot`; None if it is unbound."""
        scope: Scope | None = self
        while scope is not None and slot not in scope._types:
            scope = scope._outer
        return None if scope is None else scope._types[slot]

    def type_of(self, code: Code) -> Type:
        """Return the static type of `code`; UNKNOWN unless it is one constant or one slot."""
        if len(code) != 1:
            return UNKNOWN
        value = literal(code)
        if value is not None:
            return type_of_value(value)
        operand = code[0].operand
        known = self.type_at(operand) if code[0].op is Op.LOAD and isinstance(operand, int) else None
        return UNKNOWN if known is None else known
