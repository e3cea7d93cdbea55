"""The verifier's checks of the parts of an entry: patterns, atoms, bodies, expressions, derived items.

Each check is a generator of reasons, empty if the part is sound. A constant or expression is examined once for all
entries that share it: checking a long list again for every entry that refers to it would let a small forged file take
hours.

An expression is first examined by itself, independent of its uses: operands are in range; jumps stay inside and go
forward; every instruction is reachable; on every path the stack holds the operands of each instruction, and exactly one
value is left. Whether its slots are bound is checked at each use.
"""

import re
from collections.abc import Iterable, Iterator, Sequence

from rmr.base.record import record
from rmr.base.values import Symbol, Value
from rmr.bytecode.conform import conforms, sound
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.limits import SLOTS_MAX, STACK_MAX
from rmr.bytecode.opcodes import FORMS, Op, Operand
from rmr.bytecode.program import (
    Aggregate,
    Anything,
    Atom,
    Base,
    Bind,
    Code,
    Conjunct,
    DeriveAction,
    Derived,
    DeriveFact,
    Effect,
    Fold,
    Guard,
    Instruction,
    Kind,
    Mode,
    Operator,
    OwnFunction,
    Pattern,
    Predicate,
    Slot,
    Type,
)
from rmr.bytecode.scope import UNKNOWN, Scope, literal

TIMED = frozenset(index for index, function in enumerate(FUNCTIONS) if function.timed)
"""Indices of the functions of time."""
DRAWN = frozenset(index for index, function in enumerate(FUNCTIONS) if function.drawn)
"""Indices of the functions of chance."""
JUMPS = (Op.JUMP, Op.JUMP_IF_FALSE, Op.AND, Op.OR)
"""Instructions with a jump target."""
_NAME = re.compile(r"[a-z][A-Za-z0-9_]*")

# ---- constants


def is_name(text: str) -> bool:
    """Tell whether `text` is an identifier: of a predicate, a symbol, a symbol set or an assertion."""
    return _NAME.fullmatch(text) is not None


class Constants:
    """Checks of constants, memoised by identity: the checked values must outlive the object.

    Decoded entries share the values of the table of constants.
    """

    def __init__(self) -> None:
        self._proper: dict[int, bool] = {}
        self._conforming: dict[tuple[int, str], bool] = {}

    def proper(self, value: Value) -> bool:
        """Tell whether a program may hold `value`: it is sound, and its symbols are names."""
        if type(value) is not tuple:
            return _is_proper(value)
        if id(value) not in self._proper:
            self._proper[id(value)] = sound(value) and _is_proper(value)
        return self._proper[id(value)]

    def conforms(self, value: Value, kind: Type) -> bool:
        """Tell whether a program may hold `value` in the place of type `kind`."""
        if type(value) is not tuple:
            return self.proper(value) and conforms(value, kind)
        key = (id(value), _shape(kind))
        if key not in self._conforming:
            self._conforming[key] = self.proper(value) and conforms(value, kind)
        return self._conforming[key]


def _is_proper(value: Value) -> bool:
    if type(value) is tuple:
        return all(map(_is_proper, value))
    return is_name(value) if type(value) is Symbol else sound(value)


def _shape(kind: Type) -> str:
    """Return a key of the type without the names of symbol sets, which conformance ignores."""
    if kind.base is Base.LIST:
        return "list " + (_shape(kind.element) if kind.element is not None else "")
    return kind.base.name


# ---- an expression by itself


@record
class Examined:
    """The properties of an expression."""

    wrong: str
    """The first defect; empty for a sound expression."""
    slots: int
    """The slots that it reads, as a bit mask."""
    timed: bool
    """Whether it calls a function of time."""
    drawn: bool
    """Whether it calls a function of chance."""


def examine(code: Code, constants: Constants, functions: Sequence[OwnFunction] = ()) -> Examined:
    """Return the properties of `code` in a program that has `functions`."""
    wrong = next((reason for each in code for reason in _operand(each, constants, functions)), "") or _unbalanced(code)
    if wrong:
        return Examined(wrong, 0, False, False)
    slots = 0
    for slot in {i.operand: None for i in code if i.op is Op.LOAD}:
        assert isinstance(slot, int)
        slots |= 1 << slot
    calls = {i.operand: None for i in code if i.op is Op.CALL}
    return Examined("", slots, any(each in TIMED for each in calls), any(each in DRAWN for each in calls))


