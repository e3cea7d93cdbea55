"""What every robot brings along: the predicates it senses and the actions it can do.

The types leave out the owner or executor, as everywhere behind the parser.
"""

from rmr.bytecode.program import Base, Kind, Type

EVENT = "event"
"""The symbol type whose values are the names of time assertions."""

_AREA = Type(Base.SYMBOL, "area")
_EVENT = Type(Base.SYMBOL, EVENT)
_FLOAT = Type(Base.FLOAT)
_INT = Type(Base.INT)
_ROBOT = Type(Base.ROBOT)

PREDICATES: dict[str, tuple[Kind, tuple[Type, ...]]] = {
    "at": (Kind.SENSED, (_AREA,)),
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
"""Facts that a robot keeps up to date by itself, unless the program means something else by the name."""

UNSENSED = ("battery",)
"""Of these the ones that no robot senses yet."""

ACTIONS: dict[str, tuple[Type, ...]] = {
    "moveto": (_AREA,),
    "lineup": (_AREA, _INT),
    "goto": (_FLOAT, _FLOAT),
    "face": (_FLOAT,),
    "stop": (),
    "wait": (_FLOAT,),
    "broadcast": (),
    "say": (Type(Base.STRING),),
    "light": (Type(Base.SYMBOL, "colour"),),
}
"""Actions that every robot can do; a program declares those that its rules derive."""

ARRIVAL = "location"
"""The fact that `moveto`, declared without an effect, inserts on arrival (paper, figure 5)."""


def type_text(kind: Type) -> str:
    """Return `kind` as the source spells it; a symbol of no particular set is a ``symbol``."""
    if kind.base is Base.LIST:
        return "list" if kind.element is None else f"list {type_text(kind.element)}"
    if kind.base is Base.SYMBOL:
        return kind.name or "symbol"
    return kind.base.name.lower()


def declaration_text(name: str, types: tuple[Type, ...], word: str) -> str:
    """Return how to declare it: ``type action moveto(robot, area).``"""
    arguments = ", ".join(["robot", *(type_text(kind) for kind in types)])
    return f"type {word}{name}({arguments})."
