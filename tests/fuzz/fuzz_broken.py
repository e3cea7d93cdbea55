"""Machines that are wrong in one way each: what the fuzzer must find, or it finds nothing.

Each breaks the interpreter as an engine that keeps more than the interpreter does might be wrong: something is not
looked at again, two values are taken for one, an order is lost.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest

from rmr.bytecode.program import Atom, Mode
from rmr.vm import aggregate, derive, interpreter, match, once, store
from rmr.vm.failures import Failures
from rmr.vm.goals import Goals
from rmr.vm.interpreted import Interpreted
from rmr.vm.interpreter import Interpreter
from rmr.vm.rotor import Rotor
from rmr.vm.urgency import UNURGENT, Urgency

Patch = pytest.MonkeyPatch
Break = Callable[[Patch], None]


def newest_facts_first(patch: Patch) -> None:
    candidates = match.candidates
    patch.setattr(match, "candidates", lambda *args: list(candidates(*args))[::-1])


def draws_without_a_choice(patch: Patch) -> None:
    best = Interpreter._best

    def drawing(self):
        found = best(self)
        if len(found) == 1 and not self._textual:
            self._choices.below(1)
        return found

    patch.setattr(Interpreter, "_best", drawing)


def last_in_the_text(patch: Patch) -> None:
    best = Interpreter._best
    patch.setattr(Interpreter, "_best", lambda self: best(self)[:: -1 if self._textual else 1])


def removal_leaves_not_as_it_was(patch: Patch) -> None:
    """A fact that goes is noticed only by rules that match one of its predicate."""

    def remove(self, now, fact):
        touch = self._interpreter._readers[fact.predicate]
        matching = [state for state in touch if fact.predicate in positive(self.program.rules[state.index])]
        whole, self._interpreter._readers[fact.predicate] = touch, matching
        removed(self, now, fact)
        self._interpreter._readers[fact.predicate] = whole

    removed = Interpreted._remove
    patch.setattr(Interpreted, "_remove", remove)


def positive(rule) -> set[int]:
    bodies = interpreter.bodies(rule)
    return {
        each.predicate for body in bodies for each in body if isinstance(each, Atom) and each.mode is not Mode.ABSENT
    }


def fires_never_again(patch: Patch) -> None:
    look = once.Changing._look

    def remembering(self, *args):
        fired = self._fired
        look(self, *args)
        self._fired |= fired
        self._kept = [each for each in self._kept if each.key not in fired]

    patch.setattr(once.Changing, "_look", remembering)


def fires_for_each_look(patch: Patch) -> None:
    """A match that came by an insertion between two runs is found once more."""
    add = once.Growing._add

    def twice(self, search, now):
        before = len(self._kept)
        add(self, search, now)
        if len(self._kept) > before:
            self._kept.append(self._kept[-1])

    patch.setattr(once.Growing, "_add", twice)


def new_facts_are_not_joined(patch: Patch) -> None:
    plans = once.fresh_plans
    patch.setattr(once, "fresh_plans", lambda *args: list(plans(*args))[:1])


def ranks_are_ignored(patch: Patch) -> None:
    patch.setattr(Goals, "nearest", lambda self, rule: None)


def deadlines_are_ignored(patch: Patch) -> None:
    patch.setattr(Urgency, "first", lambda self, rule: UNURGENT)


def changes_of_jobs_go_unnoticed(patch: Patch) -> None:
    renew = Urgency.renew

    def forgetting(self, jobs):
        version = self.version
        renew(self, jobs)
        self.version = version

    patch.setattr(Urgency, "renew", forgetting)


def the_oldest_door_again(patch: Patch) -> None:
    patch.setattr(Rotor, "turns", lambda self, rule: False)


def goals_go_unnoticed(patch: Patch) -> None:
    patch.setattr(Interpreter, "touch_goal", lambda self, predicate: None)


def inner_bodies_see_what_was_consumed(patch: Patch) -> None:
    search = derive.Search
    patch.setattr(derive, "Search", lambda *args: search(*args[:5], (), args[6]))


def inner_matches_share_facts(patch: Patch) -> None:
    search = derive.Search
    patch.setattr(derive, "Search", lambda *args: search(*args[:6], set()))


def one_is_true(patch: Patch) -> None:
    """What Python calls equal is one value, where types are open too."""
    agrees = match.agrees

    def loosely(step, args, env):
        return agrees(replace(step, strict=False), args, env)

    patch.setattr(match, "agrees", loosely)
    patch.setattr(once, "agrees", loosely)


def sets_hold_one_for_true(patch: Patch) -> None:
    patch.setattr(store, "identity", lambda value: value)


def failures_are_told_again(patch: Patch) -> None:
    tell = Failures.match

    def forgetful(self, *args):
        self._known = None
        tell(self, *args)

    patch.setattr(Failures, "match", forgetful)


def stale_rules_in_any_order(patch: Patch) -> None:
    patch.setattr(interpreter, "sorted", lambda items, key: list(items), raising=False)


def the_time_of_the_first_look(patch: Patch) -> None:
    patch.setattr(Interpreter, "resume", lambda self: None)


def one_firing_more(patch: Patch) -> None:
    fire = Interpreted._fire

    def eager(self, now):
        self._budget += 1
        fire(self, now)
        self._budget -= 1

    patch.setattr(Interpreted, "_fire", eager)


def newest_of_equals(patch: Patch) -> None:
    def better(operator, value, best):
        return best is None or not aggregate.better(operator, best, value)

    patch.setattr(derive, "better", better)


def sums_without_end(patch: Patch) -> None:
    patch.setattr(aggregate, "checked", lambda value: value)


def types_without_doubt(patch: Patch) -> None:
    patch.setattr(derive, "check_types", lambda checks, args: None)


def gone_facts_are_not_remembered(patch: Patch) -> None:
    """A sensed fact that goes is as if it had never been, for robots that ask late."""
    removed = Interpreted._remove

    def remove(self, now, fact):
        with patch.context() as inner:
            inner.setattr(type(self._watches), "removed", lambda *args: None)
            removed(self, now, fact)

    patch.setattr(Interpreted, "_remove", remove)


BREAKS: dict[str, Break] = {
    each.__name__: each
    for each in (
        newest_facts_first,
        draws_without_a_choice,
        last_in_the_text,
        removal_leaves_not_as_it_was,
        fires_never_again,
        fires_for_each_look,
        new_facts_are_not_joined,
        ranks_are_ignored,
        the_oldest_door_again,
        goals_go_unnoticed,
        inner_bodies_see_what_was_consumed,
        inner_matches_share_facts,
        one_is_true,
        sets_hold_one_for_true,
        failures_are_told_again,
        stale_rules_in_any_order,
        the_time_of_the_first_look,
        one_firing_more,
        newest_of_equals,
        sums_without_end,
        types_without_doubt,
        gone_facts_are_not_remembered,
        deadlines_are_ignored,
        changes_of_jobs_go_unnoticed,
    )
}


SHOWS = {
    "removal_leaves_not_as_it_was": "rule that fires once with not",
    "fires_never_again": "rule that fires once with not",
    "goals_go_unnoticed": "rank decided",
    "ranks_are_ignored": "rank decided",
    "the_oldest_door_again": "rotor decided",
    "deadlines_are_ignored": "urgency decided",
    "changes_of_jobs_go_unnoticed": "urgency decided",
    "the_time_of_the_first_look": "function now",
    "gone_facts_are_not_remembered": "event FinishSeen",
    "stale_rules_in_any_order": "event ExpressionFailed",
    "sums_without_end": "event ExpressionFailed",
}
"""What must be alive in a case that shows a mistake, where that is seldom."""


@contextmanager
def broken(name: str) -> Iterator[None]:
    """Let every interpreter be wrong in the way called `name`."""
    with pytest.MonkeyPatch.context() as patch:
        BREAKS[name](patch)
        yield
