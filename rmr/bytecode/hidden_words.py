"""What the facts mean that the compiler has made for a rule over several robots: words for traces and explanations.

The names of their predicates, such as ``offer__1``, say nothing to the author of the rule. In their place stand the
meaning and the place of the rule: ``offered to @3 by @1 (west), rule corridor.rmr:12``. The part of a name before
``__`` is one of `MEANINGS`, which the compiler's names follow.
"""

from collections.abc import Sequence
from pathlib import PurePath
from typing import Final

from rmr.bytecode.program import Duty, HiddenPredicate, Program

MEANINGS: Final[dict[str, tuple[str, int | None]]] = {
    "life": ("life {0} of {o}", 1),
    "again": ("{o} has begun another life and tells {0}", 1),
    "knows": ("{0} is in life {1}, as {o} knows", 2),
    "hello": ("{0} asks for the life of {o}", 1),
    "greeted": ("{o} has asked for the life of {0}", 1),
    "count": ("the next decision of {o} gets number {0}", 1),
    "out": ("{o} waits for decision {0}", 1),
    "turn": ("it is the turn of {0} to ask {o}", 2),
    "told": ("{o} has been told", 0),
    "wish": ("{0} wants to be told by {o}", 2),
    "wished": ("{o} has asked {0} to tell", 1),
    "offer": ("offered to {o} by {0}", 4),
    "offer_last": ("offered to {o} by {0}", 5),
    "reserve": ("{0} asks {o} to reserve", None),
    "reserved": ("reserved for {o}", 2),
    "booked": ("{o} has reserved for {0}", None),
    "note": ("{o} waits for the answer of {1}", None),
    "note_2": ("{o} waits for the answer of {3}", None),
    "note_3": ("{o} waits for the answer of {5}", None),
    "asked": ("{o} has asked {0}", 2),
    "want": ("{0} is to hear when the facts of {o} match", 1),
    "have": ("{o} may ask {0} again", 2),
    "refused": ("{o} is refused", 2),
    "fired": ("{o} is told that the rule has fired", 2),
    "held": ("{o} holds back its part of the head until {0} knows", None),
    "stands": ("{0} knows that the rule has fired", 3),
    "did": ("{o} remembers the firing for the others", None),
    "settled": ("{0} knows that the rule has fired", None),
    "commit": ("{o} is told that the rule has fired", None),
    "abort": ("{o} is told that the rule has not fired", None),
    "closing": ("{o} waits until all know of the firing", None),
    "closed": ("all know of a firing that {0} decided", None),
    "forget": ("{o} is told that all know of the firing", None),
    "ask": ("{0} asks {o} whether the rule has fired", None),
    "asking": ("{o} has asked whether the rule has fired", None),
    "lost": ("{o} is told that the deciding robot lost its memory", None),
    "doubt": ("{o} asks the others whether the rule has fired", None),
    "query": ("{0} asks {o} whether the rule has fired", None),
    "telling": ("{o} tells the others of the firing", None),
}
"""By beginning of a name: the words, with ``{o}`` for the owner and numbers for arguments behind it, and how many of
these belong to the protocol. The others are values of the rule, which follow in parentheses; None: they are left
out."""

HEARD_ENDS: Final = " has heard"
"""The end of the words for what a robot has heard of a neighbour's shared fact; a fact of a program ends with `)`."""

SHARED: Final = frozenset({"life", "again", "knows", "hello", "greeted", "count", "out", "turn"})
"""Meanings of predicates that all rules over several robots share."""


def hidden_words(program: Program, predicate: int, texts: Sequence[str]) -> str | None:
    """Return the meaning of a fact with its arguments as `texts`, the owner first; None for a predicate of a source."""
    hidden = next((each for each in program.ensemble if each.predicate == predicate), None)
    if hidden is None:
        return None
    words = _meaning(program, hidden, texts)
    return words if _is_shared(program, hidden) else f"{words}, {_rule(program, hidden)}"


def hidden_label(program: Program, predicate: int) -> str:
    """Return ``offer of rule corridor.rmr:12`` for a predicate that stands for a rule, else its name."""
    name = program.predicates[predicate].name
    hidden = next((each for each in program.ensemble if each.predicate == predicate), None)
    if hidden is None:
        return name
    if hidden.duty is Duty.HEARD and hidden.other is not None:
        return program.predicates[hidden.other].name
    base = name.rpartition("__")[0] or name
    return base if _is_shared(program, hidden) else f"{base} of {_rule(program, hidden)}"


def _is_shared(program: Program, hidden: HiddenPredicate) -> bool:
    """Whether several rules use a predicate."""
    name = program.predicates[hidden.predicate].name
    return hidden.duty in {Duty.ASIDE, Duty.RETURN, Duty.HEARD} or name.rpartition("__")[0] in SHARED


def _meaning(program: Program, hidden: HiddenPredicate, texts: Sequence[str]) -> str:
    owner, *args = texts
    if hidden.duty is Duty.ASIDE and hidden.other is not None:
        return f"{program.predicates[hidden.other].name}({', '.join([owner, *args[1:]])}) is set aside"
    if hidden.duty is Duty.HEARD and hidden.other is not None:
        return f"{program.predicates[hidden.other].name}({', '.join(args)}), as {owner}{HEARD_ENDS}"
    if hidden.duty is Duty.RETURN and hidden.other is not None:
        return f"{program.predicates[hidden.other].name}({', '.join([owner, *args])}) returns"
    name = program.predicates[hidden.predicate].name
    words, count = MEANINGS.get(name.rpartition("__")[0], (name, 0))
    try:
        meaning = words.format(*args, o=owner)
    except IndexError:  # byte-code of another compiler
        meaning, count = name, 0
    values = args[count:] if count is not None else []
    return f"{meaning} ({', '.join(values)})" if values else meaning


def _rule(program: Program, hidden: HiddenPredicate) -> str:
    """Return the rule that a predicate stands for: that at which the compiler has made it."""
    places = program.debug.predicates if program.debug is not None else ()
    if hidden.predicate >= len(places):
        return "a rule over several robots"
    place = places[hidden.predicate]
    return f"rule {PurePath(place.file).name}:{place.line}"
