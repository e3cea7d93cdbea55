"""Draws sound programs from a seed, with every construct in reach.

Most expressions have the type that is declared where they stand, so that rules fire and facts go on; some have
another, so that what only shows when it runs is met too.
"""

from collections.abc import Callable
from dataclasses import replace
from random import Random

from rmr.base.values import INT_MAX, INT_MIN, ROBOT_ID_MAX, Robot, Symbol, Value
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    ANY,
    SELF,
    Aggregate,
    Assertion,
    Atom,
    Base,
    Bind,
    Code,
    Comprehension,
    Conjunct,
    Constant,
    Debug,
    DeriveAction,
    Derived,
    DeriveFact,
    DeriveGoal,
    Effect,
    Guard,
    Head,
    InitialFact,
    InitialGoal,
    Instruction,
    Kind,
    Lead,
    Mode,
    Operator,
    Pattern,
    Place,
    Predicate,
    Program,
    Rule,
    Serving,
    Slot,
    Steps,
    Strategy,
    Type,
)
from rmr.bytecode.provided import PREDICATES

Bound = dict[int, Type]
"""The slots that have a value, with the types of what they stand for."""

OPEN, ROBOT, INT, FLOAT, BOOL, STRING = (
    Type(base) for base in (Base.OPEN, Base.ROBOT, Base.INT, Base.FLOAT, Base.BOOL, Base.STRING)
)
ARITHMETIC = [Op.ADD, Op.SUB, Op.MUL, Op.DIV, Op.MOD]
COMPARISON = [Op.EQ, Op.NE, Op.LT, Op.LE, Op.GT, Op.GE]
APART = Type(Base.SYMBOL, "apart")
"""The type of a slot that is better left alone."""
CALL = {function.name: Instruction(Op.CALL, index) for index, function in enumerate(FUNCTIONS)}
SLOTS = 12
OUTER, INNER, RESULT = range(6), range(6, 11), 11
"""Slots that a rule's body may bind, those of an inner body, and an aggregate's result."""
ROBOTS = [0, 1, 2, 200, ROBOT_ID_MAX]


def here() -> Bound:
    """The slots of a rule before its body."""
    return {0: ROBOT}


