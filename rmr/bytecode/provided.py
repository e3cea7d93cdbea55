"""What every robot provides: the predicates that it keeps up to date by itself, and the actions that it can carry out.

One table for each. The language takes names and types from it, the verifier checks that a predicate marked as
provided has the row's kind and types, and `rmr.node.actions.built_in` has the handler that an action's row names.
Types leave out the owner or executor, as everywhere behind the parser.
"""

from rmr.base.record import record
from rmr.bytecode.program import Base, Kind, Type

EVENT = "event"
"""The symbol type whose values are the names of time assertions."""
ROBOT_NUMBER = "id"
"""The predicate of a robot's number, ``!id(R, N)``, which never changes."""

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
    doc: str = ""
    """When it holds, for the language reference and editors."""


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
    doc: str = ""
    """What it does, for the language reference and editors."""


PREDICATES: dict[str, ProvidedPredicate] = {
    row.name: row
    for row in (
        ProvidedPredicate(
            "at",
            (_AREA,),
            doc="the robot is in the area: inside its box, or within 4 cm of its point (it stays until 8 cm); of an "
            "area with slots, on the slot that the robot has taken",
        ),
        ProvidedPredicate(
            "pose",
            (_FLOAT, _FLOAT, _FLOAT),
            doc="x, y in metres and heading in radians, rounded to 0.01; none before the robot is localised",
        ),
        ProvidedPredicate("peer", (_ROBOT,), doc="always: the other is in the lab's list of robots"),
        ProvidedPredicate("robots", (_INT,), doc="always: the number of robots in the lab's list, this one included"),
        ProvidedPredicate("neighbor", (_ROBOT,), doc="the other was heard in the last 3 seconds"),
        ProvidedPredicate(
            "range",
            (_ROBOT, _FLOAT),
            doc="distance to a neighbor in metres, estimated from signal strength, steps of 0.1",
        ),
        ProvidedPredicate(
            "silent",
            (_ROBOT,),
            doc="the other has been silent for 15 seconds: neither this robot nor one that it hears has heard it",
        ),
        ProvidedPredicate("obstacle", (), doc="something is in the field of view, or the hull touches something"),
        ProvidedPredicate(
            "battery",
            (_FLOAT,),
            sensed=False,
            doc="the battery voltage, where a Python action or `rmr eval --insert` inserts it",
        ),
        ProvidedPredicate(
            "failed", (_ROBOT, _EVENT), doc="the other's failure broadcast has been heard; it is never withdrawn"
        ),
        ProvidedPredicate("turn", (_EVENT, _INT), doc="the robot is the K-th, from 1, in the schedule of the event"),
        ProvidedPredicate("leads", (_EVENT,), doc="the robot is the leader of the event's group"),
        ProvidedPredicate(
            ROBOT_NUMBER,
            (_INT,),
            Kind.PERSISTENT,
            doc="always: the robot's number, 4 for `@4`. This fact is persistent: `!id(R, N)`",
        ),
    )
}
"""The provided predicates by name."""

ACTIONS: dict[str, ProvidedAction] = {
    row.name: row
    for row in (
        ProvidedAction(
            "moveto",
            (_AREA,),
            "moveto",
            effect="location",
            doc="drives to the area: to its point, or to a spot in its box or among its slots that no other robot has",
        ),
        ProvidedAction(
            "navigate",
            (_AREA,),
            "navigate",
            effect="location",
            doc="drives to the area as `moveto` does, by Nav2 where the robot's body has it",
        ),
        ProvidedAction(
            "lineup",
            (_AREA, _INT),
            "lineup",
            doc="drives to the K-th place, from 1, of the area's queue; a newer `lineup` replaces it; ends at once "
            "when the robot has its turn, or has missed a turn that it could not reach",
        ),
        ProvidedAction("goto", (_FLOAT, _FLOAT), "goto", doc="drives to a point, metres"),
        ProvidedAction(
            "reach",
            (_FLOAT, _FLOAT, _FLOAT, _FLOAT),
            "reach",
            doc="drives straight to a point, metres, with departure and arrival at instants of lab time, seconds; for "
            "robots that move in formation",
        ),
        ProvidedAction("face", (_FLOAT,), "face", doc="turns to a heading, degrees counter-clockwise from the x axis"),
        ProvidedAction("stop", (), "stop", doc="stops the wheels at once; the action that was driving fails"),
        ProvidedAction("wait", (_FLOAT,), "wait", doc="waits, seconds"),
        ProvidedAction(
            "broadcast",
            (),
            "broadcast",
            doc="announces to all robots in range that this one has missed a deadline: they get the fact `failed`",
        ),
        ProvidedAction("say", (Type(Base.STRING),), "say", doc="writes a text into the trace"),
        ProvidedAction("light", (Type(Base.SYMBOL, "colour"),), "light", doc="shows a colour, in the trace"),
    )
}
"""The provided actions by name."""


def is_provided(name: str, kind: Kind, types: tuple[Type, ...]) -> bool:
    """Tell whether every robot provides a predicate of this name, kind and types; sets of symbols are ignored."""

    known = PREDICATES.get(name)
    return known is not None and known.kind is kind and [t.base for t in known.types] == [t.base for t in types]