def _operand(instruction: Instruction, constants: Constants, functions: Sequence[OwnFunction]) -> Iterator[str]:
    """Check the operand against the opcode table."""
    op = instruction.op
    operand = instruction.operand
    form = FORMS[op].operand
    if form is Operand.NONE:
        if operand is not None:
            yield f"{op.name} takes no operand"
    elif operand is None or (form is not Operand.CONSTANT and type(operand) is not int):
        yield f"{op.name} without a proper operand"
    elif not constants.proper(operand):
        yield f"{op.name} with a value out of range"
    elif form is Operand.SLOT and not 0 <= operand < SLOTS_MAX:  # type: ignore[operator]
        yield f"there is no slot {operand}"
    elif form in (Operand.COUNT, Operand.SKIP) and operand < 0:  # type: ignore[operator]
        yield f"{op.name} with the negative operand {operand}"
    elif form is Operand.OWN and not _is_of(instruction, functions):
        yield f"there is no function {operand} of the program"
    elif form is Operand.FUNCTION and not 0 <= operand < len(FUNCTIONS):  # type: ignore[operator]
        yield f"there is no function {operand}"


def _is_of(instruction: Instruction, functions: Sequence[OwnFunction]) -> bool:
    """Tell whether an instruction refers to one of `functions`."""
    index = instruction.operand
    assert isinstance(index, int)
    return 0 <= index < len(functions) and instruction.function is functions[index]


def _unbalanced(code: Code) -> str:
    """Return the first defect of control flow or stack depth, else an empty string.

    An abstract interpretation with the stack depth as state; one pass suffices, because jumps only go forward.
    """
    depths: list[int | None] = [0] + [None] * len(code)
    for index, instruction in enumerate(code):
        depth = depths[index]
        if depth is None:
            return f"instruction {index} is never reached"
        pops, pushes = _effect(instruction)
        if depth < pops or depth - pops + pushes > STACK_MAX:
            return f"instruction {index} ({instruction.op.name}) with {depth} values on the stack"
        for target, after in _successors(index, instruction, depth, depth - pops + pushes):
            if not index < target <= len(code):
                return f"instruction {index} jumps out of the expression"
            if depths[target] not in (None, after):
                return f"the ways to instruction {target} leave different numbers of values"
            depths[target] = after
    return "" if depths[-1] == 1 else f"the expression leaves {depths[-1] or 0} values instead of one"


def _effect(instruction: Instruction) -> tuple[int, int]:
    """Return the numbers of values that an instruction pops and pushes."""
    form = FORMS[instruction.op]
    if form.pops >= 0:
        return form.pops, form.pushes
    if instruction.function is not None:
        return instruction.function.arity, form.pushes
    operand = instruction.operand
    assert isinstance(operand, int)
    return (FUNCTIONS[operand].arity if form.operand is Operand.FUNCTION else operand), form.pushes


def _successors(index: int, instruction: Instruction, before: int, after: int) -> Iterator[tuple[int, int]]:
    """Yield the possible next instructions, each with the stack depth there."""
    op = instruction.op
    if op is not Op.JUMP:
        yield index + 1, after
    if op in JUMPS:
        assert isinstance(instruction.operand, int)
        # A short circuit keeps the left operand as the result; falling through has popped it.
        kept = before if op in (Op.AND, Op.OR) else after
        yield index + 1 + instruction.operand, kept


# ---- parts of an entry


def result_type(part: Fold | Aggregate) -> Type:
    """Return the static type of the result of a fold or an aggregate."""
    return Type(Base.INT) if part.operator is Operator.COUNT else UNKNOWN


