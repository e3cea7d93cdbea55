"""Two programs side by side: what a robot that changes from one to the other keeps.

Predicates are the same if name, kind and types are equal, so that every fact of the one is a fact of the other; those
that the compiler has made for ensemble rules mean something in their own program alone. Time assertions are the same if
name, start and finish pattern, and the robots they name, are equal; deadline and violation may differ. Numbers of
predicates and assertions belong to one program: what is kept is renumbered.
"""

from typing import Final

from rmr.bytecode.program import Assertion, Atom, Kind, Predicate, Program

KINDS: Final = {
    Kind.TEMPORARY: "a temporary fact",
    Kind.PERSISTENT: "a persistent fact",
    Kind.SENSED: "a sensed fact",
    Kind.ACTION: "an action",
}


class ProgramPair:
    """An old and a new program."""

    def __init__(self, old: Program, new: Program) -> None:
        self.old = old
        self.new = new
        hidden = frozenset([each.predicate for each in new.ensemble])
        found = [self._same(predicate) for predicate in old.predicates]
        for each in old.ensemble:
            found[each.predicate] = None
        self.predicates: Final = tuple([None if index in hidden else index for index in found])
        """By the old number of a predicate: its new number, None if the new program has no such predicate."""
        self.assertions: Final = self._same_assertions()
        """By the old number of a time assertion: its new number, None if the new program has no such assertion."""

    def _same(self, old: Predicate) -> int | None:
        index = self.new.index(old.name)
        if index is None:
            return None
        new = self.new.predicates[index]
        same = (new.kind, new.types, new.provided) == (old.kind, old.types, old.provided)
        return index if same else None

    def _same_assertions(self) -> tuple[int | None, ...]:
        left = list(range(len(self.new.assertions)))
        found: list[int | None] = []
        for assertion in self.old.assertions:
            same = next((index for index in left if self._alike(assertion, self.new.assertions[index])), None)
            found.append(same)
            if same is not None:
                left.remove(same)
        return tuple(found)

    def _alike(self, old: Assertion, new: Assertion) -> bool:
        named = (old.name, old.robot, old.finisher) == (new.name, new.robot, new.finisher)
        return named and self._agree(old.start, new.start) and self._agree(old.finish, new.finish)

    def _agree(self, old: Atom, new: Atom) -> bool:
        return self.predicates[old.predicate] == new.predicate and old.args == new.args

    def difference(self, index: int) -> str:
        """Return why the old predicate `index` is not kept; empty if it is."""
        if self.predicates[index] is not None:
            return ""
        old = self.old.predicates[index]
        other = self.new.index(old.name)
        if other is None:
            return "the new program has no such predicate"
        new = self.new.predicates[other]
        if new.kind is not old.kind:
            return f"it was {KINDS[old.kind]} and is {KINDS[new.kind]}"
        return "its arguments have other types"
