"""What must hold of a program before anything of it runs.

The virtual machine then need not check: every index is in range, every argument list as long as its
predicate says, every slot bound before it is used, every expression leaves exactly one value and ends
(jumps go forward only), a body consumes only what can be consumed, constants have the type that the
predicate declares. What only values decide (division by zero, a type that nothing fixed) stays with the
evaluation.
"""

from collections.abc import Callable, Iterable, Iterator
from math import isfinite

from rmr.base.values import INT_MAX, INT_MIN, ROBOT_ID_MAX, Robot, Symbol, Value
from rmr.bytecode.opcodes import FORMS, FUNCTIONS, Op, Operand
from rmr.bytecode.program import (
    SELF_SLOT,
    Anything,
    Assertion,
    Atom,
    Base,
    Bind,
    Code,
    Comprehension,
    Conjunct,
    Constant,
    DeriveAction,
    DeriveFact,
    DeriveGoal,
    Guard,
    Head,
    Instruction,
    Kind,
    Mode,
    Pattern,
    Predicate,
    Program,
    Rule,
    Slot,
    Type,
)
from rmr.bytecode.wire import NESTING_MAX

SLOTS_MAX = 1024
"""Variables of a rule: a robot holds that many values for each match it looks at."""

STACK_MAX = 256
"""Values on the stack of an expression."""

NOW = next(i for i, function in enumerate(FUNCTIONS) if function.name == "now")
JUMPS = (Op.JUMP, Op.JUMP_IF_FALSE, Op.AND, Op.OR)

_CLASSES: dict[Base, type] = {
    Base.ROBOT: Robot,
    Base.INT: int,
    Base.BOOL: bool,
    Base.STRING: str,
    Base.SYMBOL: Symbol,
}


def verify(program: Program) -> list[str]:
    """Return the reasons for which `program` must not run, in the order of its tables; none if it is sound."""
    return list(_Verifier(program).reasons())


def conforms(value: Value, kind: Type) -> bool:
    """Tell whether `value` may stand where `kind` is declared (an int is no float)."""
    return checker(kind)(value)


def checker(kind: Type) -> Callable[[Value], bool]:
    """Return the function that tells whether a value conforms to `kind`."""
    if kind.base is Base.OPEN:
        return sound
    if kind.base is Base.LIST:
        element = checker(kind.element or Type(Base.OPEN))
        return lambda value: type(value) is tuple and sound(value) and all(map(element, value))
    if kind.base is Base.FLOAT:
        return lambda value: type(value) is float and isfinite(value)
    wanted = _CLASSES[kind.base]
    if wanted in (int, Robot):
        return lambda value: type(value) is wanted and sound(value)
    return lambda value: type(value) is wanted


def sound(value: Value, nesting: int = 0) -> bool:
    """Tell whether `value` is one that facts may carry: 64-bit, finite, lists not nested without bound."""
    kind = type(value)
    if kind is float:
        return isfinite(value)  # type: ignore[arg-type]
    if kind is int:
        return INT_MIN <= value <= INT_MAX  # type: ignore[operator]
    if kind is Robot:
        return 0 <= value <= ROBOT_ID_MAX  # type: ignore[operator]
    if kind is tuple:
        return nesting < NESTING_MAX and all(sound(item, nesting + 1) for item in value)  # type: ignore[union-attr]
    return kind in (bool, str, Symbol)


