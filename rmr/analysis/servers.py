"""The actions that serve a time assertion: backward chaining from the finish fact to the actions in front of it.

While a job has no turn, the actions that lead to its finish fact are held back. The search goes backwards from that
fact, through the rules that derive it, to the first actions whose declared effects lead there: the last step towards
the goal, not its preparation. An argument is a constant, a variable of the start fact, or a wildcard. Only rules and
actions of the job's own robot count, because it cannot hold back those of others. If the finish fact belongs to
another robot, the search begins with the facts that the job's robot sends to it.

Behind those actions lie the job's earlier *steps*: the search goes on through the rules that derive them, and through
the chains (``then``) in which they come later, as far as what can follow from the start fact or is derived with it.
An action of the program's own that has a declared effect is a step for which robots take turns. What every robot
provides (drives, `wait`) is none: there the floor says what robots share.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

from rmr.analysis.backward_chaining import (
    HOME,
    Backwards,
    Derivation,
    Patterns,
    Unifier,
    Wanted,
    brings,
    derived_by,
    numbered,
    premises,
    resolved,
    term_of,
    unified,
    unifier,
    value_key,
)
from rmr.base.identity import ByIdentity
from rmr.base.values import Robot
from rmr.bytecode.heads import bodies, items
from rmr.bytecode.program import (
    ANY,
    Assertion,
    Atom,
    Constant,
    DeriveAction,
    DeriveFact,
    Effect,
    Mode,
    Pattern,
    Program,
    Rule,
    Serving,
    Slot,
    Steps,
    When,
)
from rmr.bytecode.provided import ACTIONS

STEPS_MAX = 2000
"""Search budget for one assertion, in facts; the patterns are finitely many, but may be very many."""
TURNS_MAX = 8
"""Earlier steps with turns, those nearest to the finish: a robot asks for all of them at once."""


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


class EarlierStep(NamedTuple):
    """An action on the way to the serving ones, for which robots take turns, too."""

    action: int
    args: Patterns
    """Patterns over the start fact's slots."""
    later: int
    """How many steps with turns follow it, the serving action included."""


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
        self._to_others: dict[int, list[Derivation]] = {}
        """Facts that rules, or their actions, bring other robots, by predicate; the owner precedes the arguments."""
        for index, predicate in enumerate(program.predicates):
            for effect in predicate.effects:
                self._declared(index, len(predicate.types), effect)
        for index, rule in enumerate(program.rules):
            for brought in brings(rule, program):
                if resolved(brought.owner, brought.known) != HOME:
                    derivation = derived_by(index, brought, brought.known, (brought.owner, *brought.args))
                    self._to_others.setdefault(brought.predicate, []).append(derivation)

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
            for derivation in self.effects(here.predicate, away):
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
        ways = [
            each
            for away in (False, True)
            for each in self.ways(fact.predicate, fact.args, away)
            if each.action is None and unifier((ANY, *fact.args) if away else fact.args, each) is not None
        ]
        return tuple(sorted(dict.fromkeys([each.rule for each in ways if each.rule is not None])))

    def ways(self, predicate: int, args: Patterns, away: bool) -> Iterator[Derivation]:
        """Yield the derivations of a fact by rules, actions of theirs included; `away`: of one of another robot.

        Then its owner precedes the arguments.
        """
        return iter(self._to_others.get(predicate, ())) if away else self._backwards.deriving(predicate, args)

    def effects(self, predicate: int, away: bool) -> Iterable[Derivation]:
        """Return the declared effects of actions on a predicate; `away`: those on other robots."""
        return (self._given if away else self._effects).get(predicate, ())

    def _rules(self, here: Passed, away: bool) -> Iterable[Derivation]:
        """Return the derivations of a fact by rules alone, without an action in between."""
        return (each for each in self.ways(here.predicate, here.args, away) if each.action is None)

    def _declared(self, action: int, arity: int, effect: Effect) -> None:
        """Index an effect as a derivation with the action as its premise."""
        owner = term_of(effect.owner)
        args = tuple([term_of(code) for code in effect.args])
        needed = ((action, tuple([Slot(1 + index) for index in range(arity)])),)
        filed, derives = (self._effects, args) if owner == HOME else (self._given, (owner, *args))
        filed.setdefault(effect.predicate, []).append(Derivation(None, action, HOME, derives, needed))


