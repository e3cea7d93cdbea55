"""Shared facts (`type shared p(...)`) of other robots, read where the rule is: as what the home has heard of them.

Each robot tells its neighbours which facts of a shared predicate it holds (`rmr.node.logic.shared_facts`). What it has
heard is a sensed fact of its own, with the other robot as the first argument: in `neighbor(R, N), dist(N, D)` the atom
`dist(N, D)` becomes `heard(R, N, D)`. So the rule is one of one robot, nothing is used up from afar, and engines,
aggregates and comprehensions need not know of it.
"""

from collections.abc import Sequence
from dataclasses import replace

from rmr.bytecode.program import Duty, Kind
from rmr.lang.analyse.fact_size import FACT_OCTETS_MAX, octets
from rmr.lang.analyse.names import Names
from rmr.lang.diagnostics.diagnostic import Diagnostics
from rmr.lang.lower.ensemble_writer import ROBOT_TYPE, EnsembleWriter
from rmr.lang.lower.joint_plan import (
    called,
    known_from,
    named_owner,
    owners_of,
    same_owner,
    start_of,
    with_named_owners,
)
from rmr.lang.lower.joint_rules import JointPlanner
from rmr.lang.read.syntax import (
    AggregateNode,
    ChoiceNode,
    ComprehensionNode,
    Condition,
    Conjunct,
    Expression,
    FactNode,
    FoldNode,
    HeadItem,
    Mark,
    Name,
    RuleItem,
    Variable,
    flat,
)


class SharedReader:
    """Rewrites the rules of one program that read shared facts of other robots."""

    def __init__(self, names: Names, planner: JointPlanner, writer: EnsembleWriter, found: Diagnostics) -> None:
        self._names = names
        self._planner = planner
        self._writer = writer
        self._found = found
        self._shared = frozenset(name for name, each in names.signatures.items() if each.is_shared)
        self._heard: dict[str, str] = {}
        """By shared predicate, the one of what is heard of it."""
        self._home: Expression | None = None
        self._is_linked = True

    def at_home(self, rule: RuleItem) -> RuleItem | None:
        """Return `rule` with what its home has heard in place of shared facts of others; None after an error."""
        if not self._shared or not self._reads(rule):
            return rule
        if not self._writer.knows(rule):
            return None  # a number of arguments is wrong, and that has been told
        named = with_named_owners(rule)
        self._home = self._home_of(named)
        if self._home is None:
            return rule
        self._is_linked = True
        own = [each for each in named.body if isinstance(each, FactNode) and not each.absent and not self._is_far(each)]
        folded = [each.result.name for each in named.body if isinstance(each, FoldNode) and each.result is not None]
        conditions = [each for each in named.body if isinstance(each, Condition)]
        linked = known_from(own, conditions)
        body = self._body(named.body, linked)
        known = known_from([each for each in body if isinstance(each, FactNode)], conditions, folded)
        head = tuple(self._head(part, known) for part in named.head)
        return replace(named, body=body, head=head) if self._is_linked else None

    def _reads(self, rule: RuleItem) -> bool:
        """Return whether a body in the rule names a shared predicate."""
        inner = [part.body for part in flat(rule.head) if isinstance(part, ComprehensionNode | AggregateNode)]
        folds = [each.body for each in rule.body if isinstance(each, FoldNode)]
        facts = (each for body in (rule.body, *inner, *folds) for each in body if isinstance(each, FactNode))
        return any(each.name.text in self._shared for each in facts)

    def _is_shared(self, fact: FactNode) -> bool:
        return fact.name.text in self._shared and fact.mark is not Mark.GOAL

    def _is_far(self, fact: FactNode) -> bool:
        return self._is_shared(fact) and not same_owner(fact.owner, self._home)

    def _home_of(self, rule: RuleItem) -> Expression | None:
        """Return the robot that is to read: the owner of what is not shared, else who knows all the others."""
        plain = replace(
            rule, body=tuple(each for each in rule.body if not (isinstance(each, FactNode) and self._is_shared(each)))
        )
        owners = owners_of(plain) or owners_of(rule)
        if len(owners) < 2:
            return owners[0] if owners else None
        kept = [
            each
            for each in rule.body
            if not isinstance(each, FactNode) or any(same_owner(each.owner, one) for one in owners)
        ]
        return self._planner.home(replace(rule, body=tuple(kept)))

    # ---- bodies and heads

    def _body(self, body: Sequence[Conjunct], linked: set[str]) -> tuple[Conjunct, ...]:
        """Return a body whose atoms that are not far, and what is around it, bind the variables `linked`."""
        parts: list[Conjunct] = []
        for each in body:
            if isinstance(each, FoldNode):
                parts.append(replace(each, body=self._inner(each.body, linked)))
            elif isinstance(each, FactNode) and self._is_far(each):
                parts.append(self._heard_of(each, linked))
            else:
                parts.append(each)
        return tuple(parts)

    def _inner(self, body: Sequence[Conjunct], known: set[str]) -> tuple[Conjunct, ...]:
        own = [each for each in body if isinstance(each, FactNode) and not each.absent and not self._is_far(each)]
        conditions = [each for each in body if isinstance(each, Condition)]
        return self._body(body, known_from(own, conditions, known))

    def _head(self, part: HeadItem, known: set[str]) -> HeadItem:
        match part:
            case ComprehensionNode(body=body) | AggregateNode(body=body):
                return replace(part, body=self._inner(body, known))
            case ChoiceNode(then=then, otherwise=otherwise):
                first = tuple(self._head(each, known) for each in then)
                second = tuple(self._head(each, known) for each in otherwise)
                return replace(part, then=first, otherwise=second)
            case _:
                return part

    def _heard_of(self, fact: FactNode, linked: set[str]) -> FactNode:
        """Return what the home has heard in place of a far atom; one whose robot no link leads to is reported."""
        owner = fact.owner
        assert owner is not None
        if isinstance(owner, Variable) and owner.name not in linked:
            home = called(self._home)
            robot = "N" if named_owner(owner) is None else owner.name
            who = "some robot" if named_owner(owner) is None else called(owner)
            message = f"nothing leads from {home} to {who}, whose `{fact.name.text}` is read"
            here = home.strip("`") if home.startswith("`") else "R"
            hint = f"add a link, a fact of {home} that names the other: `neighbor({here}, {robot})`"
            self._found.report("E035", message, fact.span, hint=hint)
            self._is_linked = False
        name = self._heard.get(fact.name.text)
        if name is None:
            name = self._heard[fact.name.text] = self._predicate(fact.name.text)
        home_owner = self._home
        assert home_owner is not None
        return replace(fact, name=Name(name, fact.name.span), arguments=(home_owner, *fact.arguments), mark=Mark.NONE)

    def _predicate(self, shared: str) -> str:
        """Add the predicate of what is heard of a shared one."""
        place = self._names.signatures[shared].place
        types = self._writer.types.arguments(shared)
        least = sum(octets(Variable("_", place), each, {}) for each in types)
        if least > FACT_OCTETS_MAX:
            message = f"a shared fact takes {least} octets at least, a radio frame has room for {FACT_OCTETS_MAX}"
            hint = "neighbours are told in one frame: share a number or a short list that stands for it"
            self._found.report("E038", message, place, hint=hint)
        return self._writer.make("heard", Kind.SENSED, (ROBOT_TYPE, *types), Duty.HEARD, start_of(place), other=shared)
