"""Explanation of rules: what each one needs, derives and sends to other robots.

Of a rule over several robots: its home, what is asked of whom, and what a firing costs.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from rmr.bytecode.program import Base, Kind, Type
from rmr.lang.analyse.fact_size import FACT_OCTETS_MAX, octets
from rmr.lang.checker import Checked
from rmr.lang.explain.texts import Spot, Texts
from rmr.lang.lower.joint_plan import JointClass, JointPlan, RemotePart
from rmr.lang.lower.robot_rules import Projected
from rmr.lang.read.syntax import (
    AggregateNode,
    ComprehensionNode,
    Condition,
    Conjunct,
    Expression,
    FactNode,
    FoldNode,
    Literal,
    Mark,
    PlainHeadItem,
    StepsNode,
    Variable,
    flat,
)

FRAMES = (0, 2, 5, 10)
"""Frames of a firing by the number of robots that decide: offer and answer; for each that reserves the reservation, its
answer and the decision; and if two reserve, for each the word that all know the decision."""


@dataclass(frozen=True, slots=True)
class ExplainedRemote:
    """What a rule asks of another robot."""

    robot: str
    told: bool
    """Whether the robot tells persistent facts; else it decides about an offer."""
    facts: tuple[str, ...]
    """The atoms that the robot matches, `not` included."""
    link: str | None
    """The atom that names the robot; None for a constant, or if the robot is computed."""
    inverted: bool
    """Whether the link is the robot's own fact, which names the home."""
    why: str
    """Why the facts are not told; empty if they are."""


@dataclass(frozen=True, slots=True)
class ExplainedEnsemble:
    """A rule over several robots."""

    place: Spot
    text: str
    home: str
    remotes: tuple[ExplainedRemote, ...]
    frames: int
    """Frames of a firing without loss, acknowledgements and facts of the head for others not counted."""
    frames_told: int
    """Frames for each match that a robot tells."""
    not_home: tuple[tuple[str, str], ...]
    """Other owners, each with why it is not the home."""


def explain_ensemble(plan: JointPlan, texts: Texts) -> ExplainedEnsemble:
    """Explain one rule."""
    return ExplainedEnsemble(
        place=texts.spot(plan.rule.span),
        text=texts.line(plan.rule.span),
        home=texts.line(plan.home.span),
        remotes=tuple([_remote(each, texts) for each in plan.remotes]),
        frames=FRAMES[len(plan.offered)],
        frames_told=int(bool(plan.told)),
        not_home=tuple([(who.strip("`"), why.replace("`", "")) for who, why in plan.others]),
    )


def _remote(part: RemotePart, texts: Texts) -> ExplainedRemote:
    link = part.link or part.inverted
    return ExplainedRemote(
        robot=texts.line(part.owner.span),
        told=part.kind is JointClass.TOLD,
        facts=tuple([texts.line(each.span) for each in (*part.facts, *part.absent)]),
        link=None if link is None else texts.line(link.span),
        inverted=part.link is None and part.inverted is not None,
        why=part.rejected.replace("`", ""),
    )


Constants = dict[str, Literal]
"""Variables that equal a constant."""

ACTION_OCTETS = 8
"""Octets of the number that an action for another robot carries, by which its end is reported."""

_MOST = {Base.ROBOT: 3, Base.INT: 9, Base.FLOAT: 9, Base.BOOL: 1, Base.SYMBOL: 3}
"""Largest encoded size by type, symbols being those that the program names; texts and lists are unbounded."""


@dataclass(frozen=True, slots=True)
class Needs:
    """The facts and conditions of a body, in the order of the text."""

    consumes: tuple[str, ...]
    keeps: tuple[str, ...]
    reads: tuple[str, ...]
    absent: tuple[str, ...]
    conditions: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ExplainedDerivation:
    """A fact, goal or action that a rule derives, or an effect of its action on another robot."""

    what: str
    """``fact``, ``goal``, ``action`` or ``effect``."""
    text: str
    to: str | None
    """The robot to which it is sent; None if it stays at home."""
    octets_min: int | None
    """Least encoded size of its values; None if it stays at home."""
    octets_max: int | None
    """Largest encoded size of its values; None if unbounded, or if it stays at home."""
    octets_room: int | None
    """Octets for values in one frame; None if it stays at home."""
    fits: bool | None
    """Whether one frame holds it; None if that depends on the values, or if it stays at home."""


@dataclass(frozen=True, slots=True)
class ExplainedPart:
    """A part of a head."""

    form: str
    """``item``, ``steps``, ``comprehension``, or the operator of an aggregate."""
    needs: Needs | None
    """The inner body."""
    derives: tuple[ExplainedDerivation, ...]


@dataclass(frozen=True, slots=True)
class ExplainedRule:
    """A rule of one robot."""

    place: Spot
    text: str
    home: str
    """The robot that runs it: a variable for every robot, or a robot."""
    needs: Needs
    head: tuple[ExplainedPart, ...]
    part: bool
    """Whether the compiler has made it of a rule over several robots, whose text it has; then nothing more is said."""