class EarlierSteps:
    """The search on backwards behind the actions that serve an assertion."""

    def __init__(self, servers: Servers, program: Program, assertion: Assertion) -> None:
        self._servers = servers
        self._program = program
        self._assertion = assertion
        self._robot = None if assertion.robot is None else Robot(assertion.robot)
        self._after = followers(program, assertion)
        self._last = [(each.action, each.args) for each in assertion.serving]
        self._found: dict[tuple[int, Patterns], int] = {}
        """How many steps with turns follow an action at most."""
        self._queue: deque[tuple[int, Wanted, tuple[Wanted, ...]]] = deque()
        """Facts to be looked at, each with the number of steps that follow and the facts on the way to the finish."""

    def found(self) -> tuple[EarlierStep, ...]:
        """Return the earlier steps, the first ones first."""
        finish = self._assertion.finish.predicate
        owner, *args = asked(self._assertion)
        away = owner != HOME and owner != (None if self._robot is None else Constant(self._robot))
        self._look(0, (finish, (owner, *args) if away else tuple(args)), (), away)
        seen: dict[Wanted, int] = {}
        while self._queue and len(seen) < STEPS_MAX:
            later, wanted, way = self._queue.popleft()
            # What two later steps need comes before both: the longest way counts.
            if later > seen.get(wanted, -1):
                seen[wanted] = later
                self._look(later, wanted, way)
        kept: dict[tuple[int, Patterns], int] = {}
        # Of patterns of one action that overlap the one that says most counts, and the longest way.
        for step, later in sorted(self._found.items(), key=lambda each: each[0][1].count(ANY)):
            same = next((other for other in kept if _may_be(step, other)), step)
            kept[same] = max(later, kept.get(same, 0))
        nearest = sorted(kept.items(), key=lambda each: each[1])[:TURNS_MAX]
        return tuple([EarlierStep(action, args, later) for (action, args), later in reversed(nearest)])

    def _look(self, later: int, wanted: Wanted, way: tuple[Wanted, ...], away: bool = False) -> None:
        """Look for what brings a fact; `later` steps with turns follow, by the facts of `way`."""
        predicate, args = wanted
        for effect in self._servers.effects(predicate, away) if later else ():
            for action, patterns in premises(args, effect, self._robot):
                self._note(later, action, tuple([assertion_term(each) for each in patterns]))
        start, finish = self._assertion.start.predicate, self._assertion.finish.predicate
        for derivation in self._servers.ways(predicate, args, away):
            rule = None if derivation.rule is None else self._program.rules[derivation.rule]
            known = unifier(args, derivation, self._robot)
            # A firing that derives the finish fact ends the job: what else it derives comes after that.
            if rule is None or known is None or (predicate != finish and _derives(rule, finish)):
                continue
            by = derivation.action
            deeper = later + (by is not None and (later == 0 or self._has_turns(by)))
            known = _with_start(rule, known, self._assertion)
            for earlier, patterns in _before(rule, predicate if by is None else by, known):
                deeper += self._note(deeper, earlier, patterns)
            if not _derives(rule, start):  # else what its body needs is there before the job starts
                for premise in premises(args, derivation, self._robot):
                    on = premise[0] in self._after and premise[0] not in (start, finish) and premise not in way
                    if on and deeper <= TURNS_MAX:
                        self._queue.append((deeper, premise, (*way, wanted)))

    def _note(self, later: int, action: int, args: Patterns) -> bool:
        """Note an action on the way, and return whether it is a step with turns that does not serve the job itself."""
        serves = any(_may_be((action, args), other) for other in self._last)
        counts = not serves and self._has_turns(action) and action in self._after
        if counts and later:
            self._found[action, args] = max(later, self._found.get((action, args), 0))
        return counts

    def _has_turns(self, action: int) -> bool:
        """Return whether robots take turns for an action on the way."""
        predicate = self._program.predicates[action]
        return bool(predicate.effects) and predicate.name not in ACTIONS


