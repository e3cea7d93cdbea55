"""The facts that every robot keeps up to date by itself: their names, kinds and types.

A robot states them with exactly these arguments, so a program that marks a predicate as provided must mean
the same. The types leave out the owner, as everywhere behind the parser.
"""

from rmr.bytecode.program import Base, Kind, Type

EVENT = "event"
"""The symbol type whose values are the names of time assertions."""

_EVENT = Type(Base.SYMBOL, EVENT)
_FLOAT = Type(Base.FLOAT)
_INT = Type(Base.INT)
_ROBOT = Type(Base.ROBOT)

PREDICATES: dict[str, tuple[Kind, tuple[Type, ...]]] = {
    "at": (Kind.SENSED, (Type(Base.SYMBOL, "area"),)),
    "pose": (Kind.SENSED, (_FLOAT, _FLOAT, _FLOAT)),
    "peer": (Kind.SENSED, (_ROBOT,)),
    "neighbor": (Kind.SENSED, (_ROBOT,)),
    "range": (Kind.SENSED, (_ROBOT, _FLOAT)),
    "obstacle": (Kind.SENSED, ()),
    "battery": (Kind.SENSED, (_FLOAT,)),
    "failed": (Kind.SENSED, (_ROBOT, _EVENT)),
    "turn": (Kind.SENSED, (_EVENT, _INT)),
    "leads": (Kind.SENSED, (_EVENT,)),
    "id": (Kind.PERSISTENT, (_INT,)),
}
"""What a robot states of itself, unless the program means something else by the name."""


def is_provided(name: str, kind: Kind, types: tuple[Type, ...]) -> bool:
    """Tell whether every robot provides a predicate of this name, kind and shape (symbol sets aside)."""
    known = PREDICATES.get(name)
    return known is not None and known[0] is kind and [t.base for t in known[1]] == [t.base for t in types]
