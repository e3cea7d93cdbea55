"""Types and declarations in the syntax of the language."""

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
"""Names of the built-in types in other languages."""


def type_text(kind: Type) -> str:
    """Return `kind` in the syntax of the language; a symbol of no set is ``symbol``."""
    if kind.base is Base.LIST:
        return "list" if kind.element is None else f"list {type_text(kind.element)}"
    if kind.base is Base.SYMBOL:
        return kind.name or "symbol"
    return kind.base.name.lower()


def declaration_text(name: str, types: tuple[Type, ...], word: str) -> str:
    """Return a declaration, such as ``type action moveto(robot, area).``"""

    arguments = ", ".join(["robot", *(type_text(kind) for kind in types)])
    return f"type {word}{name}({arguments})."