class _Verifier:
    """Walks the tables of one program."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.predicates = program.predicates

    def reasons(self) -> Iterator[str]:
        seen: dict[str, int] = {}
        for index, predicate in enumerate(self.predicates):
            where = f"predicate {predicate.name or index}"
            if not predicate.name or seen.setdefault(predicate.name, index) != index:
                yield f"{where}: its name is empty or taken"
            yield from self.predicate(where, predicate)
        for index, fact in enumerate(self.program.facts):
            where = f"fact {index}"
            yield from self.stated(where, fact.predicate, fact.owner, [Constant(value) for value in fact.args])
        for index, goal in enumerate(self.program.goals):
            yield from self.stated(f"goal {index}", goal.predicate, goal.owner, goal.args)
        for index, rule in enumerate(self.program.rules):
            yield from self.rule(f"rule {index}", rule)
        for index, assertion in enumerate(self.program.assertions):
            yield from self.assertion(f"assertion {assertion.name or index}", assertion)

    def predicate(self, where: str, predicate: Predicate) -> Iterator[str]:
        effects = (*predicate.effects, *predicate.else_effects)
        if effects and predicate.kind is not Kind.ACTION:
            yield f"{where}: only an action has effects"
        bound = set(range(len(predicate.types) + 1))
        for effect in effects:
            yield from self.derives(where, effect.predicate, effect.args, bound, action=False)

    def stated(self, where: str, index: int, owner: int | None, args: Iterable[Pattern]) -> Iterator[str]:
        if owner is not None and not 0 <= owner <= ROBOT_ID_MAX:
            yield f"{where}: owner {owner} is no robot"
        yield from self.patterns(where, index, tuple(args), 0, action=False)

    def usable(self, where: str, index: int, arity: int, *, action: bool) -> Iterator[str]:
        """Check that `index` names a predicate (or an action) with `arity` arguments."""
        if not 0 <= index < len(self.predicates):
            yield f"{where}: there is no predicate {index}"
            return
        predicate = self.predicates[index]
        if (predicate.kind is Kind.ACTION) != action:
            yield f"{where}: {predicate.name} is {'not ' if action else ''}an action"
        if arity != len(predicate.types):
            yield f"{where}: {predicate.name} with {arity} arguments instead of {len(predicate.types)}"

    def patterns(self, where: str, index: int, args: tuple[Pattern, ...], slots: int, *, action: bool) -> Iterator[str]:
        wrong = list(self.usable(where, index, len(args), action=action))
        yield from wrong
        if wrong:
            return
        predicate = self.predicates[index]
        for position, (pattern, kind) in enumerate(zip(args, predicate.types, strict=True)):
            if isinstance(pattern, Slot):
                if not 0 <= pattern.index < slots:
                    yield f"{where}: {predicate.name} uses slot {pattern.index} of {slots}"
            elif not isinstance(pattern, Anything) and not conforms(pattern.value, kind):
                yield f"{where}: argument {position + 1} of {predicate.name} has the wrong type"

    def slots(self, where: str, count: int) -> Iterator[str]:
        if not 1 <= count <= SLOTS_MAX:
            yield f"{where}: {count} slots, at least 1 and at most {SLOTS_MAX} are possible"

    def rule(self, where: str, rule: Rule) -> Iterator[str]:
        yield from self.slots(where, rule.slots)
        bound = {SELF_SLOT}
        yield from self.body(where, rule.body, rule.slots, bound)
        for head in rule.head:
            yield from self.head(where, head, rule.slots, bound)

    def body(self, where: str, body: tuple[Conjunct, ...], slots: int, bound: set[int]) -> Iterator[str]:
        """Check a body; `bound` grows by what it binds."""
        for conjunct in body:
            if isinstance(conjunct, Atom):
                yield from self.atom(where, conjunct, slots, bound)
            elif isinstance(conjunct, Guard):
                yield from self.code(where, conjunct.code, bound, now=False)
            else:
                yield from self.bind(where, conjunct, slots, bound)

    def atom(self, where: str, atom: Atom, slots: int, bound: set[int]) -> Iterator[str]:
        wrong = list(self.patterns(where, atom.predicate, atom.args, slots, action=False))
        yield from wrong
        if wrong:
            return
        predicate = self.predicates[atom.predicate]
        linear = predicate.kind is Kind.TEMPORARY
        if atom.mode is not Mode.ABSENT and linear != (atom.mode in (Mode.CONSUME, Mode.KEEP)):
            yield f"{where}: {atom.mode.name} of {predicate.name}, which is {predicate.kind.name}"
        if atom.mode is not Mode.ABSENT:
            bound.update(pattern.index for pattern in atom.args if isinstance(pattern, Slot))

    def bind(self, where: str, bind: Bind, slots: int, bound: set[int]) -> Iterator[str]:
        yield from self.code(where, bind.code, bound, now=False)
        if not 0 <= bind.slot < slots:
            yield f"{where}: binds slot {bind.slot} of {slots}"
        elif bind.slot in bound:
            yield f"{where}: slot {bind.slot} is bound twice"
        bound.add(bind.slot)

    def head(self, where: str, head: Head, slots: int, bound: set[int], nested: bool = False) -> Iterator[str]:
        if isinstance(head, DeriveFact | DeriveGoal | DeriveAction):
            yield from self.derivation(where, head, bound)
        elif nested:
            yield f"{where}: a comprehension inside a comprehension"
        else:
            yield from self.comprehension(where, head, slots, bound)

    def derivation(self, where: str, head: DeriveFact | DeriveGoal | DeriveAction, bound: set[int]) -> Iterator[str]:
        yield from self.code(where, head.owner, bound)
        yield from self.derives(where, head.predicate, head.args, bound, action=isinstance(head, DeriveAction))

    def derives(
        self, where: str, index: int, args: tuple[Code, ...], bound: set[int], *, action: bool
    ) -> Iterator[str]:
        yield from self.usable(where, index, len(args), action=action)
        for code in args:
            yield from self.code(where, code, bound)

    def comprehension(self, where: str, head: Comprehension, slots: int, bound: set[int]) -> Iterator[str]:
        inner = set(bound)
        yield from self.body(where, head.body, slots, inner)
        if bound & set(head.slots):
            yield f"{where}: a comprehension's new variable is bound already"
        if inner - bound - set(head.slots):
            yield f"{where}: a comprehension binds a variable that it does not list"
        for item in head.head:
            yield from self.head(where, item, slots, inner, nested=True)

    def assertion(self, where: str, assertion: Assertion) -> Iterator[str]:
        yield from self.slots(where, assertion.slots)
        start, finish = assertion.start, assertion.finish
        yield from self.patterns(where, start.predicate, start.args, assertion.slots, action=False)
        yield from self.patterns(where, finish.predicate, finish.args, assertion.slots, action=False)
        bound = {SELF_SLOT, *(pattern.index for pattern in start.args if isinstance(pattern, Slot))}
        yield from self.code(where, assertion.deadline, bound)
        yield from self.derivation(where, assertion.violation, bound)
        for serving in assertion.serving:
            yield from self.patterns(where, serving.action, serving.args, assertion.slots, action=True)

    def code(self, where: str, code: Code, bound: set[int], *, now: bool = True) -> Iterator[str]:
        """Check one expression: operands, then the balance of the stack along every way through it."""
        wrong = [reason for instruction in code for reason in _operand(instruction, bound, now)]
        if not wrong:
            wrong = list(_balance(code))
        for reason in wrong:
            yield f"{where}: {reason}"


def _operand(instruction: Instruction, bound: set[int], now: bool) -> Iterator[str]:
    """Check that the operand is what the opcode table asks for."""
    op, operand = instruction.op, instruction.operand
    form = FORMS[op].operand
    if form is Operand.NONE:
        if operand is not None:
            yield f"{op.name} takes no operand"
    elif operand is None or (form is not Operand.CONSTANT and type(operand) is not int):
        yield f"{op.name} without a proper operand"
    elif not sound(operand):
        yield f"{op.name} with a value out of range"
    elif form is Operand.SLOT and operand not in bound:
        yield f"slot {operand} is used before it is bound"
    elif form in (Operand.COUNT, Operand.SKIP) and operand < 0:  # type: ignore[operator]
        yield f"{op.name} with the negative operand {operand}"
    elif form is Operand.FUNCTION:
        if not 0 <= operand < len(FUNCTIONS):  # type: ignore[operator]
            yield f"there is no function {operand}"
        elif operand == NOW and not now:
            yield "now() in a body: time alone satisfies no rule"


def _balance(code: Code) -> Iterator[str]:
    """Follow the stack's depth; jumps go forward, so one pass sees every way."""
    depths: list[int | None] = [0] + [None] * len(code)
    for index, instruction in enumerate(code):
        depth = depths[index]
        if depth is None:
            yield f"instruction {index} is never reached"
            return
        pops, pushes = _effect(instruction)
        if depth < pops or not 0 <= depth - pops + pushes <= STACK_MAX:
            yield f"instruction {index} ({instruction.op.name}) with {depth} values on the stack"
            return
        ways = list(_successors(index, instruction, depth, depth - pops + pushes))
        for target, after in ways:
            if not index < target <= len(code):
                yield f"instruction {index} jumps out of the expression"
                return
            if depths[target] not in (None, after):
                yield f"the ways to instruction {target} leave different numbers of values"
                return
            depths[target] = after
    if depths[len(code)] != 1:
        yield f"the expression leaves {depths[len(code)] or 0} values instead of one"


def _effect(instruction: Instruction) -> tuple[int, int]:
    """Return how many values an instruction pops and pushes."""
    form = FORMS[instruction.op]
    if form.pops >= 0:
        return form.pops, form.pushes
    operand = instruction.operand
    assert isinstance(operand, int)
    return (FUNCTIONS[operand].arity if form.operand is Operand.FUNCTION else operand), form.pushes


def _successors(index: int, instruction: Instruction, before: int, after: int) -> Iterator[tuple[int, int]]:
    """Return the instructions that may come next, with the stack's depth there."""
    op = instruction.op
    if op is not Op.JUMP:
        yield index + 1, after
    if op in JUMPS:
        assert isinstance(instruction.operand, int)
        kept = before if op in (Op.AND, Op.OR) else after
        yield index + 1 + instruction.operand, kept
