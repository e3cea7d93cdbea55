"""The facts that ranks depend on, as sets with indices: a copy of the tables that backward chaining joins.

It is a copy for two reasons. Both engines rank over the same structure. And the search may be interrupted: it sees the
changes in the order in which they happened, instead of the facts that hold when it resumes. Equal facts count once.
"""

from collections.abc import Collection, Iterable, Sequence

from rmr.analysis.regressions import AbsentAtom, Row, Terms

Env = list[object]
"""By slot the form of its value; None: unbound."""

Mask = tuple[int, ...]
"""Positions of arguments."""

NOTHING: tuple[Row, ...] = ()


class SideFacts:
    """The facts of one predicate."""

    __slots__ = ("_counts", "_indices", "blocking")

    def __init__(self) -> None:
        self._counts: dict[Row, int] = {}
        self._indices: dict[Mask, dict[Row, dict[Row, None]]] = {}
        self.blocking: dict[tuple[Mask, tuple[tuple[int, int], ...]], dict[Row, dict[object, None]]] = {}
        """By the positions that a ``not`` compares, and their values: the steps with that ``not``."""

    def add(self, row: Row) -> bool:
        """Add a fact; return whether it is the first such fact."""
        count = self._counts.get(row, 0)
        self._counts[row] = count + 1
        if count:
            return False
        for mask, index in self._indices.items():
            index.setdefault(tuple([row[place] for place in mask]), {})[row] = None
        return True

    def remove(self, row: Row) -> bool:
        """Remove a fact; return whether it was the last such fact."""
        count = self._counts.get(row, 0)
        if count > 1:
            self._counts[row] = count - 1
        if count != 1:
            return False
        del self._counts[row]
        for mask, index in self._indices.items():
            key = tuple([row[place] for place in mask])
            bucket = index[key]
            del bucket[row]
            if not bucket:
                del index[key]
        return True

    def rows(self, mask: Mask, key: Row, arity: int) -> Collection[Row]:
        """Return the facts with the values `key` at the positions `mask`."""
        if not mask:
            return self._counts.keys()
        if len(mask) == arity:
            return (key,) if key in self._counts else NOTHING
        index = self._indices.get(mask)
        if index is None:
            index = self._indices[mask] = {}
            for row in self._counts:
                index.setdefault(tuple([row[place] for place in mask]), {})[row] = None
        return index.get(key, NOTHING)


def matches(terms: Terms, row: Row, env: Env, trail: list[int]) -> bool:
    """Return whether a fact matches under `env`; bind the unbound slots, and note them in `trail`."""
    for place, value in terms.constants:
        if row[place] != value:
            return False
    for place, slot in terms.slots:
        bound = env[slot]
        if bound is None:
            env[slot] = row[place]
            trail.append(slot)
        elif bound != row[place]:
            return False
    return True


def undo(env: Env, trail: list[int], length: int = 0) -> None:
    """Unbind the slots that were bound since `trail` had `length` entries."""
    while len(trail) > length:
        env[trail.pop()] = None


def probe(terms: Terms, env: Env) -> tuple[Mask, Row]:
    """Return the positions whose values are known under `env`, and the values, ordered by position."""
    if not terms.constants:
        found = [(place, env[slot]) for place, slot in terms.slots if env[slot] is not None]
    else:
        found = [*terms.constants, *[(place, env[slot]) for place, slot in terms.slots if env[slot] is not None]]
        found.sort(key=_place)
    return tuple([place for place, _ in found]), tuple([value for _, value in found])


def _place(known: tuple[int, object]) -> int:
    return known[0]


def has_twins(row: Sequence[object], twins: Iterable[tuple[int, int]]) -> bool:
    """Return whether a fact has equal values wherever a variable of a ``not`` stands twice."""
    return all(row[place] == row[earlier] for place, earlier in twins)


def is_known(absent: AbsentAtom, env: Env) -> bool:
    """Return whether all variables of a ``not`` that the rest of the body binds have values."""
    return all(env[slot] is not None for _, slot in absent.terms.slots)
