"""Draws programs that are alive: rules fire, join and compete, facts are consumed, goals met, deadlines missed.

`Maker` has every construct in reach, but its values seldom meet. Here a program has few types and few values of
each, so that they do; its atoms prefer variables that are bound already; and each rule has a manner: it takes what
it matches, or only looks at it, or some of both. What is unlikely to have a value is drawn seldom, not never: ints
at the edges of 64 bits, values that Python calls equal and the language does not, conditions that are none.
"""

from dataclasses import replace
from random import Random

from fuzz_expressions import compound
from program_maker import BOOL, CALL, FLOAT, INNER, INT, OPEN, OUTER, RESULT, ROBOT, SLOTS, STRING, Bound, Maker, here

from rmr.base.values import INT_MAX, INT_MIN, Robot, Symbol, Value
from rmr.bytecode.heads import items
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    ANY,
    GOALS_OF,
    SELF,
    Aggregate,
    Atom,
    Base,
    Bind,
    Code,
    Comprehension,
    Conjunct,
    Constant,
    DeriveAction,
    Derived,
    DeriveFact,
    DeriveGoal,
    Duty,
    Guard,
    Head,
    HiddenPredicate,
    InitialFact,
    InitialGoal,
    Instruction,
    Kind,
    Mode,
    Operator,
    Pattern,
    Predicate,
    Program,
    Rule,
    Slot,
    Steps,
    Strategy,
    Type,
)
from rmr.bytecode.provided import PREDICATES
from rmr.lang.lower.goal_paths import with_leads

HEARD = "heard__1"
"""Name of the predicate of what neighbours have told of `p0`."""

HOME = 1
"""The robot on which programs are tried."""

ROBOTS = [HOME, HOME, 2, 0]
KINDS = [*[Kind.TEMPORARY] * 4, *[Kind.PERSISTENT] * 3, *[Kind.SENSED] * 3]
TYPES = [
    *[INT] * 5,
    *[OPEN] * 3,
    *[Type(Base.SYMBOL, "area")] * 2,
    *[ROBOT] * 2,
    FLOAT,
    STRING,
    Type(Base.BOOL),
    Type(Base.LIST, element=INT),
    Type(Base.LIST),
]
INTS = [0, 1, 1, 1, 2, 2, 3]
EDGES = [INT_MAX, INT_MIN, INT_MAX - 1, -1]
FLOATS = [0.0, -0.0, 0.5, 1.0, 1.0, 2.0]
LOOKALIKES: list[Value] = [
    1,
    1,
    1.0,
    True,
    Robot(1),
    0,
    0.0,
    -0.0,
    False,
    Robot(0),
    Symbol("a"),
    "a",
    (1,),
    (1.0,),
    (True,),
]
"""Values of which Python calls some equal."""

ARITY = [0, 1, 1, 1, 2, 2, 2, 3]
ATOMS = [0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 4]
DEADLINES: list[Value] = [0, 1, 1, 2, 0.5, -1, 1.5]
"""Seconds, on the grid of the times at which something happens."""

LARGE = 0.02
"""How often there is more of something than anybody would write: rules, atoms, operations of an expression."""

LINEAR = {"takes": (Mode.CONSUME,), "looks": (Mode.KEEP,), "both": (Mode.CONSUME, Mode.CONSUME, Mode.KEEP)}


def value_of(rng: Random, kind: Type) -> Value:
    """Return one of the few values of a type."""
    match kind.base:
        case Base.INT:
            return rng.choice(EDGES if rng.random() < 0.02 else INTS)
        case Base.OPEN:
            return rng.choice(LOOKALIKES)
        case Base.ROBOT:
            return Robot(rng.choice(ROBOTS))
        case Base.FLOAT:
            return 1e308 if rng.random() < 0.02 else rng.choice(FLOATS)
        case Base.BOOL:
            return rng.random() < 0.5
        case Base.STRING:
            return rng.choice(["", "a", "b"])
        case Base.SYMBOL:
            return Symbol(rng.choice("abc"))
    return tuple(value_of(rng, kind.element or OPEN) for _ in range(rng.choice([0, 1, 1, 2, 2, 3])))


BASES = {bool: Base.BOOL, int: Base.INT, float: Base.FLOAT, str: Base.STRING, Symbol: Base.SYMBOL, Robot: Base.ROBOT}


def known_type(code: Code, bound: Bound) -> Type | None:
    """Return the type of an expression that is but one instruction."""
    first, operand = code[0], code[0].operand
    if len(code) > 1 or operand is None:
        return None
    return bound[operand] if first.op is Op.LOAD else Type(BASES.get(type(operand), Base.LIST))