def _may_be(one: tuple[int, Patterns], other: tuple[int, Patterns]) -> bool:
    """Return whether an action may match both patterns."""
    pairs = zip(one[1], other[1], strict=False)
    return one[0] == other[0] and not any(
        isinstance(a, Constant) and isinstance(b, Constant) and value_key(a.value) != value_key(b.value)
        for a, b in pairs
    )


def _derives(rule: Rule, predicate: int) -> bool:
    return any(item.predicate == predicate for item in items(rule.head))


def _with_start(rule: Rule, known: Unifier, assertion: Assertion) -> Unifier:
    """Return `known` with what a rule that reads or derives the start fact says of the values that it binds."""
    start = assertion.start
    atoms = [each.args for each in rule.body if isinstance(each, Atom) and each.predicate == start.predicate]
    heads = [
        tuple([term_of(code) for code in item.args])
        for item in items(rule.head)
        if isinstance(item, DeriveFact) and item.predicate == start.predicate
    ]
    if len(atoms) + len(heads) != 1:
        return known
    found = dict(known)
    for one, given in zip((atoms or heads)[0], start.args, strict=True):
        if isinstance(given, Slot) and not unified(one, Slot(-given.index), found):
            return known
    return found


def _before(rule: Rule, derived: int, known: Unifier) -> Iterator[tuple[int, Patterns]]:
    """Yield the actions before what is `derived` in a chain (``then``) of `rule`, the nearest first."""
    for part in rule.head:
        chain = part.item if isinstance(part, When) else part
        if not isinstance(chain, Steps):
            continue
        place = max([index for index, each in enumerate(chain.steps) if each.predicate == derived], default=0)
        for each in reversed(chain.steps[:place]):
            if isinstance(each, DeriveAction) and resolved(term_of(each.owner), known) == resolved(HOME, known):
                args = numbered([resolved(term_of(code), known) for code in each.args])
                yield each.predicate, tuple([assertion_term(arg) for arg in args])


def siblings(program: Program, assertion: Assertion) -> tuple[int, ...]:
    """Return the predicates of the start fact and of what is derived in the very firing that starts a job."""
    start = assertion.start.predicate
    heads = [item.predicate for rule in program.rules if _derives(rule, start) for item in items(rule.head)]
    return tuple(dict.fromkeys([start, *heads]))


def followers(program: Program, assertion: Assertion) -> set[int]:
    """Return the predicates that can follow from the start of a job up to its finish fact."""
    finish = assertion.finish.predicate
    found = set(siblings(program, assertion))
    queue = list(found)
    for here in queue:
        if here == finish != assertion.start.predicate:
            continue
        predicate = program.predicates[here]
        heads = [each.predicate for each in (*predicate.effects, *predicate.else_effects)]
        for rule in program.rules:
            if here in _needed(rule):
                heads += [item.predicate for item in items(rule.head)]
        queue += [each for each in dict.fromkeys(heads) if each not in found]
        found.update(heads)
    return found


def _needed(rule: Rule) -> set[int]:
    """Return the predicates of the facts that a rule needs."""
    atoms = (one for body in bodies(rule) for one in body if isinstance(one, Atom))
    return {atom.predicate for atom in atoms if atom.mode is not Mode.ABSENT}


def _steps(program: Program) -> tuple[tuple[EarlierStep, ...], ...]:
    if not any(each.serving for each in program.assertions):
        return tuple(() for _ in program.assertions)
    servers = Servers(program)
    return tuple(EarlierSteps(servers, program, each).found() if each.serving else () for each in program.assertions)


steps_of: ByIdentity[Program, tuple[tuple[EarlierStep, ...], ...]] = ByIdentity(_steps)
"""Returns the earlier steps of each assertion of a program, the same for all robots of a process."""


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
