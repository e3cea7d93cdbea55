"""What every robot provides: the predicates that it keeps up to date by itself, and the actions that it can carry out.

One table for each. The language takes names and types from it, the verifier checks that a predicate marked as
provided has the row's kind and types, and `rmr.node.actions.built_in` has the handler that an action's row names.
Types leave out the owner or executor, as everywhere behind the parser.
"""

from rmr.base.record import record
from rmr.bytecode.program import Base, Kind, Type

EVENT = "event"
"""The symbol type whose values are the names of time assertions."""

_AREA = Type(Base.SYMBOL, "area")
_EVENT = Type(Base.SYMBOL, EVENT)
_FLOAT = Type(Base.FLOAT)
_INT = Type(Base.INT)
_ROBOT = Type(Base.ROBOT)


@record
class ProvidedPredicate:
    """A predicate whose facts a robot states of itself, unless the program means something else by the name."""

    name: str
    types: tuple[Type, ...]
    kind: Kind = Kind.SENSED
    sensed: bool = True
    """Whether robots state it by themselves; if not, only user actions and inserted facts do."""


@record
class ProvidedAction:
    """An action that every robot can carry out; a program declares those that its rules derive."""

    name: str
    types: tuple[Type, ...]
    handler: str
    """The name of the coroutine in `rmr.node.actions.built_in` that carries it out."""
    effect: str | None = None
    """The predicate whose fact, with the action's first argument, is its effect if it is declared without one and the
    program knows the predicate (paper, figure 5)."""


PREDICATES: dict[str, ProvidedPredicate] = {
    row.name: row
    for row in (
        ProvidedPredicate("at", (_AREA,)),
        ProvidedPredicate("pose", (_FLOAT, _FLOAT, _FLOAT)),
        ProvidedPredicate("peer", (_ROBOT,)),
        ProvidedPredicate("robots", (_INT,)),
        ProvidedPredicate("neighbor", (_ROBOT,)),
        ProvidedPredicate("range", (_ROBOT, _FLOAT)),
        ProvidedPredicate("obstacle", ()),
        ProvidedPredicate("battery", (_FLOAT,), sensed=False),
        ProvidedPredicate("failed", (_ROBOT, _EVENT)),
        ProvidedPredicate("turn", (_EVENT, _INT)),
        ProvidedPredicate("leads", (_EVENT,)),
        ProvidedPredicate("id", (_INT,), Kind.PERSISTENT),
    )
}
"""The provided predicates by name."""

ACTIONS: dict[str, ProvidedAction] = {
    row.name: row
    for row in (
        ProvidedAction("moveto", (_AREA,), "moveto", effect="location"),
        ProvidedAction("lineup", (_AREA, _INT), "lineup"),
        ProvidedAction("goto", (_FLOAT, _FLOAT), "goto"),
        ProvidedAction("reach", (_FLOAT, _FLOAT, _FLOAT, _FLOAT), "reach"),
        ProvidedAction("face", (_FLOAT,), "face"),
        ProvidedAction("stop", (), "stop"),
        ProvidedAction("wait", (_FLOAT,), "wait"),
        ProvidedAction("broadcast", (), "broadcast"),
        ProvidedAction("say", (Type(Base.STRING),), "say"),
        ProvidedAction("light", (Type(Base.SYMBOL, "colour"),), "light"),
    )
}
"""The provided actions by name."""


def is_provided(name: str, kind: Kind, types: tuple[Type, ...]) -> bool:
    """Tell whether every robot provides a predicate of this name, kind and types; sets of symbols are ignored."""

    known = PREDICATES.get(name)
    return known is not None and known.kind is kind and [t.base for t in known.types] == [t.base for t in types]
