"""Rules over several robots: which robot is home, and what is asked of whom (the plan of a rewriting).

A body may name facts of several owners. The *home* is an owner that knows all the others from its own facts: each is
an argument of one of them (a *link*), a constant, or a value computed from them. A persistent link may also be read
backwards: its owner tells the home of it.

The other owners are *remote*, each of one class. TOLD: the remote atoms are persistent; the remote tells the home each
match once, and the home joins its copies. OFFERED: atoms that are consumed, kept, sensed or negated; the home sets its
own facts aside and the remote decides. `ensemble_rules` makes rules of one robot of a plan.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from rmr.bytecode.program import Kind
from rmr.lang.analyse.names import Names
from rmr.lang.diagnostics.diagnostic import DiagnosticNote, Diagnostics
from rmr.lang.lower.joint_plan import (
    JointClass,
    JointPlan,
    RemotePart,
    called,
    known_from,
    names_in,
    owners_of,
    same_owner,
)
from rmr.lang.read.syntax import (
    Condition,
    Expression,
    FactNode,
    FoldNode,
    Literal,
    Mark,
    RuleItem,
    Variable,
)

OFFERED_MAX = 3
"""Largest number of remote robots in one rule whose facts are consumed, kept, sensed or negated."""


@dataclass(slots=True)
class _Candidate:
    """An owner as the home."""

    owner: Variable | Literal
    place: int
    inverted: dict[int, FactNode] = field(default_factory=dict)
    """By owner, the atom that names this one."""
    missing: list[int] = field(default_factory=list)


class JointPlanner:
    """Plans the rules over several robots of one program."""

    def __init__(self, names: Names, found: Diagnostics) -> None:
        self._names = names
        self._found = found

    def plan(self, rule: RuleItem) -> JointPlan | None:
        """Return the plan of a rule whose positive atoms have several owners, or None after reporting why not.

        Each owner has a name (`with_named_owners`).
        """
        owners = owners_of(rule)
        positive = [each for each in rule.body if isinstance(each, FactNode) and not each.absent]
        groups = [[fact for fact in positive if same_owner(fact.owner, owner)] for owner in owners]
        conditions = [each for each in rule.body if isinstance(each, Condition)]
        candidates = [self._candidate(place, owners, groups, conditions) for place in range(len(owners))]
        direct = [each for each in candidates if not each.missing and not each.inverted]
        usable = direct or [each for each in candidates if not each.missing]
        if not usable:
            self._report_missing(rule, owners, groups, conditions)
            return None
        if not self._are_owned(rule, owners):
            return None
        plans = [self._plan(rule, each, owners, groups, conditions) for each in usable]
        first = next((fact.owner for fact in rule.head if isinstance(fact, FactNode)), None)
        best = min(
            range(len(plans)),
            key=lambda i: (len(plans[i].offered), not same_owner(plans[i].home, first), usable[i].place),
        )
        plan = plans[best]
        others = tuple(self._why_not(candidates, plans, usable, best, first))
        plan = replace(plan, others=others)
        return plan if self._is_possible(plan) else None

    def home(self, rule: RuleItem) -> Variable | Literal | None:
        """Return an owner that reaches all the others, the first item's of the head if it does; None: no owner does."""
        owners = owners_of(rule)
        positive = [each for each in rule.body if isinstance(each, FactNode) and not each.absent]
        groups = [[fact for fact in positive if same_owner(fact.owner, owner)] for owner in owners]
        conditions = [each for each in rule.body if isinstance(each, Condition)]
        candidates = [self._candidate(place, owners, groups, conditions) for place in range(len(owners))]
        usable = [each.owner for each in candidates if not each.missing and not each.inverted]
        usable = usable or [each.owner for each in candidates if not each.missing]
        first = next((fact.owner for fact in rule.head if isinstance(fact, FactNode)), None)
        return min(usable, key=lambda owner: not same_owner(owner, first), default=None)

    def _candidate(
        self,
        place: int,
        owners: Sequence[Variable | Literal],
        groups: Sequence[Sequence[FactNode]],
        conditions: Sequence[Condition],
    ) -> _Candidate:
        """Return how the owner at `place` reaches the others."""
        home = owners[place]
        candidate = _Candidate(home, place)
        known = known_from(groups[place], conditions)
        for other, owner in enumerate(owners):
            if other == place or isinstance(owner, Literal) or owner.name in known:
                continue
            backwards = [
                fact
                for fact in groups[other]
                if self._kind(fact) is Kind.PERSISTENT
                and any(same_owner(argument, home) for argument in self._lasting(fact))
            ]
            if backwards:
                candidate.inverted[other] = backwards[0]
            else:
                candidate.missing.append(other)
        return candidate

    def _lasting(self, fact: FactNode) -> Sequence[Expression]:
        """Return the arguments of a persistent fact that no better one changes, the owner not among them."""
        best = self._names.of(fact).best
        return fact.arguments[1:] if best is None else fact.arguments[1 : 1 + best.argument]

    def _kind(self, fact: FactNode) -> Kind:
        # The open goals of a predicate come and go like sensed facts.
        return Kind.SENSED if fact.mark is Mark.GOAL else self._names.of(fact).kind

    def _plan(
        self,
        rule: RuleItem,
        candidate: _Candidate,
        owners: Sequence[Variable | Literal],
        groups: Sequence[Sequence[FactNode]],
        conditions: Sequence[Condition],
    ) -> JointPlan:
        home = candidate.owner
        absent = [each for each in rule.body if isinstance(each, FactNode) and each.absent]
        remotes = []
        for place, owner in enumerate(owners):
            if place == candidate.place:
                continue
            own = tuple(fact for fact in absent if same_owner(fact.owner, owner))
            rejected = self._not_told(groups[place], own)
            kind = JointClass.TOLD if rejected is None else JointClass.OFFERED
            named = [
                fact for fact in groups[candidate.place] if any(same_owner(each, owner) for each in fact.arguments[1:])
            ]
            link = named[0] if named else None
            inverted = candidate.inverted.get(place)
            remotes.append(RemotePart(owner, kind, tuple(groups[place]), own, link, inverted, rejected or ""))
        return JointPlan(
            rule,
            home,
            tuple(groups[candidate.place]),
            tuple(fact for fact in absent if same_owner(fact.owner, home)),
            tuple(each for each in rule.body if isinstance(each, FoldNode)),
            tuple(conditions),
            tuple(remotes),
        )

    def _not_told(self, facts: Sequence[FactNode], absent: Sequence[FactNode]) -> str | None:
        """Return why a remote part cannot be told once for all, or None if it can."""
        if absent:
            return "`not`"
        for fact in facts:
            if self._kind(fact) is not Kind.PERSISTENT:
                return f"`{fact.name.text}` is {self._kind(fact).name.lower()}"
        best = [fact for fact in facts if self._names.of(fact).best is not None]
        if best and len(facts) > 1:
            return f"only the best `{best[0].name.text}` is kept"
        return None

    # ---- what cannot be

    def _report_missing(
        self,
        rule: RuleItem,
        owners: Sequence[Variable | Literal],
        groups: Sequence[Sequence[FactNode]],
        conditions: Sequence[Condition],
    ) -> None:
        """Report the link that is missing, or the chain of links that leads over another robot."""
        for place, home in enumerate(owners):
            via = self._chain(place, owners, groups, conditions)
            if via is None:
                continue
            middle, last = (owners[each] for each in via)
            message = f"{called(last)} is reached only through {called(middle)}; {called(home)} need not hear it"
            hint = (
                f"let {called(middle)} tell {called(home)} of it first: `... -o !far({_plain(home)}, {_plain(last)})`"
            )
            behind = (DiagnosticNote(groups[via[1]][0].span, f"a fact of {called(last)}"),)
            self._found.report("E037", message, rule.span, hint=hint, notes=behind)
            return
        candidate = self._candidate(0, owners, groups, conditions)
        home = owners[0]
        other = owners[candidate.missing[0]]
        notes = tuple(
            DiagnosticNote(group[0].span, f"a fact of {called(owner)}")
            for owner, group in zip(owners, groups, strict=True)
        )
        who = "one robot" if called(home) == called(other) else called(home)
        message = f"nothing in the body leads from {who} to {called(other)}"
        one = _plain(home, "A")
        two = _plain(other, "B")
        hint = f"add a link, a fact of {who} that names the other: `peer({one}, {two})` or "
        hint += f"`neighbor({one}, {two})`"
        self._found.report("E035", message, rule.span, hint=hint, notes=notes)

    def _chain(
        self,
        place: int,
        owners: Sequence[Variable | Literal],
        groups: Sequence[Sequence[FactNode]],
        conditions: Sequence[Condition],
    ) -> tuple[int, int] | None:
        """Return the robot in the middle and the one behind it, if links of remotes reach what the home cannot."""
        reached = {place}
        facts = list(groups[place])
        found: tuple[int, int] | None = None
        grown = True
        while grown:
            grown = False
            for middle in sorted(reached):
                known = known_from(groups[middle], conditions)
                for other, owner in enumerate(owners):
                    if other not in reached and (isinstance(owner, Literal) or owner.name in known):
                        reached.add(other)
                        facts += groups[other]
                        found = (middle, other) if middle != place and found is None else found
                        grown = True
        return found if len(reached) == len(owners) else None

    def _are_owned(self, rule: RuleItem, owners: Sequence[Variable | Literal]) -> bool:
        """Whether each `not` asks a robot of the rule; others are reported."""
        good = True
        for fact in rule.body:
            absent = isinstance(fact, FactNode) and fact.absent
            if isinstance(fact, FactNode) and absent and not any(same_owner(fact.owner, each) for each in owners):
                message = "`not` may name the facts of a robot that the rule has a fact of"
                self._found.report("E033", message, fact.span, hint="add a fact of that robot, or a link to it")
                good = False
        return good

    def _is_possible(self, plan: JointPlan) -> bool:
        """Whether the plan can be carried out; else the reason is reported."""
        if len(plan.offered) > OFFERED_MAX:
            *others, final = [called(each.owner) for each in plan.offered]
            who = f"{', '.join(others)} and {final}"
            message = f"facts of {who} would have to be used up, or looked at, at one instant with those of "
            message += called(plan.home)
            hint = (
                f"facts of {OFFERED_MAX} other robots may be used up; let the others tell theirs, as persistent facts"
            )
            notes = tuple(
                DiagnosticNote(each.facts[0].span, f"a fact of {called(each.owner)}") for each in plan.offered
            )
            self._found.report("E039", message, plan.rule.span, hint=hint, notes=notes)
            return False
        good = self._folds_at_home(plan) and self._uses_something(plan)
        return self._tests_at_home(plan) and good

    def _uses_something(self, plan: JointPlan) -> bool:
        """Whether a rule that another robot decides consumes a fact; else it would fire again and again."""
        facts = (*plan.facts, *[fact for each in plan.offered for fact in each.facts])
        consuming = [
            fact for fact in facts if self._kind(fact) is Kind.TEMPORARY and fact.mark in {Mark.NONE, Mark.BANG}
        ]
        if not plan.offered or consuming:
            return True
        who = called(plan.offered[0].owner)
        message = f"this rule over several robots uses nothing up, and the facts of {who} come and go"
        hint = f"let {who} tell {called(plan.home)} by a fact when they change"
        hint += next((words for fact in plan.offered[0].facts if (words := self._names.sharing(fact))), "")
        self._found.report("E041", message, plan.rule.span, hint=hint)
        return False

    def _folds_at_home(self, plan: JointPlan) -> bool:
        good = True
        for fold in plan.folds:
            what = "`not` of several conjuncts" if fold.result is None else f"`{fold.operator.text}`"
            for fact in fold.body:
                if isinstance(fact, FactNode) and not same_owner(fact.owner, plan.home):
                    message = f"{what} may name the facts of the rule's home robot only"
                    hint = f"the rule's home robot is {called(plan.home)}; let the other robot tell it"
                    hint += self._names.sharing(fact)
                    self._found.report("E033", message, fact.span, hint=hint)
                    good = False
        return good

    def _tests_at_home(self, plan: JointPlan) -> bool:
        """Whether the `not` and the aggregates of the home use values that it knows before the remote decides."""
        if not plan.offered:
            return True
        told = [fact for each in plan.told for fact in each.facts]
        known = known_from((*plan.facts, *told), plan.conditions)
        known.update(fold.result.name for fold in plan.folds if fold.result is not None)
        theirs = known_from([fact for each in plan.offered for fact in each.facts], plan.conditions)
        good = True
        tests: tuple[FactNode | FoldNode, ...] = (*plan.absent, *plan.folds)
        for test in tests:
            lacking = [name for name in names_in(test) if name not in known and name in theirs]
            if lacking:
                message = f"{called(plan.home)} tests this before {called(plan.offered[0].owner)} has chosen "
                message += f"`{lacking[0]}`"
                hint = f"use values of {called(plan.home)} alone here, or make another robot the home"
                self._found.report("E040", message, test.span, hint=hint)
                good = False
        return good

    # ---- the choice, in words

    @staticmethod
    def _why_not(
        candidates: Sequence[_Candidate],
        plans: Sequence[JointPlan],
        usable: Sequence[_Candidate],
        best: int,
        first: Expression | None,
    ) -> Iterator[tuple[str, str]]:
        """Yield the owners that are not home, with the reason."""
        chosen = plans[best]
        for candidate in candidates:
            who = called(candidate.owner)
            if candidate.place == usable[best].place:
                continue
            if candidate.missing:
                yield who, f"nothing leads from it to {called(candidates[candidate.missing[0]].owner)}"
            elif candidate not in usable:
                yield who, "its link would have to be read backwards"
            else:
                plan = plans[list(usable).index(candidate)]
                if len(plan.offered) > len(chosen.offered):
                    yield who, "more robots would have to decide"
                elif same_owner(chosen.home, first):
                    yield who, f"the head begins at {called(chosen.home)}"
                else:
                    yield who, f"{called(chosen.home)} comes first in the text"


def _plain(owner: Variable | Literal, anonymous: str = "R") -> str:
    return called(owner).strip("`") if called(owner).startswith("`") else anonymous
