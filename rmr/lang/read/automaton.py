"""The LALR(1) automaton: shifts and reductions over the tokens of one item.

Parallel stacks hold the states, the semantic values (tokens and nodes) and their start and end offsets; the first state
has no value. A trial parse, which only asks how far tokens would get, needs a copy of the states alone.
"""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from rmr.lang.read.grammar import END, GrammarRule
from rmr.lang.read.lexer import Token, scanner
from rmr.lang.read.source_text import Span
from rmr.lang.read.tables import tables
from rmr.lang.read.tree_builder import Builder


class TrialReach(NamedTuple):
    """The result of a trial parse; tuples compare as results do, greater is better."""

    complete: bool
    """The tokens complete an item."""
    commas: int
    """Number of supplied commas, negated; 0 if the item is not complete."""
    words: int
    """Number of tokens accepted before the first supplied comma."""


class Automaton:
    """The stacks of the parser within one item."""

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
        """Empty the stacks for the next item."""
        self.states = [self._tables.start]
        self._values: list[Any] = []
        self._starts: list[int] = []
        self._ends: list[int] = []

    def take(self, token: Token) -> bool:
        """Shift `token` after all reductions, and return True; False if it is unexpected.

        Reductions before an unexpected token stay: LALR(1) tables may reduce before they detect the error.
        """
        states = self.states
        (actions, _, _, rules, *_) = self._tables
        while True:
            row = actions[states[-1]]
            action = row.get(token.kind)
            # Contextual keywords: where the grammar does not expect the keyword, the token is a name.
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
            # A unit production that keeps its child: only the state changes.
            if rule.single and rule.length == 1:
                states[-1] = actions[states[-2]][rule.origin]
            else:
                self._recognise(rule, token)

    def _recognise(self, rule: GrammarRule, following: Token) -> None:
        """Reduce by `rule`: replace the values on top of the stack by the node that the builder makes of them."""
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
        """Return the item after its `.`, by the reductions that the end of input triggers."""
        end = Token(END, "", self._ends[-1], self._ends[-1])
        while self.states[-1] != self._tables.end:
            self._recognise(self._tables.rules[~self._tables.actions[self.states[-1]][END]], end)
        return self._values[0]

    def last(self, *kinds: str) -> list[Token]:
        """Return the tokens on top of the stack if they are of these `kinds` and not reduced, else an empty list."""
        values = self._values[-len(kinds) :]
        found = tuple(each.kind for each in values if isinstance(each, Token))
        return values if found == kinds else []

    def back(self, count: int) -> None:
        """Pop the last `count` tokens, which are not reduced."""
        for each in (self.states, self._values, self._starts, self._ends):
            del each[len(each) - count :]

    def unclosed(self, opening: str) -> Token | None:
        """Return the last token of kind `opening` on the stack: a closed one is reduced, so it is unclosed."""
        words = (each for each in reversed(self._values) if isinstance(each, Token))
        return next((each for each in words if each.kind == opening), None)

    # ---- trial parses

    def feed(self, states: list[int], kind: str, *, named: bool = True) -> bool:
        """Shift a token of `kind` on `states`, in place; return whether it fits. Keywords are names only if `named`."""
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
        """Return how far tokens of these `kinds` get from `states`, or from the beginning of an item if None."""
        trial = states[:] if states is not None else [self._tables.start]
        count = 0
        commas = 0
        for kind in kinds:
            if not self.feed(trial, kind):
                # A trial parse supplies three missing commas at most.
                if commas == 3 or not (self.feed(trial, "COMMA") and self.feed(trial, kind)):
                    break
                commas += 1
            count += not commas
            if kind == "DOT":
                return TrialReach(True, -commas, count)
        return TrialReach(False, 0, count)

    def accepted(self) -> list[str]:
        """Return the kinds of tokens that are expected next."""
        terminals = [terminal.name for terminal in self._tables.terminals]
        return [kind for kind in terminals if self.feed(self.states[:], kind, named=False)]