class Lively(Maker):
    """One program in the making."""

    types: list[Type]
    """What arguments are, drawn for the program."""
    manner: tuple[Mode, ...] = (Mode.CONSUME,)
    """What the body that is being made does with temporary facts."""

    # ---- predicates and values

    def declared(self) -> list[Predicate]:
        rng = self.rng
        self.types = rng.choices(TYPES, k=rng.randint(1, 3))
        kinds = [Kind.TEMPORARY, *rng.choices(KINDS, k=rng.randint(1, 4)), *[Kind.ACTION] * rng.randint(1, 2)]
        own = [
            Predicate(f"p{i}", kind, tuple(rng.choices(self.types, k=rng.choice(ARITY))))
            for i, kind in enumerate(kinds)
        ]
        own = list(map(self.with_best, own))
        if self.chance(0.12):  # the first one is shared: what neighbours have told of it
            own.append(Predicate(HEARD, Kind.SENSED, (ROBOT, *own[0].types)))
        names = rng.sample(list(PREDICATES), k=int(self.chance(0.1))) + ["id"] * self.chance(0.05)
        provided = [
            Predicate(name, PREDICATES[name].kind, PREDICATES[name].types, self.chance(0.9))
            for name in dict.fromkeys(names)
        ]
        return self.with_goal_table(own + provided)

    def value(self, kind: Type = OPEN, depth: int = 0) -> Value:
        return value_of(self.rng, kind)

    # ---- expressions

    def code(self, bound: Bound, kind: Type, depth: int = 0, now: bool = True) -> Code:
        fitting = [slot for slot, known in bound.items() if known == kind or self.chance(0.005)]
        if fitting and self.chance(0.75):
            return (Instruction(Op.LOAD, self.rng.choice(fitting)),)
        if self.own and depth < 2 and self.chance(0.03):
            return self.applied(lambda wanted: self.code(bound, wanted, depth + 1, now))
        if not depth and kind in (INT, FLOAT) and self.chance(LARGE / 2):
            return self.deep(bound, kind)
        if depth < 2 and self.chance(0.3):
            return compound(self.rng, lambda wanted: self.code(bound, wanted, depth + 1, now), kind)
        return (self.constant(kind if self.chance(0.99) else OPEN),)

    def deep(self, bound: Bound, kind: Type) -> Code:
        """An expression of many operations, nested to the left or to the right."""
        parts = [self.code(bound, kind, 2, now=False) for _ in range(self.rng.choice([12, 45, 60]))]
        ops = [(Instruction(self.rng.choice([Op.ADD, Op.SUB, Op.ADD])),) for _ in parts[1:]]
        if self.chance(0.5):
            return (*(each for part in parts for each in part), *(each for op in ops for each in op))
        return (*parts[0], *(each for part, op in zip(parts[1:], ops, strict=True) for each in (*part, *op)))

    def condition_on(self, bound: Bound) -> Code:
        """A condition, mostly on what is bound."""
        if self.chance(0.3):
            return compound(self.rng, lambda wanted: self.code(bound, wanted, 1, now=False), BOOL)
        slot = self.rng.choice(list(bound))
        ordered = bound[slot].base in (Base.INT, Base.FLOAT, Base.STRING) or self.chance(0.05)
        op = self.rng.choice(
            [Op.LE, Op.GE, Op.NE, Op.LE, Op.GE, Op.NE, Op.LT, Op.GT, Op.EQ] if ordered else [Op.NE, Op.NE, Op.EQ]
        )
        return (Instruction(Op.LOAD, slot), *self.code(bound, bound[slot], 1, now=False), Instruction(op))

    def owner(self, bound: Bound) -> Code:
        robots = [
            slot for slot, kind in bound.items() if slot and (kind == ROBOT or self.chance(0.02 * (kind == OPEN)))
        ]
        if self.chance(0.75):
            return SELF
        return (Instruction(Op.LOAD, self.rng.choice(robots)),) if robots else (Instruction(Op.CONST, Robot(2)),)

    # ---- bodies

    def pattern(self, kind: Type, slots: range, bound: Bound) -> Pattern:
        same = [slot for slot in (0, *slots) if bound.get(slot) == kind or (slot in bound and self.chance(0.01))]
        free = [slot for slot in slots if slot not in bound]
        choice = self.rng.random()
        if choice < 0.12:
            return ANY
        if choice < 0.22:
            return Constant(self.value(kind))
        if same and choice < 0.6:
            return Slot(self.rng.choice(same))
        return Slot(free[0]) if free else ANY

    def atom(self, slots: range, bound: Bound, linear: tuple[Mode, ...] | None = None) -> Atom:
        predicate = self.rng.choice(self.facts)
        declared = self.bare[predicate]
        modes = self.manner if linear is None else linear
        mode = self.rng.choice(modes) if declared.kind is Kind.TEMPORARY else Mode.READ
        fresh = dict(bound)
        args = []
        for kind in declared.types:
            args.append(self.pattern(kind, slots, fresh))
            if isinstance(args[-1], Slot):
                fresh.setdefault(args[-1].index, kind)
        bound.update(fresh)
        return Atom(predicate, tuple(args), mode)

    def absent(self, bound: Bound) -> Atom:
        """What must not hold, seldom so much that nearly always something of it does."""
        predicate = max(self.rng.choices(self.facts, k=2), key=lambda index: len(self.bare[index].types))
        args: list[Pattern] = []
        for kind in self.bare[predicate].types:
            same = [slot for slot, known in bound.items() if known == kind]
            general = self.rng.choice([ANY, Slot(OUTER.stop - 1)]) if self.chance(0.25) else Constant(self.value(kind))
            args.append(Slot(self.rng.choice(same)) if same and self.chance(0.6) else general)
        return Atom(predicate, tuple(args), Mode.ABSENT)

    def body(self, slots: range, bound: Bound) -> tuple[Conjunct, ...]:
        body: list[Conjunct] = []
        count = self.rng.choice(ATOMS if slots is OUTER else [0, 1, 1, 1, 2, 2])
        if self.chance(LARGE):
            count = self.rng.randint(5, 10)
        for _ in range(count):
            body.append(self.atom(slots, bound))
            body.extend(self.conditions(slots, bound, 0.18))
            if self.chance(0.15):
                body.append(self.absent(bound))
        if not count:
            body.extend(self.conditions(slots, bound, 0.4))
        if not count and self.chance(0.7):
            body.append(self.absent(bound))
        return tuple(body)

    def conditions(self, slots: range, bound: Bound, often: float) -> list[Conjunct]:
        """Conditions and bindings; a list may be taken apart."""
        free = [slot for slot in slots if slot not in bound]
        lists = [slot for slot, kind in bound.items() if kind.base is Base.LIST]
        if lists and len(free) > 1 and self.chance(0.4):
            return self.taken_apart(self.rng.choice(lists), bound[lists[0]].element or OPEN, free, bound)
        if self.chance(often):
            return [Guard(self.condition_on(bound))]
        if free and self.chance(often / 2):
            kind = self.rng.choice([INT, *self.types])
            code = self.code(bound, kind, now=False)
            bound[free[0]] = known_type(code, bound) or kind
            return [Bind(free[0], code)]
        return []

    def taken_apart(self, slot: int, element: Type, free: list[int], bound: Bound) -> list[Conjunct]:
        """``[H | T]`` as it is compiled."""
        load, one, none = Instruction(Op.LOAD, slot), Instruction(Op.INT, 1), Instruction(Op.INT, 0)
        head, tail = Bind(free[0], (load, none, CALL["nth"])), Bind(free[1], (load, one, CALL["rest"]))
        bound[free[0]], bound[free[1]] = element, bound[slot]
        return [Guard((load, CALL["len"], one, Instruction(Op.GE))), head, tail]

    # ---- heads

    def argument(self, bound: Bound, kind: Type) -> Code:
        """The expression of a derived argument; what is said of the time is said anew when time has passed."""
        if self.drawing and kind in (FLOAT, OPEN) and self.chance(0.1):
            return (CALL["random"],)
        if kind in (INT, FLOAT, OPEN) and self.chance(0.1):
            return (CALL["now"], CALL["floor"]) if kind is INT else (CALL["now"],)
        return super().argument(bound, kind)

    def item(self, bound: Bound) -> Derived:
        kind = self.rng.choice([*[DeriveFact] * 6, *[DeriveAction] * 3, DeriveGoal])
        choices = {DeriveAction: self.actions, DeriveFact: self.unsensed, DeriveGoal: self.facts}
        predicate = self.rng.choice(choices[kind])
        args = tuple(self.argument(bound, each) for each in self.bare[predicate].types)
        return kind(predicate, self.owner(bound), args)

    def head(self, bound: Bound) -> Head:
        if self.chance(0.6):
            return self.item(bound)
        if self.chance(0.3):
            return Steps(tuple(self.item(bound) for _ in range(self.rng.randint(2, 3))))
        self.manner = self.rng.choice([*LINEAR.values(), (Mode.CONSUME,)])
        inner = dict(bound)
        body = self.body(INNER, inner)
        new = tuple(slot for slot in inner if slot not in bound)
        if self.chance(0.4):
            return Comprehension(new, body, tuple(self.item(inner) for _ in range(self.rng.choice([1, 1, 1, 2, 0]))))
        return self.aggregate(bound, inner, new, body)

    def aggregate(self, bound: Bound, inner: Bound, new: tuple[int, ...], body: tuple[Conjunct, ...]) -> Aggregate:
        operator = self.rng.choice(list(Operator))
        wanted = [INT, FLOAT] if operator is Operator.SUM else [INT, FLOAT, *self.types]
        fitting = [kind for kind in inner.values() if kind in wanted and kind is not ROBOT] or wanted
        kind = INT if operator is Operator.COUNT else self.rng.choice(fitting)
        term = None if operator is Operator.COUNT else self.code(inner, kind)
        if operator is Operator.SUM and kind is INT and self.chance(0.15):
            term = (Instruction(Op.CONST, INT_MAX),)
        winning = inner if operator in (Operator.MIN, Operator.MAX) else bound
        result = Type(Base.LIST) if operator is Operator.COLLECT else kind
        return Aggregate(operator, term, RESULT, new, body, self.items_of({**winning, RESULT: result}))

    def items_of(self, bound: Bound) -> tuple[Derived, ...]:
        return tuple(self.item(bound) for _ in range(self.rng.choice([1, 1, 1, 2])))

    def rule(self) -> Rule:
        bound = here()
        self.manner = self.rng.choice(list(LINEAR.values()))
        body = self.body(OUTER, bound)
        body += self.folds(bound)
        return Rule(SLOTS, body, self.heads(bound, self.rng.choice([0, 1, 1, 1, 1, 2, 2, 3])))

    # ---- the other tables

    def assertion(self):
        made = super().assertion()
        if self.chance(0.2):
            return made
        deadline = (Instruction(Op.CONST, self.rng.choice(DEADLINES)),)
        if self.chance(0.3):
            return replace(made, robot=self.rng.choice([None, 2]), finish=self.told(), finisher=Constant(Robot(HOME)))
        return replace(made, deadline=deadline, robot=self.rng.choice([None, None, HOME, 2]))

    def told(self) -> Atom:
        """A finish fact, sensed if there are such, of which this robot tells others."""
        sensed = [index for index in self.facts if self.bare[index].kind is Kind.SENSED] or self.facts
        index = self.rng.choice(sensed)
        mode = Mode.KEEP if self.bare[index].kind is Kind.TEMPORARY else Mode.READ
        return Atom(index, (ANY,) * len(self.bare[index].types), mode)

    def is_goal_table(self, predicate: int) -> bool:
        return self.bare[predicate].name.startswith(GOALS_OF)

    def with_goal_table(self, declared: list[Predicate]) -> list[Predicate]:
        """Some predicates, and perhaps one that stands for the open goals of another."""
        held = [each for each in declared if each.kind is not Kind.ACTION and not each.provided]
        if not held or self.chance(0.6):
            return declared
        whose = self.rng.choice(held)
        return [*declared, Predicate(GOALS_OF + whose.name, Kind.SENSED, whose.types)]

    def fact(self) -> InitialFact:
        return replace(super().fact(), owner=self.rng.choice([None] * 8 + [HOME, 2]))

    def wanted(self, rules: tuple[Rule, ...]) -> InitialGoal:
        """A goal, mostly one to which a rule leads."""
        made = replace(super().goal(len(rules)), owner=self.rng.choice([None, None, HOME, 2]), leads=None)
        derived = [each.predicate for rule in rules for each in items(rule.head) if isinstance(each, DeriveFact)]
        if self.chance(0.4) or not derived:
            return made
        predicate = self.rng.choice(derived)
        return replace(made, predicate=predicate, args=(ANY,) * len(self.bare[predicate].types))

    def ensemble(self) -> tuple[HiddenPredicate, ...]:
        """What the predicate of what neighbours have told stands for, if there is one."""
        places = {each.name: place for place, each in enumerate(self.bare)}
        return (HiddenPredicate(places[HEARD], Duty.HEARD, places["p0"]),) if HEARD in places else ()

    def program(self) -> Program:
        rng = self.rng
        self.functions()
        size = rng.randint(9, 16) if self.chance(LARGE) else rng.choice([1, 2, 2, 3, 3, 4, 5])
        rules = tuple(self.rule() for _ in range(size))
        assertions = tuple(self.assertion() for _ in range(rng.choice([0, 0, 0, 0, 1, 2])))
        facts = [self.fact() for _ in range(rng.randint(1, 8))]
        goals = [self.wanted(rules) for _ in range(rng.choice([0, 0, 1, 1, 2]))]
        program = Program(
            tuple(map(self.complete, self.bare)),
            tuple([each for each in facts if not self.is_goal_table(each.predicate)]),
            tuple([each for each in goals if not self.is_goal_table(each.predicate)]),
            rules,
            assertions,
            Strategy.TEXTUAL if self.chance(0.35) else Strategy.RANDOM,
            self.debug(len(rules), len(assertions)) if self.chance(0.2) else None,
            tuple(self.own),
            self.ensemble(),
        )
        return with_leads(program) if program.goals and self.chance(0.5) else program
