"""What ensemble rules are rewritten with: predicates whose names the program does not use, and the pieces of rules."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from rmr.base.record import record
from rmr.bytecode.program import Base, Best, Duty, Kind, Type
from rmr.lang.analyse.fact_size import FACT_OCTETS_MAX, octets
from rmr.lang.analyse.names import Names, Signature
from rmr.lang.analyse.types import OPEN, ROBOT, TypeCell, Types, cell_of
from rmr.lang.diagnostics.diagnostic import Diagnostics
from rmr.lang.lower.joint_plan import JointPlan, start_of
from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import (
    Binary,
    Condition,
    Conjunct,
    Expression,
    FactItem,
    FactNode,
    HeadItem,
    Literal,
    Mark,
    Name,
    RuleItem,
    Variable,
    walk,
)

INT = Type(Base.INT)
ROBOT_TYPE = Type(Base.ROBOT)


@record
class Made:
    """A predicate that the compiler makes."""

    name: str
    duty: Duty
    other: str | None = None


@dataclass(slots=True)
class EnsembleRules:
    """What the compiler makes of the ensemble rules of a program."""

    plans: list[JointPlan] = field(default_factory=list)
    made: list[Made] = field(default_factory=list)
    facts: list[FactItem] = field(default_factory=list)
    """Facts that hold at the start."""


class EnsembleWriter:
    """Rewrites the ensemble rules of one program; the symbol table and the types gain what it makes."""

    def __init__(self, names: Names, types: Types) -> None:
        self.names = names
        self.types = types
        self.result = EnsembleRules()
        self._known: dict[str, str] = {}
        """Names of the predicates that all ensemble rules share, by purpose."""

    def knows(self, rule: RuleItem) -> bool:
        """Return whether each fact of a rule has as many arguments as its predicate; if not, an error has said so."""
        facts = (each for each in walk((rule.body, rule.head)) if isinstance(each, FactNode))
        return all(len(fact.arguments) == len(self.types.positions.get(fact.name.text, ())) for fact in facts)

    def common(self, at: Span) -> list[RuleItem]:
        """Return the rules that all ensemble rules share."""
        rules = []
        me = Variable("R'", at)
        other = Variable("S'", at)
        life = Variable("E'", at)
        if "hello" in self._known:
            body = (self.fact("hello", at, me, other), self.fact("life", at, me, life))
            rules.append(RuleItem(body, (self.fact("knows", at, other, me, life),), at))
        if "knows" in self._known:
            body = (self.fact("again", at, me, other), self.fact("life", at, me, life))
            rules.append(RuleItem(body, (self.fact("knows", at, other, me, life),), at))
        return rules

    # ---- predicates

    def make(
        self,
        base: str,
        kind: Kind,
        types: Sequence[Type],
        duty: Duty,
        at: Span,
        *,
        other: str | None = None,
        best: Best | None = None,
    ) -> str:
        """Add a predicate with these types behind its owner; return its name, which no other one has."""
        number = 1
        while (name := f"{base}__{number}") in self.names.signatures:
            number += 1
        self.names.signatures[name] = Signature(name, kind, 1 + len(types), at, types=tuple(types), best=best)
        cells = [cell_of(each, at, fixed=True) for each in types]
        self.types.positions[name] = [TypeCell(ROBOT, at, fixed=True), *cells]
        self.result.made.append(Made(name, duty, other))
        return name

    def shared(self, purpose: str, at: Span) -> str:
        """Return the name of a predicate that all ensemble rules share."""
        if purpose not in self._known:
            kind, types, duty = _SHARED[purpose]
            best = Best(1, least=False) if purpose == "knows" else None
            self._known[purpose] = self.make(purpose, kind, types, duty, at, best=best)
            if purpose == "count":
                owner = Variable("R'", at)
                fact = FactNode(Name(self._known[purpose], at), (owner, Literal(0, at)), at)
                self.result.facts.append(FactItem(fact, at))
            if purpose == "knows":
                self.shared("life", at)
                self.shared("again", at)
        return self._known[purpose]

    def aside(self, name: str, at: Span) -> tuple[str, str]:
        """Return the predicates of facts of `name` that are set aside and that return."""
        if f"aside {name}" not in self._known:
            types = self.types.arguments(name)
            aside = self.make("aside", Kind.TEMPORARY, (INT, *types), Duty.ASIDE, at, other=name)
            back = self.make("returned", Kind.TEMPORARY, types, Duty.RETURN, at, other=name)
            self._known[f"aside {name}"] = aside
            self._known[f"back {name}"] = back
        return self._known[f"aside {name}"], self._known[f"back {name}"]

    def fact(self, purpose: str, at: Span, *arguments: Expression, absent: bool = False) -> FactNode:
        """Return a fact of a shared predicate."""
        return FactNode(Name(self.shared(purpose, at), at), arguments, at, absent=absent)


_SHARED: dict[str, tuple[Kind, tuple[Type, ...], Duty]] = {
    "life": (Kind.PERSISTENT, (INT,), Duty.LIFE),
    "again": (Kind.TEMPORARY, (ROBOT_TYPE,), Duty.RESTARTED),
    "knows": (Kind.PERSISTENT, (ROBOT_TYPE, INT), Duty.MESSAGE),
    "hello": (Kind.TEMPORARY, (ROBOT_TYPE,), Duty.MESSAGE),
    "greeted": (Kind.PERSISTENT, (ROBOT_TYPE,), Duty.NOTE),
    "count": (Kind.TEMPORARY, (INT,), Duty.NOTE),
    "out": (Kind.TEMPORARY, (INT,), Duty.NOTE),
    "turn": (Kind.TEMPORARY, (ROBOT_TYPE, INT), Duty.NOTE),
}
"""Kind, types behind the owner, and duty of the predicates that all ensemble rules share."""


class RuleWriter:
    """What the rules that one ensemble rule becomes are made of."""

    def __init__(self, writer: EnsembleWriter, plan: JointPlan, found: Diagnostics) -> None:
        self.writer = writer
        self._names = writer.names
        self._types = writer.types
        self.plan = plan
        self._found = found
        self._span = plan.rule.span
        self.at = start_of(plan.rule.span)
        self.home = plan.home
        self._typed: dict[str, Type] = {}
        self._fresh = 0
        self._too_large: set[str] = set()
        """Messages that have been reported."""

    # ---- types of variables

    def learn(self, facts: Iterable[FactNode]) -> None:
        """Note the types of variables, as the facts that bind them have them."""
        for fact in facts:
            cells = self._types.positions[fact.name.text]
            for argument, cell in zip(fact.arguments, cells, strict=True):
                if isinstance(argument, Variable) and cell.type != OPEN:
                    self._typed.setdefault(argument.name, cell.type)
        for each in walk((self.plan.rule.body, self.plan.rule.head)):
            if isinstance(each, Variable) and each.name not in self._typed:
                known = self._types.expressions.get(each.span)
                if known is not None and known.type != OPEN:
                    self._typed[each.name] = known.type

    def type(self, name: str) -> Type:
        """Return the type of a variable."""
        return self._typed.get(name, OPEN)

    def variable(self, name: str) -> Variable:
        """Return a variable at the place of the rule."""
        return Variable(name, self.at)

    def new(self, kind: Type) -> Variable:
        """Return a variable that no source can name."""
        self._fresh += 1
        variable = self.variable(f"_j{self._fresh}'")
        self._typed[variable.name] = kind
        return variable

    def variables(self, names: Iterable[str]) -> tuple[Variable, ...]:
        """Return variables at the place of the rule."""
        return tuple(self.variable(name) for name in names)

    # ---- pieces

    def fact(self, name: str, *arguments: Expression, absent: bool = False) -> FactNode:
        """Return a fact."""
        return FactNode(Name(name, self.at), arguments, self.at, absent=absent)

    def shared(self, purpose: str, *arguments: Expression, absent: bool = False) -> FactNode:
        """Return a fact of a predicate that all ensemble rules share."""
        return self.writer.fact(purpose, self.at, *arguments, absent=absent)

    def make(
        self,
        base: str,
        duty: Duty,
        types: Sequence[Type],
        kind: Kind = Kind.TEMPORARY,
        other: str | None = None,
        best: Best | None = None,
    ) -> str:
        """Add a predicate; return its name."""
        return self.writer.make(base, kind, types, duty, self.at, other=other, best=best)

    def rule(self, body: Iterable[Conjunct], head: Iterable[HeadItem]) -> RuleItem:
        """Return a rule at the place of the ensemble rule."""
        return RuleItem(tuple(body), tuple(head), self._span)

    def test(self, operator: str, left: Expression, right: Expression) -> Condition:
        """Return a comparison."""
        return Condition(Binary(operator, left, right, self.at), self.at)

    def kept(self, facts: Iterable[FactNode]) -> list[FactNode]:
        """Return positive atoms that consume nothing."""
        return [
            replace(fact, mark=Mark.KEEP) if self.consumable(fact) and fact.mark is Mark.NONE else fact
            for fact in facts
        ]

    def consumable(self, fact: FactNode) -> bool:
        """Whether an atom is of a temporary fact."""
        return fact.mark is not Mark.GOAL and self._names.of(fact).kind is Kind.TEMPORARY

    def must_fit(self, what: str, names: Iterable[str], fixed: int) -> None:
        """Report a message whose values cannot fit one frame."""
        least = fixed + sum(octets(self.variable(name), self.type(name), {}) for name in names)
        if least > FACT_OCTETS_MAX and what not in self._too_large:
            self._too_large.add(what)
            message = f"{what} takes {least} octets at least, a radio frame has room for {FACT_OCTETS_MAX}"
            hint = "a decision travels in one frame: keep large values in persistent facts and name them by a number"
            self._found.report("E038", message, self._span, hint=hint)
