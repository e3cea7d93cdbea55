"""Types and declarations as a source text spells them."""

from rmr.bytecode.program import Base, Type

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
