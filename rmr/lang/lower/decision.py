"""What the robots of one ensemble rule that has to be decided know, need and note (the protocol of `ensemble_rules`).

The home asks one robot after the other, in the order of their numbers: a *step* each. All but the last reserve, which
means that they set their part aside; the last one decides. A value is known to the home, or bound at a step and given
to the home with the answer. This module says which values each message and each note carries, and makes their
predicates; `decision_home` and `decision_remote` write the rules.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from rmr.bytecode.program import Duty, Type
from rmr.lang.lower.ensemble_writer import INT, ROBOT_TYPE, RuleWriter
from rmr.lang.lower.joint_plan import RemotePart, called, head_at, known_from, names_in
from rmr.lang.read.syntax import (
    Call,
    Condition,
    Conjunct,
    Expression,
    FactNode,
    FoldNode,
    HeadItem,
    Literal,
    Mark,
    Name,
    RuleItem,
    Variable,
)

Owner = Variable | Literal
"""The robot of a part, as the rule names it."""


@dataclass(slots=True)
class DecisionStep:
    """A robot that the home asks."""

    place: int
    """From 0, in ascending order of the robots' numbers."""
    part: RemotePart
    tests: list[Condition]
    """The conditions that this robot tests."""
    theirs: list[HeadItem]
    """Its part of the head."""
    keys: list[str]
    """Values from the home that decide whether its part matches."""
    home_keys: list[str]
    """Those of `keys` that the home knows without another robot."""
    bound: set[str]
    """Values that its part binds."""
    gives: list[str] = field(default_factory=list)
    """Values that it gives with its answer."""
    extras: list[str] = field(default_factory=list)
    """Other values that the home sends it."""
    held: list[str] = field(default_factory=list)
    """Values that it notes until the decision is known."""

    question: str = ""
    answer: str = ""
    refused: str = ""
    note: str = ""
    """What the home notes while it waits for this robot's answer."""
    asked: str = ""
    want: str = ""
    have: str = ""
    record: str = ""
    """What the robot notes with its answer: its reservation, or that its part of the head is held back."""
    did: str = ""
    """That this robot knows a decision which others may have to learn from it."""
    telling: str = ""
    """That it tells them, because the home has died."""

    @property
    def owner(self) -> Owner:
        """The robot."""
        return self.part.owner

    @property
    def ends(self) -> set[str]:
        """The name of the robot, if it is a variable."""
        return names_of([self.owner])

    @property
    def taken(self) -> list[FactNode]:
        """Its positive atoms; what is kept is taken, too, and comes back."""
        return taken(self.part.facts)


