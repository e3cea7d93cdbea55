"""What every robot brings along: the predicates it senses and the actions it can do.

The types leave out the owner or executor, as everywhere behind the parser.
"""

from rmr.bytecode.program import Base, Type
from rmr.bytecode.provided import EVENT, PREDICATES

__all__ = ["ACTIONS", "ARRIVAL", "EVENT", "PREDICATES", "UNSENSED", "declaration_text", "type_text"]

_AREA = Type(Base.SYMBOL, "area")
_FLOAT = Type(Base.FLOAT)
_INT = Type(Base.INT)

UNSENSED = ("battery",)
"""Of these the ones that no robot senses yet."""

ACTIONS: dict[str, tuple[Type, ...]] = {
    "moveto": (_AREA,),
    "lineup": (_AREA, _INT),
    "goto": (_FLOAT, _FLOAT),
    "reach": (_FLOAT, _FLOAT, _FLOAT, _FLOAT),
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


SYNONYMS = {
    "integer": "int",
    "double": "float",
    "real": "float",
    "number": "float",
    "boolean": "bool",
    "str": "string",
    "text": "string",
}
"""What other languages call the built-in types."""


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
