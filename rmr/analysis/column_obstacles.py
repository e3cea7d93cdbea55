"""Obstacles to running a program as columns: all robots at once, an array for each argument of each predicate.

A program has none if every robot by itself holds at most one fact of each predicate (`at_most_one`), so that a robot
is one row, and if each rule reads and changes nothing but its own row: no facts for other robots, no actions, no time,
no values without a fixed size. Each obstacle has its place in the source and words that say what to change.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rmr.analysis.at_most_one import Several, several
from rmr.analysis.straight_line import BASES, Operation, Unsuitable, straight
from rmr.bytecode.conform import NUMBERS
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.program import (
    SELF,
    SELF_SLOT,
    Aggregate,
    Anything,
    Atom,
    Base,
    Bind,
    Code,
    Comprehension,
    Constant,
    Derived,
    DeriveFact,
    DeriveGoal,
    Duty,
    Guard,
    Head,
    HeadValue,
    InitialFact,
    Kind,
    Mode,
    Pattern,
    Place,
    Program,
    Rule,
    Slot,
    Steps,
    When,
)
from rmr.bytecode.provided import ROBOT_NUMBER

FALLIBLE_MAX = 256
"""Places in the rules of a program at which an expression may have no value; a robot remembers the matches that failed
there, and no more of them than fit."""

GOALS_MAX = 256
"""Goals that a program states: each takes columns of its own."""

_FIXED = tuple(BASES.values())
_FALLIBLE = frozenset(
    ("add", "sub", "mul", "div", "mod", "neg", "nothing", *(each.name for each in FUNCTIONS if each.fallible))
)
"""Operations that may have no value."""


@dataclass(frozen=True, slots=True)
class Obstacle:
    """Why a program cannot be run as columns."""

    text: str
    """What stands in the way."""
    place: Place | None = None
    """Where; None without the debug section."""


def obstacles(program: Program, given: Sequence[InitialFact] = ()) -> list[Obstacle]:
    """Return what keeps a verified `program` from being run as columns, the first first; nothing if it can be.

    `given` are the facts that robots get beside the stated ones.
    """
    if program.ensemble and all(each.duty is Duty.HEARD for each in program.ensemble):
        return [Obstacle("a rule reads shared facts of neighbours, of which columns do not hear")]
    if program.ensemble:
        return [Obstacle("a rule reads facts of several robots, which columns do not join")]
    found = list(_Survey(program).obstacles())
    found += [
        Obstacle(f"a fact `{program.predicates[fact.predicate].name}` is given, which robots state themselves")
        for fact in (*program.facts, *given)
        if program.predicates[fact.predicate].provided
    ]
    found += [_several(each, program) for each in several(program, (*program.facts, *given))]
    return list(dict.fromkeys(found))


def fallible(line: Sequence[Operation]) -> bool:
    """Return whether an expression may have no value."""
    return any(each.name in _FALLIBLE for each in line)


class Slots:
    """The types of a rule's variables; grows conjunct by conjunct."""

    def __init__(self, program: Program) -> None:
        self._predicates = program.predicates
        self.bases: dict[int, Base] = {SELF_SLOT: Base.ROBOT}

    def match(self, atom: Atom) -> None:
        """Note what an atom binds."""
        if atom.mode is not Mode.ABSENT:
            for arg, kind in zip(atom.args, self._predicates[atom.predicate].types, strict=True):
                if isinstance(arg, Slot):
                    self.bases.setdefault(arg.index, kind.base)

    def bind(self, bind: Bind) -> tuple[Operation, ...]:
        """Return the expression that binds a variable. Raises Unsuitable."""
        line = straight(bind.code, self.bases)
        self.bases[bind.slot] = line[-1].base
        return line


