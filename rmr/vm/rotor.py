"""Rotor-router: round-robin among the matches of one rule, by the facts that it keeps, while an open goal ranks it.

"The oldest facts go first" alone starves matches: a robot that searches for a room with the rule ``location(R, A),
door(R, A, B) -o moveto(R, B)`` would leave each room by its oldest door, and alternate between two rooms without end.
So among the matches of the best rank, the first is the one for whose kept facts the rule has fired least recently or
never; ties are broken by the oldest facts. Each room then sends the robot through its doors in turn. This is a
rotor-router walk (Propp machine). It visits every edge of a finite strongly connected graph again and again, each
within O(m D) steps (m edges, diameter D; Yanovski, Wagner, Bruckstein, "A distributed ant algorithm for efficiently
patrolling a network", Algorithmica 37, 2003).

Kept facts are the persistent, the sensed and the ``$`` ones. They are compared by value, for a sensed fact that is
inserted again is a new fact. A sensed float is left out: it is a measurement and rarely repeats. Consumed facts are
left out: they may be counters. Rules that consume nothing fire once for each match, so none of their matches starves.

The same memory detects livelock: a rule that has fired repeatedly for the same facts, the consumed ones included, while
no goal was achieved.
"""

from collections import OrderedDict
from collections.abc import Hashable, Sequence
from typing import NamedTuple

from rmr.base.identity import ByIdentity
from rmr.base.time import Instant
from rmr.bytecode.octets import identity
from rmr.bytecode.program import Atom, Base, Kind, Mode, Predicate, Program, Rule
from rmr.vm.bounds import Dropped
from rmr.vm.machine_events import RuleRepeats, VmEvent
from rmr.vm.store import Args, is_open

ROTOR_MATCHES_MAX = 256
"""Matches of the best rank that are compared, the oldest ones: more than a room has doors, and few enough to examine
all of them at every firing."""

ROTOR_MEMORY_MAX = 100_000
"""Combinations of kept facts whose last firing is remembered; beyond that the least recent one is forgotten."""

REPEATS_REPORTED = 20
"""Repeated firings for the same facts after which a rule is reported: a walk through a dozen rooms has fewer."""

Key = tuple[Hashable, ...]
"""The rule, then the values of each kept fact."""


class KeptAtom(NamedTuple):
    """Projection of a match's kept fact onto the values that identify it."""

    place: int
    """Among the match's facts."""
    positions: tuple[int, ...] | None
    """Positions of the identifying arguments; None: all."""
    is_open: bool
    """Whether an argument has an open type, so that 1 and 1.0 must be kept apart."""


class RotorPlan(NamedTuple):
    """The facts that a rule consumes and keeps, as places among the facts of a match."""

    kept: tuple[KeptAtom, ...]
    consumed: tuple[int, ...]


class LastFiring:
    """The last firing of a rule for some kept facts."""

    __slots__ = ("achieved", "consumed", "repeats", "turn")

    def __init__(self) -> None:
        self.turn = 0
        """Grows from firing to firing."""
        self.consumed: list[Args] = []
        self.repeats = 0
        """Firings in a row that consumed the same values, with no goal achieved between them."""
        self.achieved = 0
        """Number of goals achieved before that firing."""


def _plan(rule: Rule, predicates: Sequence[Predicate]) -> RotorPlan:
    atoms = [each for each in rule.body if isinstance(each, Atom) and each.mode is not Mode.ABSENT]
    kept = tuple(
        KeptAtom(place, _positions(predicates[atom.predicate]), any(map(is_open, predicates[atom.predicate].types)))
        for place, atom in enumerate(atoms)
        if atom.mode is not Mode.CONSUME
    )
    return RotorPlan(kept, tuple(place for place, atom in enumerate(atoms) if atom.mode is Mode.CONSUME))


def _positions(predicate: Predicate) -> tuple[int, ...] | None:
    if predicate.kind is not Kind.SENSED:
        return None
    return tuple(place for place, kind in enumerate(predicate.types) if kind.base is not Base.FLOAT)


_plans: ByIdentity[Program, tuple[RotorPlan, ...]] = ByIdentity(
    lambda program: tuple([_plan(rule, program.predicates) for rule in program.rules])
)
"""Returns the plans of a program's rules."""


class Rotor:
    """Memory of the last firing of each rule of one robot, by its kept facts, while a goal ranked it."""

    __slots__ = ("_dropped", "_events", "_last", "_plans", "_reported", "_turn", "_turning")

    def __init__(self, program: Program, events: list[VmEvent], dropped: Dropped) -> None:
        """Report rules that repeat themselves to `events`, each once."""
        self._plans = _plans(program)
        self._events = events
        self._dropped = dropped
        self._last: OrderedDict[Key, LastFiring] = OrderedDict()
        """The least recent first."""
        self._turn = 0
        self._turning: set[int] = set()
        """The rules with kept facts that have fired."""
        self._reported: set[int] = set()

    def turns(self, rule: int) -> bool:
        """Return whether matches of `rule` take turns: it has kept facts and has fired."""
        return rule in self._turning

    def last(self, rule: int, facts: Sequence[Args]) -> int:
        """Return the turn of the last firing of `rule` for the kept facts of a match; 0: never."""
        found = self._last.get(self._key(rule, facts))
        return 0 if found is None else found.turn

    def fire(self, now: Instant, rule: int, facts: Sequence[Args], achieved: int) -> None:
        """Record that `rule`, which consumes, fires for `facts`; `achieved` goals have been discharged so far."""
        key = self._key(rule, facts)
        plan = self._plans[rule]
        # The memory is an LRU cache: a key that fires moves to the end, and the front is evicted.
        found = self._last.get(key)
        if found is None:
            found = self._last[key] = LastFiring()
        else:
            self._last.move_to_end(key)
        found.turn = self._turn = self._turn + 1
        # A firing that consumes other values, or follows a goal achieved, is progress: the count begins again.
        consumed = [facts[place] for place in plan.consumed]
        if consumed == found.consumed and achieved == found.achieved:
            found.repeats += 1
        else:
            found.consumed = consumed
            found.achieved = achieved
            found.repeats = 1
        if len(self._last) > ROTOR_MEMORY_MAX:
            self._last.popitem(last=False)
            self._dropped.add("rotor", ROTOR_MEMORY_MAX, now)
        if plan.kept:  # without kept facts all matches have one key, and there is nothing to take turns
            self._turning.add(rule)
        if found.repeats >= REPEATS_REPORTED and rule not in self._reported:
            self._reported.add(rule)
            self._events.append(RuleRepeats(rule, found.repeats, now))

    def _key(self, rule: int, facts: Sequence[Args]) -> Key:
        values: list[Hashable] = [rule]
        for place, positions, may_differ in self._plans[rule].kept:
            args = facts[place]
            if positions is not None:
                args = tuple([args[position] for position in positions])
            # `identity` keeps 1 and 1.0 apart, which Python's equality does not.
            values.append(identity(args) if may_differ else args)
        return tuple(values)
