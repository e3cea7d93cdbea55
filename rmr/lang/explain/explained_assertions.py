"""Which actions serve which time assertions, and how: from an action's effect to the finish fact."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from rmr.analysis.backward_chaining import term_of
from rmr.analysis.servers import EarlierStep, EarlierSteps, Passed, Served, Servers, assertion_term
from rmr.bytecode.heads import items
from rmr.bytecode.program import Assertion, Constant, DeriveAction, Derived, Kind, Pattern, Program, Serving
from rmr.lang.explain.texts import PredicateNames, Spot, Texts
from rmr.lang.lower.time_assertions import Watched
from rmr.lang.read.syntax import Expression, Literal

STEPS_MAX = 10_000
"""Largest number of listed steps of all paths from effects to finish facts; of further ones only the number."""


@dataclass(frozen=True, slots=True)
class WayStep:
    """A rule on the way from an action's effect to the finish fact."""

    rule: int
    derives: str


@dataclass(frozen=True, slots=True)
class ServingAction:
    """An action that is held back until the job's robot has its turn."""

    action: str
    """The action with its required arguments; `_` is a wildcard."""
    effect: str
    """The fact that its completion inserts."""
    way: tuple[WayStep, ...]
    """The rules from the effect to the finish fact; empty if the effect is the finish fact."""
    way_left_out: int
    """Number of steps that are not listed."""
    derived_by: tuple[int, ...]
    """The rules that derive such an action."""


@dataclass(frozen=True, slots=True)
class Origin:
    """A fact that leads to a finish fact without any action."""

    fact: str
    rules: tuple[int, ...]
    """The rules that derive it, for this robot or another one."""
    stated: bool
    sensed: bool


@dataclass(frozen=True, slots=True)
class ExplainedAssertion:
    """A time assertion."""

    name: str
    place: Spot
    robot: str
    """The robot that holds its jobs; a variable for every robot."""
    starts_with: str
    ends_with: str
    ends_at: str
    """The robot that has the finish fact."""
    deadline: str
    """The relative deadline with its unit."""
    violation: str
    scheduled: bool
    event: str | None
    """The event (shared resource) of its jobs; None if it is only watched."""
    serving: tuple[ServingAction, ...]
    steps: tuple[str, ...]
    """Actions before the serving ones for which robots take turns, too, the first ones first."""
    origins: tuple[Origin, ...]
    """Without a serving action: the facts that lead to the finish fact, the finish fact first."""
    cut: bool
    """True if the search budget was exhausted."""


class AssertionExplainer:
    """Explains the time assertions of one program."""

    def __init__(self, program: Program, texts: Texts) -> None:
        self._program = program
        self._texts = texts
        self._servers = Servers(program)
        self._left = STEPS_MAX

    def explain(self, watched: Watched, assertion: Assertion) -> ExplainedAssertion:
        """Return what serves an assertion, or where its finish fact comes from if nothing does."""
        item = watched.item
        line = self._texts.line
        home = line(item.start.arguments[0].span)
        owner = line(item.finish.arguments[0].span)
        args = [line(each.span) for each in item.finish.arguments[1:]]
        labels = _Labels(self._program, PredicateNames(watched.environment), home, owner)
        walk = self._servers.walk(assertion)
        serving = walk.served if assertion.scheduled else ()
        first = {each.predicate: each for each in reversed(walk.passed)}
        unserved = [each for each in walk.passed if first[each.predicate] is each] if not serving else []
        # Largest number of listed facts that lead to a finish fact which no action serves.
        return ExplainedAssertion(
            name=assertion.name,
            place=self._texts.spot(item.span),
            robot=home,
            starts_with=line(item.start.span),
            ends_with=line(item.finish.span),
            ends_at=owner,
            deadline=_seconds(item.deadline, line(item.deadline.span)),
            violation=line(item.violation.span),
            scheduled=assertion.scheduled,
            event=_event(assertion.name, args) if serving else None,
            serving=tuple(self._serving(serving, labels)),
            steps=tuple([labels.action(step) for step in EarlierSteps(self._servers, self._program, assertion).found()])
            if serving
            else (),
            origins=tuple([self._origin(each, labels) for each in unserved[:20]]),
            cut=walk.cut,
        )

    def _serving(self, serving: Iterable[Served], labels: "_Labels") -> Iterator[ServingAction]:
        """Yield the serving actions, with their paths cut to the remaining budget of steps."""
        for served in serving:
            way = list(_way(served.effect, labels))
            steps = way[: self._left]
            self._left -= len(steps)
            yield ServingAction(
                action=labels.action(served.serving),
                effect=labels.fact(served.effect),
                way=tuple(steps),
                way_left_out=len(way) - len(steps),
                derived_by=self._derived_by(served.serving),
            )

    def _origin(self, passed: Passed, labels: "_Labels") -> Origin:
        return Origin(
            fact=labels.fact(passed),
            rules=self._servers.deriving(passed),
            stated=any(fact.predicate == passed.predicate for fact in self._program.facts),
            sensed=self._program.predicates[passed.predicate].kind is Kind.SENSED,
        )

    def _derived_by(self, serving: Serving) -> tuple[int, ...]:
        """Return the rules that derive an action of which the arguments may be those that serve."""
        rules = enumerate(self._program.rules)
        return tuple([index for index, rule in rules if any(_may_be(item, serving) for item in items(rule.head))])


@dataclass(frozen=True, slots=True)
class _Labels:
    """Texts of facts and actions with the variable names of one assertion."""

    program: Program
    names: PredicateNames
    home: str
    owner: str
    """The owner of the finish fact."""

    def fact(self, passed: Passed) -> str:
        owner = self.owner if passed.towards is None else self.home
        return self._term(passed.predicate, owner, (assertion_term(arg) for arg in passed.args))

    def action(self, serving: Serving | EarlierStep) -> str:
        return self._term(serving.action, self.home, serving.args)

    def _term(self, predicate: int, owner: str, args: Iterable[Pattern]) -> str:
        name = self.program.predicates[predicate].name
        return f"{name}({', '.join([owner, *map(self.names.term, args)])})"


def _way(passed: Passed, labels: _Labels) -> Iterator[WayStep]:
    """Yield the rules that lead from a fact to the finish fact."""
    while passed.towards is not None:
        assert passed.derivation is not None
        assert passed.derivation.rule is not None
        yield WayStep(passed.derivation.rule, labels.fact(passed.towards))
        passed = passed.towards


def _seconds(deadline: Expression, text: str) -> str:
    """Return a deadline in seconds, with the unit."""
    value = deadline.value if isinstance(deadline, Literal) else None
    return f"{value:g} s" if isinstance(value, int | float) else f"{text} s"


def _event(name: str, args: list[str]) -> str:
    return f"{name}({', '.join(args)})" if args else name


def _may_be(item: Derived, serving: Serving) -> bool:
    """Tell whether what a rule derives may be an action that serves."""
    if not isinstance(item, DeriveAction) or item.predicate != serving.action:
        return False
    pairs = [(term_of(code), arg) for code, arg in zip(item.args, serving.args, strict=True)]
    return not any(isinstance(one, Constant) and isinstance(other, Constant) and one != other for one, other in pairs)