class Decision:
    """The steps of one ensemble rule in one order of the robots, and the predicates of its messages and notes."""

    def __init__(
        self,
        writer: RuleWriter,
        parts: Sequence[RemotePart],
        facts: list[FactNode],
        here: list[Condition],
        there: list[Condition],
        known: set[str],
    ) -> None:
        """`facts` are the home's, plain, as are those of all `parts` but the last; `there` it cannot test."""
        self.w = writer
        self.facts = facts
        self.here = here
        self.home: Owner = writer.plan.home
        self.consumed = [fact for fact in facts if writer.consumable(fact)]
        head = writer.plan.rule.head
        of_parts = [[item for item in head if head_at(item, part.owner)] for part in parts]
        self.ours = [item for item in head if not any(item in theirs for theirs in of_parts)]
        """The home's part of the head, with what it sends to robots that the rule reads nothing of."""
        self.steps: list[DecisionStep] = []
        self._follow(parts, of_parts, there, known)
        self.reserving = self.steps[:-1]
        self.last = self.steps[-1]
        self._share(known)
        self._make()

    # ---- values

    def _follow(
        self, parts: Sequence[RemotePart], heads: list[list[HeadItem]], there: list[Condition], known: set[str]
    ) -> None:
        """Add a step for each part: what it tests, needs and gives."""
        reach = set(known)
        left = there
        home = names_of([self.home])
        for place, part in enumerate(parts):
            at = known_from(part.facts, left, reach)
            decides = place == len(parts) - 1
            tests = left if decides else [each for each in left if set(names_in(each)) <= at]
            left = [each for each in left if each not in tests]
            ends = home | names_of([part.owner])
            keys = [n for n in names_in((part.facts, part.absent, tuple(tests))) if n in reach and n not in ends]
            bound = known_from(part.facts, tests, reach) - reach
            step = DecisionStep(place, part, tests, heads[place], keys, [n for n in keys if n in known], bound)
            self.steps.append(step)
            if decides:
                continue
            following = [(each.facts, each.absent) for each in parts[place + 1 :]]
            others = [theirs for number, theirs in enumerate(heads) if number != place]
            later = (*following, tuple(left), tuple(self.ours), *[tuple(each) for each in others])
            step.gives = [name for name in names_in(later) if name in bound]
            reach |= set(step.gives)
        self._reach = reach

    def _share(self, known: set[str]) -> None:
        """Note what the robots learn after they have answered."""
        home = names_of([self.home])
        last = self.last
        carried: list[str] = []
        for step in self.reserving:
            at = {*step.keys, *step.bound, *home, *step.ends}
            wanted = list(names_in(tuple(step.theirs)))
            carried += [name for name in wanted if name not in at]
            values = [*names_in(tuple(self.set_aside(step))), *wanted]
            step.held = [n for n in dict.fromkeys(values) if n in at and n not in home | step.ends]
        self.carried = list(dict.fromkeys(carried))
        """Values that the reserving robots get with the decision."""
        reserving = [each.owner.name for each in self.reserving if isinstance(each.owner, Variable)]
        ends = home | last.ends
        for_last = dict.fromkeys([*names_in(tuple(last.theirs)), *self.carried, *reserving])
        last.extras = [n for n in for_last if n in self._reach and n not in ends and n not in last.keys]
        ours = dict.fromkeys([*names_in(tuple(self.ours)), *self.carried])
        last.gives = [name for name in ours if name in last.bound and name not in ends]
        at_last = self._reach | last.bound
        last.held = [name for name in names_in(tuple(last.theirs)) if name in at_last and name not in ends]
        needed = [*names_in((tuple(self.consumed), tuple(self.ours))), *self.carried]
        needed += [name for step in self.steps for name in step.keys]
        needed += last.extras if self.reserving else []
        ends = home | names_of(step.owner for step in self.steps)
        self.noted = [name for name in dict.fromkeys(needed) if name in known and name not in ends]
        """Values that the home notes until the decision."""

    def set_aside(self, step: DecisionStep) -> list[FactNode]:
        """Return the atoms whose facts a reserving robot sets aside."""
        return [fact for fact in step.part.facts if self.w.consumable(fact)]

    # ---- predicates

    def _types(self, names: Iterable[str]) -> list[Type]:
        return [self.w.type(name) for name in names]

    def _make(self) -> None:
        w = self.w
        notes: list[Type] = [INT, *[each for _ in self.steps for each in (ROBOT_TYPE, INT)], *self._types(self.noted)]
        for step in self.steps:
            keys = self._types(step.keys)
            home_keys = self._types(step.home_keys)
            reserves = step is not self.last
            question: list[Type] = [ROBOT_TYPE, INT, INT, INT]
            if reserves:
                question += [each for _ in self.steps[1:] for each in (ROBOT_TYPE, INT)]
            elif self.reserving:
                question.append(INT)
            asks = "reserve" if reserves else "offer_last" if self.reserving else "offer"
            step.question = w.make(asks, Duty.MESSAGE, [*question, *keys, *self._types(step.extras)])
            step.note = w.make(f"note_{step.place + 1}" if step.place else "note", Duty.NOTE, notes)
            notes = [*notes, *self._types(step.gives)]
            step.asked = w.make("asked", Duty.NOTE, [ROBOT_TYPE, INT, *home_keys])
            step.want = w.make("want", Duty.NOTE, [ROBOT_TYPE, *keys])
            step.have = w.make("have", Duty.MESSAGE, [ROBOT_TYPE, INT, *home_keys])
            step.refused = w.make("refused", Duty.MESSAGE, [INT, INT])
            given = self._types(step.gives)
            if reserves:
                others: list[Type] = [each for _ in self.steps[1:] for each in (ROBOT_TYPE, INT)]
                step.record = w.make("booked", Duty.NOTE, [ROBOT_TYPE, INT, INT, *others, *self._types(step.held)])
                step.answer = w.make("reserved", Duty.MESSAGE, [INT, INT, *given])
                w.must_fit(f"what {called(step.owner)} is to reserve", step.keys, 9 + 11 * len(self.reserving))
                w.must_fit(f"what {called(step.owner)} answers", step.gives, 4)
        self._make_last()
        if self.reserving:
            self._make_shared()

    def _make_last(self) -> None:
        w = self.w
        last = self.last
        given = self._types(last.gives)
        self.stands = ""
        if last.theirs:
            self.stands = w.make("stands", Duty.NOTE, [ROBOT_TYPE, INT, INT, *given])
            last.record = w.make("held", Duty.NOTE, [ROBOT_TYPE, INT, INT, *self._types(last.held)])
        duty = Duty.DECISION if last.theirs else Duty.MESSAGE
        last.answer = w.make("fired", duty, [INT, INT, *given], other=self.stands or None)
        who = called(last.owner)
        w.must_fit(f"what is offered to {who}", [*last.keys, *last.extras], 9)
        w.must_fit(f"what {who} answers", last.gives, 4)

    def _make_shared(self) -> None:
        """Make what tells the reserving robots of the decision."""
        w = self.w
        about: list[Type] = [ROBOT_TYPE, INT, INT]
        carried = self._types(self.carried)
        robots: list[Type] = [ROBOT_TYPE for _ in self.steps]
        self.settled = w.make("settled", Duty.NOTE, [ROBOT_TYPE, *about, *carried])
        self.commit = w.make("commit", Duty.DECISION, [*about, *carried], other=self.settled)
        self.abort = w.make("abort", Duty.MESSAGE, about)
        self.closing = w.make("closing", Duty.NOTE, [INT, *robots])
        self.closed = w.make("closed", Duty.NOTE, [ROBOT_TYPE, INT])
        self.forget = w.make("forget", Duty.MESSAGE, about)
        self.ask = w.make("ask", Duty.MESSAGE, [ROBOT_TYPE, *about, INT])
        self.asking = w.make("asking", Duty.NOTE, [*about, INT])
        self.lost = self.doubt = self.query = ""
        if len(self.reserving) > 1:
            self.lost = w.make("lost", Duty.MESSAGE, about)
            self.doubt = w.make("doubt", Duty.NOTE, [*about, INT])
            self.query = w.make("query", Duty.MESSAGE, [ROBOT_TYPE, *about])
        for step in self.holders:
            others = [ROBOT_TYPE for each in self.reserving if each is not step]
            step.did = w.make("did", Duty.NOTE, [*about, *others, *carried])
            step.telling = w.make("telling", Duty.NOTE, [*about, *others])
        w.must_fit("what the reserving robots are told of the decision", self.carried, 7)

    @property
    def holders(self) -> list[DecisionStep]:
        """The steps whose robots remember a decision for others: the last, and reserving ones if there are several."""
        return [*(self.reserving if len(self.reserving) > 1 else ()), self.last] if self.reserving else []

    # ---- pieces of rules

    def numbers(self, count: int) -> tuple[Variable, ...]:
        """Return new variables of whole numbers."""
        return tuple(self.w.new(INT) for _ in range(count))

    def robot(self) -> Variable:
        """Return a new variable of a robot."""
        return self.w.new(ROBOT_TYPE)

    def anything(self, places: Iterable[object]) -> list[Expression]:
        """Return an anonymous variable for each place."""
        return [self.w.variable("_") for _ in places]

    def id(self, robot: Expression) -> Expression:
        """Return the number of a robot."""
        return Call(Name("id", self.w.at), (robot,), self.w.at)

    def none(self, *body: Conjunct) -> FoldNode:
        """Return the condition that `body` has no match."""
        return FoldNode(Name("count", self.w.at), None, body, self.w.at)

    def aside(self, facts: Iterable[FactNode], owner: Expression, number: Expression) -> list[FactNode]:
        """Return the facts of some atoms as they are set aside under a number."""
        w = self.w
        return [w.fact(w.writer.aside(each.name.text, w.at)[0], owner, number, *each.arguments[1:]) for each in facts]

    def returned(self, facts: Iterable[FactNode], *, kept: bool = False) -> list[FactNode]:
        """Return what brings facts back: all, or only those that the rule keeps."""
        w = self.w
        return [
            w.fact(w.writer.aside(each.name.text, w.at)[1], *each.arguments)
            for each in facts
            if each.mark is Mark.KEEP or not kept
        ]

    def no_booking(self, me: Owner, life: Expression, number: Expression) -> list[Conjunct]:
        """Return the conditions that a robot has reserved nothing in a transaction."""
        others = [0 for _ in self.steps[1:] for _ in range(2)]
        return [
            absent(
                self.w.fact(step.record, me, self.home, life, number, *self.anything(others), *self.anything(step.held))
            )
            for step in self.reserving
        ]

    def pending(self, me: Owner, life: Expression, number: Expression) -> FactNode:
        """Return the condition that no decision waits to take effect."""
        return absent(self.w.fact(self.commit, me, self.home, life, number, *self.anything(self.carried)))

    def about(self, predicate: str, me: Owner, life: Expression, number: Expression, *more: Expression) -> FactNode:
        """Return a fact about a transaction of the home."""
        return self.w.fact(predicate, me, self.home, life, number, *more)

    def heard(self, me: Owner, life: Expression) -> list[Conjunct]:
        """Return the conditions that the home has died: a robot knows a later life."""
        (newer,) = self.numbers(1)
        return [self.w.shared("knows", me, self.home, newer), self.w.test("<", life, newer)]

    def rule(self, body: Iterable[Conjunct], head: Iterable[HeadItem]) -> RuleItem:
        """Return a rule at the place of the ensemble rule."""
        return self.w.rule(body, head)


def absent(fact: FactNode) -> FactNode:
    """Return the condition that there is no such fact."""
    return replace(fact, absent=True)


def kept(fact: FactNode) -> FactNode:
    """Return an atom that leaves its fact in place."""
    return replace(fact, mark=Mark.KEEP)


def taken(facts: Iterable[FactNode]) -> list[FactNode]:
    """Return atoms that use up what they would keep."""
    return [replace(fact, mark=Mark.NONE) if fact.mark is Mark.KEEP else fact for fact in facts]


def names_of(owners: Iterable[Owner]) -> set[str]:
    """Return the names of those owners that are variables."""
    return {each.name for each in owners if isinstance(each, Variable)}
