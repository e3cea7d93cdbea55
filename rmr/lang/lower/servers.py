"""The actions that serve a time assertion: backward chaining from the finish fact to the actions in front of it.

While a job has no turn, the actions that lead to its finish fact are held back. The search goes backwards from that
fact, through the rules that derive it, to the first actions whose declared effects lead there: the last step towards
the goal, not its preparation. An argument is a constant, a variable of the start fact, or a wildcard. Only rules and
actions of the job's own robot count, because it cannot hold back those of others. If the finish fact belongs to
another robot, the search begins with the facts that the job's robot sends to it.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

from rmr.analysis.backward_chaining import (
    HOME,
    Backwards,
    Derivation,
    Patterns,
    Wanted,
    brings,
    derived_by,
    numbered,
    premises,
    resolved,
    term_of,
    unifier,
)
from rmr.base.values import Robot
from rmr.bytecode.program import ANY, Assertion, Constant, Effect, Pattern, Program, Serving, Slot

STEPS_MAX = 2000
"""Search budget for one assertion, in facts; the patterns are finitely many, but may be very many."""


class Passed(NamedTuple):
    """A node of the search: a fact that leads to the finish fact."""

    predicate: int
    args: Patterns
    """Arguments; negative slots are the variables of the start fact, which are given."""
    derivation: Derivation | None
    """The derivation of `towards` that needs this fact; None for the finish fact itself."""
    towards: "Passed | None"
    """The next fact on the path to the finish fact; None for the finish fact itself."""


class Served(NamedTuple):
    """An action that serves an assertion."""

    serving: Serving
    effect: Passed
    """The effect of the action, on a shortest path to the finish fact."""


class Walk(NamedTuple):
    """The result of the search from an assertion's finish fact."""

    served: tuple[Served, ...]
    passed: tuple[Passed, ...]
    """The finish fact, and facts that lead there without an action in between, in the order of distance."""
    cut: bool
    """True if the search budget was exhausted."""


def with_serving(program: Program) -> Program:
    """Return `program` with the actions that serve each scheduled assertion."""
    if not any(each.scheduled for each in program.assertions):
        return program
    servers = Servers(program)
    assertions = [
        replace(each, serving=tuple([served.serving for served in servers.walk(each).served]))
        if each.scheduled
        else each
        for each in program.assertions
    ]
    return replace(program, assertions=tuple(assertions))


class Servers:
    """The derivations by rules and by declared effects of one program, indexed for the search."""

    def __init__(self, program: Program) -> None:
        self._backwards = Backwards(program)
        self._effects: dict[int, list[Derivation]] = {}
        """Effects on the executor, by predicate."""
        self._given: dict[int, list[Derivation]] = {}
        """Effects on other robots, by predicate; the owner precedes the arguments."""
        self._sent: dict[int, list[Derivation]] = {}
        """Facts that rules send to other robots, by predicate; the owner precedes the arguments."""
        for index, predicate in enumerate(program.predicates):
            for effect in predicate.effects:
                self._declared(index, len(predicate.types), effect)
        for index, rule in enumerate(program.rules):
            for brought in brings(rule, program):
                if brought.action is None and resolved(brought.owner, brought.known) != HOME:
                    derivation = derived_by(index, brought, brought.known, (brought.owner, *brought.args))
                    self._sent.setdefault(brought.predicate, []).append(derivation)

    def walk(self, assertion: Assertion) -> Walk:
        """Search backwards from the finish fact of `assertion`, breadth first, so that paths are shortest."""
        robot = None if assertion.robot is None else Robot(assertion.robot)
        owner, *args = asked(assertion)
        start = Passed(assertion.finish.predicate, tuple(args), None, None)
        passed: dict[Wanted, Passed] = {(start.predicate, start.args): start}
        served: dict[Serving, Served] = {}
        queue = deque([start])
        while queue and len(passed) < STEPS_MAX:
            here = queue.popleft()
            # Only the finish fact may be another robot's: then what counts is what this robot sends there.
            away = here is start and owner != HOME and owner != (None if robot is None else Constant(robot))
            wanted = (owner, *args) if away else here.args
            for derivation in (self._given if away else self._effects).get(here.predicate, ()):
                for action, patterns in premises(wanted, derivation, robot):
                    serving = Serving(action, tuple([assertion_term(each) for each in patterns]))
                    served.setdefault(serving, Served(serving, here))
            for derivation in self._rules(here, away):
                for predicate, patterns in premises(wanted, derivation, robot):
                    if (predicate, patterns) not in passed:
                        earlier = passed[predicate, patterns] = Passed(predicate, patterns, derivation, here)
                        queue.append(earlier)
        return Walk(tuple(served.values()), tuple(passed.values()), bool(queue))

    def deriving(self, fact: Passed) -> tuple[int, ...]:
        """Return the rules that may derive such a fact, for their own robot or for another one."""
        home = (each for each in self._backwards.deriving(fact.predicate, fact.args) if each.action is None)
        ways = [each for each in home if unifier(fact.args, each) is not None]
        ways += [each for each in self._sent.get(fact.predicate, ()) if unifier((ANY, *fact.args), each) is not None]
        return tuple(sorted(dict.fromkeys([each.rule for each in ways if each.rule is not None])))

    def _rules(self, here: Passed, away: bool) -> Iterable[Derivation]:
        """Return the derivations of a fact by rules alone, without an action in between."""
        if away:
            return self._sent.get(here.predicate, ())
        return (each for each in self._backwards.deriving(here.predicate, here.args) if each.action is None)

    def _declared(self, action: int, arity: int, effect: Effect) -> None:
        """Index an effect as a derivation with the action as its premise."""
        owner = term_of(effect.owner)
        args = tuple([term_of(code) for code in effect.args])
        needed = ((action, tuple([Slot(1 + index) for index in range(arity)])),)
        filed, derives = (self._effects, args) if owner == HOME else (self._given, (owner, *args))
        filed.setdefault(effect.predicate, []).append(Derivation(None, action, HOME, derives, needed))


def asked(assertion: Assertion) -> Patterns:
    """Return the owner and the arguments of the finish fact; variables of the start fact become negative slots."""
    bound = [each.index for each in assertion.start.args if isinstance(each, Slot)]
    terms = (assertion.finisher, *assertion.finish.args)
    return numbered([Slot(-each.index) if isinstance(each, Slot) and each.index in bound else each for each in terms])


def assertion_term(term: Pattern) -> Pattern:
    """Return a term of the search in the slots of the assertion; a variable that it does not bind is a wildcard."""
    if not isinstance(term, Slot):
        return term
    return Slot(-term.index) if term.index <= 0 else ANY
