"""Runs the grammar's tables over the words of one item (LALR(1)).

A stack holds the states; with each state but the first stands the value of what has been read to come to it, and
its place. Values are words and what the builder has made of them. Trying out how far words would get needs the
states alone.
"""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from rmr.lang.read.grammar import END, GrammarRule
from rmr.lang.read.lexer import Token, scanner
from rmr.lang.read.source_text import Span
from rmr.lang.read.tables import tables
from rmr.lang.read.tree_builder import Builder

COMMAS_MAX = 3
"""Missing commas that are overlooked when it is tried how far words get."""


class TrialReach(NamedTuple):
    """How far words get; of two, the greater is the better."""

    complete: bool
    """They complete an item."""
    commas: int
    """Minus how many commas that takes."""
    words: int
    """How many fit without."""


class Automaton:
    """What has been read of one item."""

    def __init__(self, file: str, builder: Builder) -> None:
        self._file = file
        self._tables = tables()
        self._reserved = frozenset(scanner().reserved.values())
        self._methods: dict[str, Callable[..., Any]] = {
            rule.name: getattr(builder, rule.name)
            for rule in self._tables.rules
            if rule.name and not (rule.single and rule.length == 1)
        }
        self.reset()

    def reset(self) -> None:
        """Begin another item."""
        self.states = [self._tables.start]
        self._values: list[Any] = []
        self._starts: list[int] = []
        self._ends: list[int] = []

    def take(self, token: Token) -> bool:
        """Read `token` and say whether it fits; if it does not, what has been read stays what it is."""
        states = self.states
        (actions, _, _, rules, *_) = self._tables
        while True:
            row = actions[states[-1]]
            action = row.get(token.kind)
            if action is None and token.kind in self._reserved:
                action = row.get("NAME")
            if action is None:
                return False
            if action >= 0:
                states.append(action)
                self._values.append(token)
                self._starts.append(token.start)
                self._ends.append(token.end)
                return True
            rule = rules[~action]
            if rule.single and rule.length == 1:
                states[-1] = actions[states[-2]][rule.origin]
            else:
                self._recognise(rule, token)

    def _recognise(self, rule: GrammarRule, following: Token) -> None:
        """Put what `rule` makes of the values on top of the stack into their place."""
        first = len(self._values) - rule.length
        values = self._values[first:]
        start, end = (self._starts[first], self._ends[-1]) if values else (following.start, following.start)
        del self.states[first + 1 :], self._values[first:], self._starts[first:], self._ends[first:]
        children: list[Any] = []
        for which in rule.children:
            if which is None:
                children.append(None)
            elif which >= 0:
                children.append(values[which])
            elif children:
                children += values[~which]
            else:
                children = values[~which]  # a repetition grows in place
        if not rule.name:
            value = children
        elif rule.single and len(children) == 1:
            [value] = children
        else:
            value = self._methods[rule.name](Span(self._file, start, end), *children)
        self.states.append(self._tables.actions[self.states[-1]][rule.origin])
        self._values.append(value)
        self._starts.append(start)
        self._ends.append(end)

    def item(self) -> Any:
        """Return the item that has been read, its `.` included."""
        end = Token(END, "", self._ends[-1], self._ends[-1])
        while self.states[-1] != self._tables.end:
            self._recognise(self._tables.rules[~self._tables.actions[self.states[-1]][END]], end)
        return self._values[0]

    def last(self, *kinds: str) -> list[Token]:
        """Return the words that were read last if they are of these `kinds` and nothing has been made of them."""
        values = self._values[-len(kinds) :]
        found = tuple(each.kind for each in values if isinstance(each, Token))
        return values if found == kinds else []

    def back(self, count: int) -> None:
        """Forget the `count` words that were read last."""
        for each in (self.states, self._values, self._starts, self._ends):
            del each[len(each) - count :]

    def unclosed(self, opening: str) -> Token | None:
        """Return the last word of kind `opening` whose counterpart has not been read."""
        words = (each for each in reversed(self._values) if isinstance(each, Token))
        return next((each for each in words if each.kind == opening), None)

    # ---- trying out

    def feed(self, states: list[int], kind: str, *, named: bool = True) -> bool:
        """Take a word of `kind` in `states`, which changes, and say whether it fits; as a name only if `named`."""
        actions = self._tables.actions
        rules = self._tables.rules
        while True:
            row = actions[states[-1]]
            action = row.get(kind)
            if action is None and named and kind in self._reserved:
                action = row.get("NAME")
            if action is None:
                return False
            if action >= 0:
                states.append(action)
                return True
            rule = rules[~action]
            if rule.length:
                del states[-rule.length :]
            states.append(actions[states[-1]][rule.origin])

    def reach(self, states: list[int] | None, kinds: Iterable[str]) -> TrialReach:
        """Try words of these `kinds` in `states`; without states, the first of them begins an item."""
        trial = states[:] if states is not None else [self._tables.start]
        count = 0
        commas = 0
        for kind in kinds:
            if not self.feed(trial, kind):
                if commas == COMMAS_MAX or not (self.feed(trial, "COMMA") and self.feed(trial, kind)):
                    break
                commas += 1
            count += not commas
            if kind == "DOT":
                return TrialReach(True, -commas, count)
        return TrialReach(False, 0, count)

    def accepted(self) -> list[str]:
        """Return the kinds of words that may come next."""
        terminals = [terminal.name for terminal in self._tables.terminals]
        return [kind for kind in terminals if self.feed(self.states[:], kind, named=False)]