class Maker:
    """One program in the making."""

    def __init__(self, seed: int) -> None:
        self.rng = Random(seed)
        self.bare = self.declared()
        self.facts = [i for i, p in enumerate(self.bare) if p.kind is not Kind.ACTION]
        self.unsensed = [i for i in self.facts if self.bare[i].kind is not Kind.SENSED]
        self.actions = [i for i, p in enumerate(self.bare) if p.kind is Kind.ACTION]

    def chance(self, probability: float) -> bool:
        return self.rng.random() < probability

    # ---- names, types, values

    def word(self) -> str:
        return "".join(self.rng.choices("abcxyzQ_09", k=self.rng.randint(0, 6)))

    def declared(self) -> list[Predicate]:
        """Predicates without effects: a temporary one, an action, any others."""
        kinds = [Kind.TEMPORARY, Kind.ACTION, *self.rng.choices(list(Kind), k=self.rng.randint(1, 4))]
        types = [self.type() for _ in range(4)]
        own = [
            Predicate(f"p{i}{self.word()}", kind, tuple(self.rng.choices(types, k=self.rng.randint(0, 3))))
            for i, kind in enumerate(kinds)
        ]
        names = self.rng.sample(list(PREDICATES), k=self.rng.randint(0, 2))
        return own + [
            Predicate(name, PREDICATES[name].kind, PREDICATES[name].types, self.chance(0.9)) for name in names
        ]

    def type(self, depth: int = 0) -> Type:
        if self.chance(0.2) and depth < 3:
            return Type(Base.LIST, element=self.type(depth + 1) if self.chance(0.7) else None)
        base = self.rng.choice([base for base in Base if base is not Base.LIST])
        return Type(base, self.rng.choice(["", "area", "s" + self.word()]) if base is Base.SYMBOL else "")

    def value(self, kind: Type = OPEN, depth: int = 0) -> Value:
        rng = self.rng
        base = kind.base
        if base is Base.OPEN:
            base = rng.choice([base for base in Base if base is not Base.OPEN and (depth < 3 or base is not Base.LIST)])
        values: dict[Base, Value] = {
            Base.ROBOT: Robot(rng.choice(ROBOTS)),
            Base.INT: rng.choice([0, 1, -1, 2, 300, INT_MAX, INT_MIN, rng.randint(-99, 99)]),
            Base.FLOAT: rng.choice([0.0, -0.0, 1.0, 1.5, -1e300, 5e-324, rng.random()]),
            Base.BOOL: self.chance(0.5),
            Base.STRING: rng.choice(["", "äß", '"\n', self.word()]),
            Base.SYMBOL: Symbol(rng.choice(["a", "b", "s" + self.word()])),
        }
        if base is not Base.LIST:
            return values[base]
        return tuple(self.value(kind.element or OPEN, depth + 1) for _ in range(rng.randint(0, 3)))

    # ---- expressions

    def code(self, bound: Bound, kind: Type, depth: int = 0, now: bool = True) -> Code:
        """An expression, mostly of type `kind`."""
        fitting = [slot for slot, known in bound.items() if known == kind or self.chance(0.03)]
        if fitting and self.chance(0.6):
            return (Instruction(Op.LOAD, self.rng.choice(fitting)),)
        if depth < 3 and self.chance(0.4):
            return self.compound(lambda wanted: self.code(bound, wanted, depth + 1, now), kind, now)
        return (self.constant(kind if self.chance(0.95) else OPEN),)

    def constant(self, kind: Type) -> Instruction:
        value = self.value(kind)
        return Instruction(Op.INT if type(value) is int and self.chance(0.8) else Op.CONST, value)

    def compound(self, part: Callable[[Type], Code], kind: Type, now: bool) -> Code:
        """An expression with parts."""
        shapes = [self.choice, self.choice, self.any_call]
        if kind.base in (Base.INT, Base.FLOAT, Base.OPEN):
            shapes += [self.number] * 4
        if kind.base is Base.BOOL:
            shapes += [self.condition] * 8
        if kind.base is Base.LIST:
            shapes += [self.list] * 8
        code = self.rng.choice(shapes)(part, kind)
        return code if now or CALL["now"] not in code else part(kind)

    def choice(self, part: Callable[[Type], Code], kind: Type) -> Code:
        yes, no = part(kind), part(kind)
        skip, leave = Instruction(Op.JUMP_IF_FALSE, len(yes) + 1), Instruction(Op.JUMP, len(no))
        return (*part(BOOL), skip, *yes, leave, *no)

    def number(self, part: Callable[[Type], Code], kind: Type) -> Code:
        if self.chance(0.6):
            return (*part(kind), *part(kind), Instruction(self.rng.choice(ARITHMETIC)))
        return (*part(kind), Instruction(Op.FLOAT if kind is FLOAT else Op.NEG))

    def condition(self, part: Callable[[Type], Code], _: Type) -> Code:
        if self.chance(0.2):
            return (*part(BOOL), Instruction(Op.NOT))
        if self.chance(0.2):
            return (*part(OPEN), *part(Type(Base.LIST)), CALL["member"])
        if self.chance(0.3):
            right = part(BOOL)
            return (*part(BOOL), Instruction(self.rng.choice([Op.AND, Op.OR]), len(right)), *right)
        kind = self.rng.choice([INT, FLOAT, STRING, ROBOT, OPEN])
        return (*part(kind), *part(kind), Instruction(self.rng.choice(COMPARISON)))

    def list(self, part: Callable[[Type], Code], kind: Type) -> Code:
        which = self.rng.randrange(4)
        if which == 0:
            return (*part(kind), CALL["sort"])
        if which == 1:
            return (*part(kind), *part(INT), CALL["rest"])
        if which == 2:
            return (*part(kind), *part(kind), Instruction(Op.ADD))
        items = [part(kind.element or OPEN) for _ in range(self.rng.randint(0, 3))]
        return (*(each for item in items for each in item), Instruction(Op.LIST, len(items)))

    def any_call(self, part: Callable[[Type], Code], _: Type) -> Code:
        index = self.rng.randrange(len(FUNCTIONS))
        kinds = self.rng.choices([INT, FLOAT, ROBOT, Type(Base.LIST, element=INT)], k=FUNCTIONS[index].arity)
        return (*(each for kind in kinds for each in part(kind)), Instruction(Op.CALL, index))

    def argument(self, bound: Bound, kind: Type) -> Code:
        """The expression of a derived argument: a constant alone has the type that is declared."""
        code = self.code(bound, kind)
        lone = len(code) == 1 and code[0].op in (Op.CONST, Op.INT)
        return (self.constant(kind),) if lone else code

    def owner(self, bound: Bound) -> Code:
        robots = [slot for slot, kind in bound.items() if kind.base in (Base.ROBOT, Base.OPEN)]
        if self.chance(0.6):
            return SELF
        return (self.constant(ROBOT),) if self.chance(0.4) else (Instruction(Op.LOAD, self.rng.choice(robots)),)

    # ---- bodies

    def pattern(self, kind: Type, slots: range, bound: Bound) -> Pattern:
        fitting = [slot for slot in slots if bound.get(slot, kind) == kind]
        choice = self.rng.random()
        if choice < 0.15 or (choice < 0.75 and not fitting):
            return ANY
        return Slot(self.rng.choice(fitting)) if choice < 0.75 else Constant(self.value(kind))

    def atom(self, slots: range, bound: Bound, linear: tuple[Mode, ...] = (Mode.CONSUME, Mode.KEEP)) -> Atom:
        """An atom; `bound` grows by what it binds."""
        predicate = self.rng.choice(self.facts)
        declared = self.bare[predicate]
        mode = self.rng.choice(linear) if declared.kind is Kind.TEMPORARY else Mode.READ
        if len(linear) > 1 and self.chance(0.15):
            mode = Mode.ABSENT
        args = []
        fresh = dict(bound)
        for kind in declared.types:
            args.append(self.pattern(kind, slots, fresh))
            if isinstance(args[-1], Slot):
                fresh.setdefault(args[-1].index, kind)
        if mode is not Mode.ABSENT:
            bound.update(fresh)
        return Atom(predicate, tuple(args), mode)

    def body(self, slots: range, bound: Bound) -> tuple[Conjunct, ...]:
        """A body that may bind `slots`; `bound` grows."""
        body: list[Conjunct] = []
        for _ in range(self.rng.randint(0, 3)):
            free = [slot for slot in slots if slot not in bound]
            if self.chance(0.6):
                body.append(self.atom(slots, bound))
            elif self.chance(0.5) or not free:
                body.append(Guard(self.code(bound, BOOL, now=False)))
            else:
                kind = self.rng.choice([INT, OPEN, ROBOT, Type(Base.LIST, element=INT)])
                code = self.code(bound, kind, now=False)
                body.append(Bind(free[0], code))
                bound[free[0]] = kind if len(code) > 1 else APART
        return tuple(body)

    # ---- heads

    def item(self, bound: Bound) -> Derived:
        kind: type[Derived] = self.rng.choice([DeriveFact, DeriveFact, DeriveGoal, DeriveAction])
        choices = {DeriveAction: self.actions, DeriveFact: self.unsensed, DeriveGoal: self.facts}
        predicate = self.rng.choice(choices[kind])
        args = tuple(self.argument(bound, each) for each in self.bare[predicate].types)
        return kind(predicate, self.owner(bound), args)

    def head(self, bound: Bound) -> Head:
        if self.chance(0.6):
            return self.item(bound)
        if self.chance(0.3):
            return Steps(tuple(self.item(bound) for _ in range(self.rng.randint(2, 4))))
        inner = dict(bound)
        body = self.body(INNER, inner)
        new = tuple(slot for slot in inner if slot not in bound)
        if self.chance(0.4):
            return Comprehension(new, body, tuple(self.item(inner) for _ in range(self.rng.randint(0, 2))))
        operator = self.rng.choice(list(Operator))
        term = None if operator is Operator.COUNT else self.code(inner, self.rng.choice([INT, FLOAT, STRING, OPEN]))
        visible = inner if operator in (Operator.MIN, Operator.MAX) else bound
        return Aggregate(operator, term, RESULT, new, body, self.item({**visible, RESULT: INT}))

    def rule(self) -> Rule:
        bound = here()
        body = self.body(OUTER, bound)
        return Rule(SLOTS, body, tuple(self.head(bound) for _ in range(self.rng.randint(0, 3))))

    # ---- the other tables

    def assertion(self) -> Assertion:
        bound = here()
        start = self.atom(OUTER, bound, (Mode.KEEP,))
        finish = self.atom(OUTER, dict(bound), (Mode.KEEP,))
        robots = [Slot(slot) for slot, kind in bound.items() if kind == ROBOT]
        action = self.rng.choice(self.actions)
        args = tuple(self.argument(bound, each) for each in self.bare[action].types)
        return Assertion(
            "a" + self.word(),
            SLOTS,
            start,
            finish,
            self.code(bound, self.rng.choice([INT, FLOAT])),
            DeriveAction(action, self.owner(bound), args),
            self.chance(0.5),
            tuple(self.serving() for _ in range(self.rng.randint(0, 2))),
            self.rng.choice([None, None, *ROBOTS]),
            self.rng.choice([Slot(0), *robots, Constant(Robot(self.rng.choice(ROBOTS)))]),
        )

    def serving(self) -> Serving:
        action = self.rng.choice(self.actions)
        return Serving(action, tuple(self.pattern(kind, OUTER, {}) for kind in self.bare[action].types))

    def effects(self, bound: Bound) -> tuple[Effect, ...]:
        made = []
        for _ in range(self.rng.randint(0, 2)):
            predicate = self.rng.choice(self.facts)
            args = tuple(self.argument(bound, kind) for kind in self.bare[predicate].types)
            owner = SELF if self.bare[predicate].kind is Kind.SENSED else self.owner(bound)
            made.append(Effect(predicate, args, owner))
        return tuple(made)

    def complete(self, predicate: Predicate) -> Predicate:
        if predicate.kind is not Kind.ACTION:
            return predicate
        bound = {0: ROBOT, **dict(enumerate(predicate.types, 1))}
        return replace(predicate, effects=self.effects(bound), else_effects=self.effects(bound))

    def fact(self) -> InitialFact:
        predicate = self.rng.choice(self.facts)
        args = [
            Slot(0) if kind.base in (Base.ROBOT, Base.OPEN) and self.chance(0.3) else self.value(kind)
            for kind in self.bare[predicate].types
        ]
        return InitialFact(predicate, self.rng.choice([None, 0, 1, 7]), tuple(args))

    def goal(self, rules: int) -> InitialGoal:
        predicate = self.rng.choice(self.facts)
        types = self.bare[predicate].types
        alike = dict.fromkeys(range(1, 1 + len(types)), types[0]) if types else {}
        args = [
            Slot(0)
            if kind.base is Base.ROBOT and self.chance(0.3)
            else self.pattern(kind, range(1, 1 + len(types)), alike)
            for kind in types
        ]
        ranked = sorted(self.rng.sample(range(rules), k=self.rng.randint(0, rules)))
        leads = tuple(Lead(rule, self.rng.choice([None, 0, 1, 300])) for rule in ranked)
        return InitialGoal(predicate, self.rng.choice([None, 1, 9]), tuple(args), self.rng.choice([None, leads]))

    def debug(self, rules: int, assertions: int) -> Debug | None:
        def places(count: int) -> tuple[Place, ...]:
            files = self.rng.choices(["a.rmr", "b.rmr"], k=count)
            return tuple(Place(file, self.rng.randint(1, 999), self.rng.randint(1, 80)) for file in files)

        return Debug(places(rules), places(assertions), places(len(self.bare)))

    def program(self) -> Program:
        rules = tuple(self.rule() for _ in range(self.rng.randint(0, 5)))
        assertions = tuple(self.assertion() for _ in range(self.rng.randint(0, 2)))
        return Program(
            tuple(map(self.complete, self.bare)),
            tuple(self.fact() for _ in range(self.rng.randint(0, 8))),
            tuple(self.goal(len(rules)) for _ in range(self.rng.randint(0, 3))),
            rules,
            assertions,
            self.rng.choice(list(Strategy)),
            self.debug(len(rules), len(assertions)),
        )
