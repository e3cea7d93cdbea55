"""Byte-code expressions as Python expressions, for generated engines.

For all values that are what is known of them, the source has exactly the value of `rmr.vm.evaluate`, its type
included, or raises NoValue with the same message. Code without a tree is handed to `evaluate` itself. Where a branch
is taken only if a condition is true, what the condition says of variables is known in the branch.
"""

from collections.abc import Mapping

from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Code, OwnFunction
from rmr.vm.derive import draws_in
from rmr.vm.evaluate import CALLS_MAX, NESTED_CALLS_MAX, beyond, evaluate
from rmr.vm.generate.builder import FormBuilder
from rmr.vm.generate.form import If, Local, Raise, Reference, Return, Update, tuple_of
from rmr.vm.generate.function_source import called
from rmr.vm.generate.known import BOOL, NOTHING, Known, assumed, either, of_value
from rmr.vm.generate.operators import binary, listed, truth, unary
from rmr.vm.generate.source import DRAWS, Pool, Source, fails
from rmr.vm.generate.trees import Tree, tree


def expression(code: Code, names: Mapping[int, Reference], known: Mapping[int, Known], pool: Pool) -> Source:
    """Return the source of verified `code`.

    `names` are the variables that hold the slots, `known` what is known of them. The source expects the instant in
    a variable `now` and its functions and constants, which `pool` collects, among the globals.
    """
    structure = tree(code)
    if structure is None:
        return _interpreted(code, names, pool)
    return _Writer(names, pool).write(structure, known)


def write_function(build: FormBuilder, index: int, function: OwnFunction, pool: Pool) -> None:
    """Write a function of the program, whose code has a tree.

    Beside its arguments it takes the instant, how many calls are left, in a list, and how many calls it is within.
    """
    args = [f"a{place}" for place in range(function.arity)]
    names: dict[int, Reference] = {place: Local(arg) for place, arg in enumerate(args)}
    structure = tree(function.code)
    assert structure is not None
    source = _Writer(names, pool, "left, depth + 1").write(structure, {})
    refused = Raise(f"{pool.helper('beyond', beyond)}({function.name!r}, depth, {tuple_of(args)})")
    with build.function(own_name(index), "now", "left", "depth", *args):
        build(Update("left[0]", "-", "1"), If(f"depth > {NESTED_CALLS_MAX} or left[0] < 0", (refused,)))
        build(Return(source.text))


def own_name(index: int) -> str:
    """Return the name of the Python function for a function of the program."""
    return f"own{index}"


def condition(code: Code, names: Mapping[int, Reference], known: Mapping[int, Known], pool: Pool) -> Source:
    """Return the source of a guard: it is a Boolean, or raises NoValue."""
    return truth(expression(code, names, known, pool), pool)


def narrowed(code: Code, known: Mapping[int, Known]) -> dict[int, Known]:
    """Return what is known of the slots once the guard `code` is true."""
    structure = tree(code)
    return dict(known) if structure is None else assumed(structure, True, known)


def _interpreted(code: Code, names: Mapping[int, Reference], pool: Pool) -> Source:
    """Return a call of the interpreter."""
    used = {each.operand: True for each in code if each.op is Op.LOAD and isinstance(each.operand, int)}
    slots = "".join(f"{names[slot].text if slot in used else None}, " for slot in range(max(used, default=-1) + 1))
    if draws_in(code):
        slots += f"{DRAWS}, "
    text = f"{pool.helper('evaluate', evaluate)}({pool.object(code)}, ({slots.rstrip()}), now)"
    return Source(text, NOTHING, True)


class _Writer:
    """Writes trees with the same names; what is known differs from branch to branch."""

    def __init__(self, names: Mapping[int, Reference], pool: Pool, bounds: str = f"[{CALLS_MAX}], 1") -> None:
        """`bounds` are the arguments of calls of the program's functions that count and bound them."""
        self._names = names
        self._pool = pool
        self._bounds = bounds

    def write(self, node: Tree, known: Mapping[int, Known]) -> Source:
        """Return the source of `node`; the depth of trees is bounded."""
        op = node.op
        operand = node.operand
        pool = self._pool
        if op is Op.LOAD:
            assert isinstance(operand, int)
            reference = self._names[operand]
            return Source(reference.text, known.get(operand, NOTHING), False, isinstance(reference, Local))
        if op is Op.CONST or op is Op.INT:
            assert operand is not None
            return Source(pool.constant(operand), of_value(operand), False, type(operand) is not str, operand)
        if op in (Op.AND, Op.OR, Op.JUMP_IF_FALSE):
            return self._branch(node, known)
        parts = [self.write(part, known) for part in node.parts]
        if op is Op.LIST:
            return listed(parts, pool)
        if node.function is not None:
            assert isinstance(operand, int)
            args = "".join([f", {part.text}" for part in parts])
            return Source(f"{own_name(operand)}(now, {self._bounds}{args})", NOTHING, True)
        if op is Op.CALL:
            assert isinstance(operand, int)
            return called(FUNCTIONS[operand], parts, pool)
        return binary(op, parts[0], parts[1], pool) if len(parts) == 2 else unary(op, parts[0], pool)

    def _branch(self, node: Tree, known: Mapping[int, Known]) -> Source:
        decider = node.parts[0]
        decided = truth(self.write(decider, known), self._pool)
        then = self.write(node.parts[1], assumed(decider, node.op is not Op.OR, known))
        if node.op is not Op.JUMP_IF_FALSE:
            word = "and" if node.op is Op.AND else "or"
            return Source(f"({decided.text} {word} {then.text})", either(BOOL, then.known), fails(decided, then))
        otherwise = self.write(node.parts[2], assumed(decider, False, known))
        text = f"({then.text} if {decided.text} else {otherwise.text})"
        return Source(text, either(then.known, otherwise.known), fails(decided, then, otherwise))
