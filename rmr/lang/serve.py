"""Which actions serve a time assertion.

While a job has no turn, the actions that bring about its finish fact are held back. They are found by walking
backwards from that fact, through the rules that derive it, to the first actions whose declared effects lead
there: the last step towards the goal, not what prepares it. The walk is over patterns: an argument is a
constant, a variable of the start fact, or anything. Only the robot's own rules count; what other robots send
is not this robot's to hold back.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import replace

from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    ANY,
    SELF_SLOT,
    Anything,
    Assertion,
    Atom,
    Code,
    Comprehension,
    Conjunct,
    Constant,
    DeriveFact,
    Head,
    Mode,
    Pattern,
    Program,
    Serving,
    Slot,
)

STEPS_MAX = 2000
"""Facts looked at for one assertion; patterns are finite, but a program may have very many."""

Wanted = tuple[int, tuple[Pattern, ...]]
_Derivation = tuple[DeriveFact, list[Atom]]


def with_serving(program: Program) -> Program:
    """Return `program` with the actions that serve each scheduled assertion."""
    backwards = _Backwards(program)
    assertions = tuple(
        replace(each, serving=backwards.serving(each)) if each.scheduled else each for each in program.assertions
    )
    return replace(program, assertions=assertions)


class _Backwards:
    """The program read backwards: for each predicate, the effects and the rules that bring it about."""

    def __init__(self, program: Program) -> None:
        self._effects: dict[int, list[tuple[int, int, tuple[Code, ...]]]] = {}
        self._rules: dict[int, dict[Constant | None, list[_Derivation]]] = {}
        for index, action in enumerate(program.predicates):
            for effect in action.effects:
                self._effects.setdefault(effect.predicate, []).append((index, len(action.types), effect.args))
        for rule in program.rules:
            for derived, atoms in _derivations(rule.head, rule.body):
                if _is_home(derived.owner):
                    self._keep(derived, atoms)

    def _keep(self, derived: DeriveFact, atoms: list[Atom]) -> None:
        """File a derivation under its first argument's constant (None: it has none)."""
        first = _constant(derived.args[0]) if derived.args else None
        self._rules.setdefault(derived.predicate, {}).setdefault(first, []).append((derived, atoms))

    def _deriving(self, wanted: Wanted) -> Iterator[_Derivation]:
        """Yield the derivations of a predicate whose first argument may be the one that is wanted."""
        predicate, args = wanted
        filed = self._rules.get(predicate, {})
        if args and isinstance(args[0], Constant):
            yield from filed.get(args[0], ())
            yield from filed.get(None, ())
        else:
            yield from (each for group in filed.values() for each in group)

    def serving(self, assertion: Assertion) -> tuple[Serving, ...]:
        """Return the actions that serve `assertion`, in the order in which they are found."""
        start: Wanted = (assertion.finish.predicate, _known(assertion))
        seen: dict[Wanted, None] = {start: None}
        queue = deque([start])
        found: dict[Serving, None] = {}
        while queue and len(seen) < STEPS_MAX:
            wanted = queue.popleft()
            found.update(dict.fromkeys(self._actions(wanted)))
            for earlier in self._premises(wanted):
                if earlier not in seen:
                    seen[earlier] = None
                    queue.append(earlier)
        return tuple(found)

    def _actions(self, wanted: Wanted) -> Iterator[Serving]:
        """Yield the actions with an effect that is `wanted`."""
        predicate, args = wanted
        for index, arity, effect in self._effects.get(predicate, ()):
            bound = _unify(args, effect)
            if bound is not None:
                yield Serving(index, tuple(bound.get(slot, ANY) for slot in range(1, arity + 1)))

    def _premises(self, wanted: Wanted) -> Iterator[Wanted]:
        """Yield the facts that the rules need in order to derive what is `wanted`."""
        _, args = wanted
        for derived, atoms in self._deriving(wanted):
            bound = _unify(args, derived.args)
            if bound is not None:
                yield from (_wanted(atom, bound) for atom in atoms)


def _known(assertion: Assertion) -> tuple[Pattern, ...]:
    bound = {SELF_SLOT, *(each.index for each in assertion.start.args if isinstance(each, Slot))}
    return tuple(each if not isinstance(each, Slot) or each.index in bound else ANY for each in assertion.finish.args)


def _derivations(head: tuple[Head, ...], body: tuple[Conjunct, ...]) -> Iterator[tuple[DeriveFact, list[Atom]]]:
    atoms = [each for each in body if isinstance(each, Atom) and each.mode is not Mode.ABSENT]
    for part in head:
        if isinstance(part, DeriveFact):
            yield part, atoms
        elif isinstance(part, Comprehension):
            for derived, inner in _derivations(part.head, part.body):
                yield derived, [*atoms, *inner]


def _constant(code: Code) -> Constant | None:
    """Return the value of an expression that is a constant."""
    if len(code) != 1 or code[0].op not in {Op.CONST, Op.INT} or code[0].operand is None:
        return None
    return Constant(code[0].operand)


def _is_home(owner: Code) -> bool:
    return len(owner) == 1 and owner[0].op is Op.LOAD and owner[0].operand == SELF_SLOT


def _wanted(atom: Atom, bound: dict[int, Pattern]) -> Wanted:
    return atom.predicate, tuple(bound.get(each.index, ANY) if isinstance(each, Slot) else each for each in atom.args)


def _unify(args: tuple[Pattern, ...], codes: tuple[Code, ...]) -> dict[int, Pattern] | None:
    """Return what `codes`' slots must be for their values to match `args`, or None if they cannot."""
    bound: dict[int, Pattern] = {SELF_SLOT: Slot(SELF_SLOT)}
    for arg, code in zip(args, codes, strict=True):
        if len(code) != 1:
            continue
        [instruction] = code
        if instruction.op in {Op.CONST, Op.INT}:
            if isinstance(arg, Constant) and arg.value != instruction.operand:
                return None
        elif instruction.op is Op.LOAD and isinstance(instruction.operand, int):
            merged = _merged(bound.get(instruction.operand, ANY), arg)
            if merged is None:
                return None
            bound[instruction.operand] = merged
    return bound


def _merged(one: Pattern, other: Pattern) -> Pattern | None:
    if isinstance(one, Anything):
        return other
    if isinstance(one, Constant) and isinstance(other, Constant) and one.value != other.value:
        return None
    return one