class RuleExplainer:
    """Explains the rules of one program."""

    def __init__(self, checked: Checked, texts: Texts) -> None:
        self._checked = checked
        self._texts = texts
        self._joint = {plan.rule.span for plan in checked.ensemble.plans}

    def explain(self, projected: Projected) -> ExplainedRule:
        """Return what a rule needs and derives."""
        rule = projected.rule
        home = next(each.owner for each in rule.body if isinstance(each, FactNode) and not each.absent)
        assert home is not None
        known = projected.environment.constants
        part = rule.span in self._joint
        return ExplainedRule(
            place=self._texts.spot(rule.span),
            text=self._texts.line(rule.span),
            home="" if part else self._texts.line(home.span),
            needs=self._needs(() if part else rule.body),
            head=() if part else tuple([self._part(each, home, known) for each in flat(rule.head)]),
            part=part,
        )

    def _needs(self, body: Iterable[Conjunct]) -> Needs:
        said: dict[str, list[str]] = {"consumes": [], "keeps": [], "reads": [], "absent": [], "conditions": []}
        for each in body:
            said[self._use(each)].append(self._texts.line(each.span).removeprefix("not ").lstrip("$!"))
        return Needs(**{use: tuple(texts) for use, texts in said.items()})

    def _use(self, conjunct: Conjunct) -> str:
        if isinstance(conjunct, Condition | FoldNode):
            return "conditions"
        if conjunct.absent:
            return "absent"
        if self._checked.names.of(conjunct).kind is not Kind.TEMPORARY or conjunct.mark is Mark.GOAL:
            return "reads"
        return "keeps" if conjunct.mark is Mark.KEEP else "consumes"

    def _part(self, part: PlainHeadItem, home: Expression, known: Constants) -> ExplainedPart:
        match part:
            case FactNode():
                return ExplainedPart("item", None, self._all((part,), home, known))
            case StepsNode(derived=facts):
                return ExplainedPart("steps", None, self._all(facts, home, known))
            case ComprehensionNode(body=body, head=facts):
                return ExplainedPart("comprehension", self._needs(body), self._all(facts, home, known))
            case AggregateNode(operator=operator, body=body, head=facts):
                return ExplainedPart(operator.text, self._needs(body), self._all(facts, home, known))

    def _all(self, facts: Iterable[FactNode], home: Expression, known: Constants) -> tuple[ExplainedDerivation, ...]:
        return tuple([each for fact in facts for each in self._derived(fact, home, known)])

    def _derived(self, fact: FactNode, home: Expression, known: Constants) -> Iterator[ExplainedDerivation]:
        """Yield what a fact of a head is, and what its action brings about at other robots."""
        owner, *arguments = fact.arguments
        action = self._checked.names.of(fact).kind is Kind.ACTION
        what = "action" if action else "goal" if fact.mark is Mark.GOAL else "fact"
        text = self._texts.line(fact.span)
        if fact.absent:
            what = "withdrawal"
            text = text.removeprefix("not").lstrip()
        if _is_same(owner, home):
            yield ExplainedDerivation(what, text, None, None, None, None, None)
        else:
            yield self._sent(what, text, self._texts.line(owner.span), fact, arguments, known)
        if action:
            yield from self._effects(fact, known)

    def _effects(self, fact: FactNode, known: Constants) -> Iterator[ExplainedDerivation]:
        """Yield the effects of an action on other robots than its executor."""
        declaration = self._checked.names.of(fact).declaration
        if declaration is None:
            return
        given: dict[str, Expression] = {}
        for parameter, argument in zip(declaration.parameters, fact.arguments, strict=True):
            if parameter.variable is not None:
                given[parameter.variable.name] = argument
        for effect in declaration.effects:
            terms = [given.get(each.name, each) if isinstance(each, Variable) else each for each in effect.arguments]
            owner, *arguments = terms
            if _is_same(owner, fact.arguments[0]):
                continue
            to, *texts = [self._texts.line(each.span) for each in (owner, *arguments)]
            text = f"{effect.name.text}({', '.join([to, *texts])})"
            yield self._sent("effect", text, to, effect, arguments, known)

    def _sent(
        self, what: str, text: str, to: str, fact: FactNode, arguments: list[Expression], known: Constants
    ) -> ExplainedDerivation:
        pairs = list(zip(arguments, self._checked.types.arguments(fact.name.text), strict=True))
        least = sum(octets(argument, kind, known) for argument, kind in pairs)
        sizes = [_most(argument, kind, known) for argument, kind in pairs]
        bounded = [each for each in sizes if each is not None]
        most = sum(bounded) if len(bounded) == len(sizes) else None
        room = FACT_OCTETS_MAX - (ACTION_OCTETS if what == "action" else 0)
        fits = True if most is not None and most <= room else False if least > room else None
        return ExplainedDerivation(what, text, to, least, most, room, fits)


def _most(argument: Expression, kind: Type, known: Constants) -> int | None:
    """Return the largest encoded size of an argument, None if it is unbounded."""
    value = known.get(argument.name) if isinstance(argument, Variable) else argument
    return octets(value, kind, known) if isinstance(value, Literal) else _MOST.get(kind.base)


def _is_same(one: Expression, other: Expression) -> bool:
    """Tell whether two robots are certainly the same."""
    if isinstance(one, Literal) and isinstance(other, Literal):
        return one.value == other.value
    return isinstance(one, Variable) and isinstance(other, Variable) and one.name == other.name != "_"
