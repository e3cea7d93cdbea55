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
    Best,
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
    Fold,
    Guard,
    Head,
    HeadValue,
    InitialFact,
    InitialGoal,
    Instruction,
    Kind,
    Lead,
    Mode,
    Operator,
    OwnFunction,
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
    When,
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
SLOTS = 20
OUTER, INNER, RESULT = range(6), range(6, 11), 11
"""Slots that a rule's body may bind, those of an inner body, and an aggregate's result."""
FOLDED, FOLDS, VALUES = range(12, 15), range(15, 17), range(17, 19)
"""Slots that the inner body of a fold may bind, the results of folds, and values that a head works out."""
ROBOTS = [0, 1, 2, 200, ROBOT_ID_MAX]


def here() -> Bound:
    """The slots of a rule before its body."""
    return {0: ROBOT}


class Maker:
    """One program in the making."""

    own: list[OwnFunction]
    """The program's functions."""
    drawing = False
    """Whether the head of a rule is being made, which may call random()."""

    def __init__(self, seed: int) -> None:
        self.rng = Random(seed)
        self.own = []
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
            Predicate(
                f"p{i}{self.word()}",
                kind,
                tuple(self.rng.choices(types, k=self.rng.randint(0, 3))),
                unordered=i % 2 == 1 and kind is not Kind.SENSED,
            )
            for i, kind in enumerate(kinds)
        ]
        own = list(map(self.with_best, own))
        names = self.rng.sample(list(PREDICATES), k=self.rng.randint(0, 2))
        return own + [
            Predicate(name, PREDICATES[name].kind, PREDICATES[name].types, self.chance(0.9)) for name in names
        ]

    def with_best(self, predicate: Predicate) -> Predicate:
        """A persistent predicate of which only the best facts are kept, now and then."""
        ordered = (Base.INT, Base.FLOAT, Base.STRING)
        places = [place for place, kind in enumerate(predicate.types) if kind.base in ordered]
        if predicate.kind is not Kind.PERSISTENT or not places or self.chance(0.6):
            return predicate
        return replace(predicate, best=Best(self.rng.choice(places), self.chance(0.5)))

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
        if depth < 3 and self.own and self.chance(0.05):
            return self.applied(lambda wanted: self.code(bound, wanted, depth + 1, now))
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
        timed = CALL["now"] in code and not now
        drawn = CALL["random"] in code and not (now and self.drawing)
        return part(kind) if timed or drawn else code

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

    def applied(self, part: Callable[[Type], Code]) -> Code:
        """A call of a function of the program."""
        index = self.rng.randrange(len(self.own))
        function = self.own[index]
        args = [part(INT) for _ in range(function.arity)]
        return (*(each for arg in args for each in arg), Instruction(Op.APPLY, index, function))

    def functions(self) -> None:
        """Make the program's functions; each may call any of them."""
        names = self.rng.choices(["f", "let", "g"], k=self.rng.choice([0, 0, 0, 1, 2]))
        self.own = [OwnFunction(name, self.rng.choice([0, 1, 1, 2])) for name in names]
        for each in self.own:
            each.code = self.defined(dict.fromkeys(range(each.arity), INT))

    def defined(self, bound: Bound) -> Code:
        """The code of a function: one that calls functions does so mostly on a condition."""
        code = self.code(bound, INT, now=False)
        if self.chance(0.5) or not bound:
            return code
        calls = self.applied(lambda kind: self.code(bound, kind, 2, now=False))
        return self.choice(lambda kind: self.code(bound, kind, 2, now=False) if kind is BOOL else calls, INT)

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

    def folds(self, bound: Bound) -> tuple[Conjunct, ...]:
        """Folds behind the atoms of a body, and a condition on each; `bound` grows by their results."""
        found: list[Conjunct] = []
        for result in FOLDS:
            if self.chance(0.85):
                break
            inner = dict(bound)
            body = tuple(
                replace(each, mode=Mode.KEEP) if isinstance(each, Atom) and each.mode is Mode.CONSUME else each
                for each in self.body(FOLDED, inner)
            )
            operator = self.rng.choice(list(Operator))
            kind = self.rng.choice([INT, INT, FLOAT])
            term = None if operator is Operator.COUNT else self.code(inner, kind, now=False)
            new = tuple(slot for slot in inner if slot not in bound)
            found.append(Fold(operator, term, result, new, body))
            bound[result] = Type(Base.LIST) if operator is Operator.COLLECT else INT
            if self.chance(0.6):
                op = Instruction(self.rng.choice(COMPARISON))
                found.append(Guard((Instruction(Op.LOAD, result), *self.code(bound, bound[result], now=False), op)))
        return tuple(found)

    # ---- heads

    def heads(self, bound: Bound, count: int) -> tuple[Head, ...]:
        """The items of a head, some of them on a condition."""
        found: list[Head] = []
        self.drawing = True
        for value in VALUES:
            if self.chance(0.2):
                found.append(HeadValue(value, self.code(bound, BOOL)))
                bound[value] = BOOL
        values = [slot for slot in VALUES if slot in bound]
        for _ in range(count):
            item = self.head(bound)
            on_condition = values and self.chance(0.6)
            found.append(When(self.rng.choice(values), item) if on_condition else item)
        self.drawing = False
        return tuple(found)

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
        return Aggregate(operator, term, RESULT, new, body, (self.item({**visible, RESULT: INT}),))

    def rule(self) -> Rule:
        bound = here()
        body = self.body(OUTER, bound)
        body += self.folds(bound)
        return Rule(SLOTS, body, self.heads(bound, self.rng.randint(0, 3)))

    # ---- the other tables

    def assertion(self) -> Assertion:
        bound = here()
        start = self.atom(OUTER, bound, (Mode.KEEP,))
        finish = self.atom(OUTER, dict(bound), (Mode.KEEP,))
        robots = [Slot(slot) for slot, kind in bound.items() if kind == ROBOT]
        derive = self.rng.choice([DeriveAction, DeriveAction, DeriveFact])
        violation = self.rng.choice(self.actions if derive is DeriveAction else self.unsensed)
        args = tuple(self.argument(bound, each) for each in self.bare[violation].types)
        return Assertion(
            "a" + self.word(),
            SLOTS,
            start,
            finish,
            self.code(bound, self.rng.choice([INT, FLOAT])),
            derive(violation, self.owner(bound), args),
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
        self.functions()
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
            tuple(self.own),
        )