class _Survey:
    """Looks at a program table by table."""

    def __init__(self, program: Program) -> None:
        self._program = program
        self._fallible = 0

    def obstacles(self) -> Iterator[Obstacle]:
        """Yield what stands in the way but for the number of facts."""
        yield from self._predicates()
        for rule in range(len(self._program.rules)):
            yield from self._rule(rule)
        if self._fallible > FALLIBLE_MAX:
            yield Obstacle(f"expressions may fail at {self._fallible} places, at most {FALLIBLE_MAX} are possible")
        yield from self._goals()
        places = self._program.debug.assertions if self._program.debug else ()
        for index, assertion in enumerate(self._program.assertions):
            place = places[index] if index < len(places) else None
            yield Obstacle(f"the time assertion {assertion.name}: columns keep no deadlines", place)

    def _predicates(self) -> Iterator[Obstacle]:
        program = self._program
        for index, predicate in enumerate(program.predicates):
            if predicate.provided or predicate.kind is Kind.ACTION:
                continue
            place = predicate_place(program, index)
            if predicate.kind is Kind.SENSED:
                yield Obstacle(f"`{predicate.name}` is sensed: its facts come and go from outside", place)
            for position, kind in enumerate(predicate.types):
                if kind.base not in _FIXED:
                    what = "has no fixed type" if kind.base is Base.OPEN else f"is a {kind.base.name.lower()}"
                    yield Obstacle(f"argument {position + 2} of `{predicate.name}` {what}", place)

    def _goals(self) -> Iterator[Obstacle]:
        if len(self._program.goals) > GOALS_MAX:
            yield Obstacle(f"{len(self._program.goals)} goals are stated, at most {GOALS_MAX} are possible")
        for goal in self._program.goals:
            predicate = self._program.predicates[goal.predicate]
            place = predicate_place(self._program, goal.predicate)
            if predicate.provided:
                yield Obstacle(f"the goal `{predicate.name}` waits for what robots sense", place)
            elif goal.leads is None or any(lead.rank is None for lead in goal.leads):
                yield Obstacle(
                    f"how near a firing brings the goal `{predicate.name}` depends on the match, or on the robot", place
                )

    # ---- rules

    def _rule(self, index: int) -> Iterator[Obstacle]:
        place = rule_place(self._program, index)
        try:
            for text in self._texts(self._program.rules[index]):
                yield Obstacle(text, place)
        except Unsuitable as reason:
            yield Obstacle(f"an expression has {reason}, which columns do not hold", place)

    def _texts(self, rule: Rule) -> Iterator[str]:
        """Yield what is wrong with a rule; the first expression that does not suit ends it. Raises Unsuitable."""
        slots = Slots(self._program)
        for conjunct in rule.body:
            if isinstance(conjunct, Atom):
                yield from self._atom(conjunct, slots)
                slots.match(conjunct)
            elif isinstance(conjunct, Guard):
                line = self._line(conjunct.code, slots)
                if line[-1].base is not Base.BOOL:
                    yield "a condition is neither true nor false"
            elif isinstance(conjunct, Bind):
                self._fallible += fallible(slots.bind(conjunct))
            else:
                yield "the body counts or gathers facts: columns hold one of a predicate"
                return
        for head in rule.head:
            yield from self._head(head, slots)

    def _line(self, code: Code, slots: Slots) -> tuple[Operation, ...]:
        line = straight(code, slots.bases)
        self._fallible += fallible(line)
        return line

    def _atom(self, atom: Atom, slots: Slots) -> Iterator[str]:
        predicate = self._program.predicates[atom.predicate]
        if predicate.best is not None:
            yield f"of `{predicate.name}` the best is kept, which columns do not compare"
            return
        if predicate.provided and predicate.name != ROBOT_NUMBER:
            yield f"`{predicate.name}` is sensed: its facts come and go from outside"
            return
        seen = dict(slots.bases)
        for position, (arg, kind) in enumerate(zip(atom.args, predicate.types, strict=True)):
            known = _base_of(arg, seen)
            if known is not None and known is not kind.base and not (known in NUMBERS and kind.base in NUMBERS):
                yield (
                    f"argument {position + 2} of `{predicate.name}`, {_a(kind.base)}, "
                    f"is compared with {_a(known)}: they are never the same"
                )
            if isinstance(arg, Slot):
                seen.setdefault(arg.index, kind.base)

    def _head(self, head: Head, slots: Slots) -> Iterator[str]:
        if isinstance(head, Comprehension | Aggregate):
            what = "a comprehension" if isinstance(head, Comprehension) else "an aggregate"
            yield f"{what} is for many facts of a predicate, columns hold one"
            return
        if isinstance(head, HeadValue | When):
            yield "the head has conditions, which columns do not hold"
            return
        for item in head.steps if isinstance(head, Steps) else (head,):
            yield from self._item(item, slots)

    def _item(self, item: Derived, slots: Slots) -> Iterator[str]:
        predicate = self._program.predicates[item.predicate]
        if not isinstance(item, DeriveFact):
            is_goal = isinstance(item, DeriveGoal)
            held = "goals that the program states" if is_goal else "facts, nobody carries actions out"
            yield f"the rule derives the {'goal' if is_goal else 'action'} `{predicate.name}`: columns hold {held}"
        elif item.owner != SELF:
            yield f"the rule sends `{predicate.name}` to another robot"
        elif predicate.best is not None:
            yield f"of `{predicate.name}` the best is kept, which columns do not compare"
        elif predicate.provided:
            yield f"the rule derives `{predicate.name}`, which robots state themselves"
        else:
            self._fallible += 1
            for position, (code, kind) in enumerate(zip(item.args, predicate.types, strict=True)):
                base = straight(code, slots.bases)[-1].base
                if base is not kind.base and kind.base in _FIXED:
                    yield f"argument {position + 2} of `{predicate.name}` is {_a(base)}, not {_a(kind.base)}"


def _base_of(arg: Pattern, slots: dict[int, Base]) -> Base | None:
    """Return the type of what an argument is compared with; None if it is with nothing."""
    if isinstance(arg, Constant):
        return BASES.get(type(arg.value), Base.OPEN)
    return None if isinstance(arg, Anything) else slots.get(arg.index)


def _a(base: Base) -> str:
    return f"{'an' if base is Base.INT else 'a'} {base.name.lower()}"


# ---- places and words


def rule_place(program: Program, rule: int) -> Place | None:
    """Return where a rule stands, if the program says."""
    places = program.debug.rules if program.debug else ()
    return places[rule] if rule < len(places) else None


def predicate_place(program: Program, predicate: int) -> Place | None:
    """Return where a predicate is declared or used first, if the program says."""
    places = program.debug.predicates if program.debug else ()
    return places[predicate] if predicate < len(places) else None


def _several(each: Several, program: Program) -> Obstacle:
    """Return the message why a robot may hold several facts."""
    name, derived = (program.predicates[index].name for index in (each.predicate, each.derived))
    begin = f"a robot may hold several facts `{name}`"
    if each.rule is None:
        return Obstacle(f"{begin}: it is given more than one", predicate_place(program, each.predicate))
    place = rule_place(program, each.rule)
    way = f"let it consume one, or say `not {derived}(...)`"
    return Obstacle(f"{begin}: the rule derives `{derived}` and consumes no fact in its place; {way}", place)