class Checks:
    """The checks of one program's parts, with the results for shared constants and expressions."""

    def __init__(self, predicates: tuple[Predicate, ...], functions: tuple[OwnFunction, ...]) -> None:
        self.predicates = predicates
        self._functions = functions
        self.may_draw = False
        """Whether the head of a rule is being checked: chance has no other place."""
        self.constants = Constants()
        self._examined: dict[int, Examined] = {}
        """Results by identity of the expression, which the program keeps alive; hashing it would visit all of it."""

    def usable(self, index: int, arity: int, *, action: bool) -> Iterator[str]:
        """Check that `index` names a predicate (or an action) with `arity` arguments."""
        if not 0 <= index < len(self.predicates):
            yield f"there is no predicate {index}"
            return
        predicate = self.predicates[index]
        if (predicate.kind is Kind.ACTION) != action:
            yield f"{predicate.name} is {'not ' if action else ''}an action"
        if arity != len(predicate.types):
            yield f"{predicate.name} with {arity} arguments instead of {len(predicate.types)}"

    def patterns(self, index: int, args: tuple[Pattern, ...], slots: int, *, action: bool = False) -> Iterator[str]:
        """Check the arguments of an atom of a rule or assertion with `slots` slots."""
        wrong = list(self.usable(index, len(args), action=action))
        yield from wrong
        if wrong:
            return
        predicate = self.predicates[index]
        for position, (pattern, kind) in enumerate(zip(args, predicate.types, strict=True)):
            if isinstance(pattern, Slot):
                if not 0 <= pattern.index < slots:
                    yield f"{predicate.name} uses slot {pattern.index} of {slots}"
            elif not isinstance(pattern, Anything) and not self.constants.conforms(pattern.value, kind):
                yield f"argument {position + 1} of {predicate.name} has the wrong type"

    def body(self, body: Iterable[Conjunct], slots: int, scope: Scope) -> Iterator[str]:
        """Check a body; its bindings are added to `scope`."""
        folded = False
        for conjunct in body:
            match conjunct:
                case Atom():
                    if folded and conjunct.mode is not Mode.ABSENT:
                        yield "an atom behind a fold"
                    yield from self.atom(conjunct, slots, scope)
                case Fold():
                    folded = True
                    yield from self._fold(conjunct, slots, scope)
                case Guard(code=code):
                    yield from self.code(code, scope, now=False)
                case Bind():
                    yield from self._bind(conjunct, slots, scope)

    def atom(self, atom: Atom, slots: int, scope: Scope) -> Iterator[str]:
        """Check an atom; its bindings are added to `scope`."""
        wrong = list(self.patterns(atom.predicate, atom.args, slots))
        yield from wrong
        if wrong:
            return
        predicate = self.predicates[atom.predicate]
        linear = predicate.kind is Kind.TEMPORARY
        if atom.mode is not Mode.ABSENT and linear != (atom.mode in (Mode.CONSUME, Mode.KEEP)):
            yield f"{atom.mode.name} of {predicate.name}, which is {predicate.kind.name}"
        scope.match(atom, predicate)

    def _fold(self, fold: Fold, slots: int, scope: Scope) -> Iterator[str]:
        listed = Scope(scope)
        for slot in fold.slots:
            yield from self.new(slot, UNKNOWN, slots, listed)
        inner = Scope(scope)
        yield from self.body(fold.body, slots, inner)
        if inner.bound & ~listed.bound:
            yield "an inner body binds a variable that is not listed"
        if any(isinstance(each, Fold) for each in fold.body):
            yield "a fold within a fold"
        if any(isinstance(each, Atom) and each.mode is Mode.CONSUME for each in fold.body):
            yield "a fold that consumes"
        yield from self.term(fold, inner)
        if fold.result in fold.slots:
            yield f"slot {fold.result} is the result and a variable of the matches"
        yield from self.new(fold.result, result_type(fold), slots, scope)

    def term(self, part: Fold | Aggregate, inner: Scope) -> Iterator[str]:
        """Check the term of a fold or an aggregate."""
        if (part.term is None) != (part.operator is Operator.COUNT):
            yield f"{part.operator.name} with a wrong number of terms"
        if part.term is not None:
            yield from self.code(part.term, inner, now=isinstance(part, Aggregate))

    def _bind(self, bind: Bind, slots: int, scope: Scope) -> Iterator[str]:
        yield from self.code(bind.code, scope, now=False)
        yield from self.new(bind.slot, scope.type_of(bind.code), slots, scope)

    @staticmethod
    def new(slot: int, kind: Type, slots: int, scope: Scope) -> Iterator[str]:
        """Check that `slot` is in range and unbound; bind it in `scope`."""
        if not 0 <= slot < slots:
            yield f"binds slot {slot} of {slots}"
        elif scope.has(slot):
            yield f"slot {slot} is bound twice"
        else:
            scope.bind(slot, kind)

    def derived(self, item: Derived | Effect, scope: Scope) -> Iterator[str]:
        """Check an item that a head, a violation or an effect derives."""
        yield from self.robot(item.owner, scope)
        wrong = list(self.usable(item.predicate, len(item.args), action=isinstance(item, DeriveAction)))
        yield from wrong
        for code in item.args:
            yield from self.code(code, scope)
        if wrong:
            return
        predicate = self.predicates[item.predicate]
        if isinstance(item, DeriveFact) and predicate.kind is Kind.SENSED:
            yield f"{predicate.name} is sensed, so no rule may derive it"
        for position, (code, kind) in enumerate(zip(item.args, predicate.types, strict=True)):
            value = literal(code)
            if value is not None and not self.constants.conforms(value, kind):
                yield f"argument {position + 1} of {predicate.name} has the wrong type"

    def robot(self, code: Code, scope: Scope) -> Iterator[str]:
        """Check the expression of an owner or executor: its static type admits a robot."""
        wrong = list(self.code(code, scope))
        yield from wrong
        value = literal(code)
        known = scope.type_of(code).base
        if not wrong and (known not in (Base.ROBOT, Base.OPEN) or type(value) is tuple):
            yield "an owner or executor that is not a robot"

    def code(self, code: Code, scope: Scope, *, now: bool = True) -> Iterator[str]:
        """Check one expression under the bindings of `scope`; `now`: the functions of time are allowed."""
        known = self._examined.get(id(code))
        if known is None:
            known = self._examined[id(code)] = examine(code, self.constants, self._functions)
        unbound = known.slots & ~scope.bound
        if known.wrong:
            yield known.wrong
        elif unbound:
            yield f"slot {unbound.bit_length() - 1} is used before it is bound"
        elif known.timed and not now:
            yield "now() in a body, but only heads may read the time"
        elif known.drawn and not (now and self.may_draw):
            yield "random() outside of a head"
