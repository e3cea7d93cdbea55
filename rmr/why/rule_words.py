"""Rules, facts and expressions in program syntax, with the values that are known in place of variables.

A variable without a value has its name if that is known (`rmr.why.past.Variables`), else it is ``_``.
"""

from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Final

from rmr.base.time import Instant, in_seconds
from rmr.base.values import Robot, Value, format_value
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.hidden_words import hidden_words
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    Anything,
    Atom,
    Bind,
    Code,
    Conjunct,
    Constant,
    Fold,
    Kind,
    Mode,
    Pattern,
    Place,
    Program,
    Slot,
)


class Unknown(str):
    """The name of a variable, in the place of a value that it does not have."""

    __slots__ = ()


Env = Sequence[Value | Unknown | None]
"""Values of a rule's slots; None: unbound."""


def named(env: Sequence[Value | None], names: Mapping[int, str]) -> Env:
    """Return `env` with the names of variables without a value."""
    return [Unknown(names[slot]) if value is None and slot in names else value for slot, value in enumerate(env)]


_BINARY: Final = {
    Op.OR: ("||", 1),
    Op.AND: ("&&", 2),
    Op.EQ: ("=", 4),
    Op.NE: ("!=", 4),
    Op.LT: ("<", 4),
    Op.LE: ("<=", 4),
    Op.GT: (">", 4),
    Op.GE: (">=", 4),
    Op.ADD: ("+", 5),
    Op.SUB: ("-", 5),
    Op.MUL: ("*", 6),
    Op.DIV: ("/", 6),
    Op.MOD: ("%", 6),
}
"""Operators with their precedence, as docs/language.md orders them."""
_NOT: Final = 3
_MINUS: Final = 7
_ATOM: Final = 8

LENGTH_MAX: Final = 300
"""Characters of a fact or expression in an explanation; the middle of a longer one is left out."""


def seconds_text(at: Instant) -> str:
    """Return an instant of lab time as ``12.300 s``."""
    return f"{in_seconds(at):.3f} s"


def shortened(text: str) -> str:
    """Return `text` without its middle if it is longer than `LENGTH_MAX`."""
    half = LENGTH_MAX // 2
    return text if len(text) <= LENGTH_MAX else f"{text[:half]} ... {text[-half:]}"


def rule_place_of(program: Program, rule: int) -> Place | None:
    """Return where a rule stands; None without the debug section."""
    places = program.debug.rules if program.debug is not None else ()
    return places[rule] if rule < len(places) else None


def rule_name(program: Program, rule: int) -> str:
    """Return ``rule corridor.rmr:12``, or ``rule 3 of the byte-code`` without the debug section."""
    place = rule_place_of(program, rule)
    return f"rule {rule} of the byte-code" if place is None else f"rule {PurePath(place.file).name}:{place.line}"


def item_text(
    program: Program, predicate: int, owner: int | None, args: Sequence[Value | Pattern], mark: str = ""
) -> str:
    """Return a fact, goal (`mark` is ``?``) or action; an unknown `owner` or argument is ``_``."""
    declared = program.predicates[predicate]
    bang = "!" if declared.kind is Kind.PERSISTENT and not mark else mark
    first = "_" if owner is None else format_value(Robot(owner))
    words = hidden_words(program, predicate, [first, *map(_argument, args)]) if program.ensemble else None
    if words is not None:
        return shortened(words)
    return shortened(f"{bang}{declared.name}({', '.join([first, *map(_argument, args)])})")


def _argument(arg: Value | Pattern) -> str:
    if isinstance(arg, Unknown):
        return str(arg)
    if isinstance(arg, Constant):
        return format_value(arg.value)
    return "_" if isinstance(arg, Anything | Slot) else format_value(arg)


def atom_text(program: Program, atom: Atom, robot: int, env: Env) -> str:
    """Return the fact that an atom asks for, without ``not`` and ``$``."""
    return item_text(program, atom.predicate, robot, [_known(pattern, env) for pattern in atom.args])


def _known(pattern: Pattern, env: Env) -> Value | Pattern:
    value = env[pattern.index] if isinstance(pattern, Slot) and pattern.index < len(env) else None
    return pattern if value is None else value if isinstance(value, Unknown) else Constant(value)


def _value(value: Value | Unknown | None) -> str:
    if value is None:
        return "_"
    return str(value) if isinstance(value, Unknown) else format_value(value)


def conjunct_text(program: Program, conjunct: Conjunct, robot: int, env: Env) -> str:
    """Return a conjunct of a body."""
    if isinstance(conjunct, Atom):
        mark = {Mode.ABSENT: "not ", Mode.KEEP: "$"}.get(conjunct.mode, "")
        return mark + atom_text(program, conjunct, robot, env)
    if isinstance(conjunct, Fold):
        # Its own variables have another value in each match.
        own = [None if slot in conjunct.slots else value for slot, value in enumerate(env)]
        term = [] if conjunct.term is None else [expression_text(conjunct.term, own)]
        inner = [conjunct_text(program, each, robot, own) for each in conjunct.body]
        call = f"{conjunct.operator.name.lower()}({', '.join([*term, *inner])})"
        return f"{_value(env[conjunct.result])} = {shortened(call)}"
    if isinstance(conjunct, Bind):
        value = env[conjunct.slot]
        return f"{_value(value)} = {expression_text(conjunct.code, env)}"
    return expression_text(conjunct.code, env)


def expression_text(code: Code, env: Env) -> str:
    """Return an expression in infix notation."""
    return shortened(_infix(code, env)[0])


def _infix(code: Code, env: Env) -> tuple[str, int]:
    """Return an expression and its precedence."""
    stack: list[tuple[str, int]] = []
    index = 0
    while index < len(code):
        op = code[index].op
        operand = code[index].operand
        index += 1
        if op in (Op.AND, Op.OR):
            assert isinstance(operand, int)
            right = _infix(code[index : index + operand], env)
            stack.append(_joined(op, stack.pop(), right))
            index += operand
        elif op is Op.JUMP_IF_FALSE:
            assert isinstance(operand, int)
            jump = code[index + operand - 1].operand
            assert isinstance(jump, int)
            then = _infix(code[index : index + operand - 1], env)[0]
            other = _infix(code[index + operand : index + operand + jump], env)[0]
            stack.append((f"if({stack.pop()[0]}, {then}, {other})", _ATOM))
            index += operand + jump
        elif (function := code[index - 1].function) is not None:
            _call(stack, function.name, function.arity)
        else:
            _push(stack, op, operand, env)
    return stack[-1]


def _push(stack: list[tuple[str, int]], op: Op, operand: Value | None, env: Env) -> None:
    if op is Op.LOAD:
        assert isinstance(operand, int)
        value = env[operand] if operand < len(env) else None
        stack.append((_value(value), _ATOM))
    elif op in (Op.CONST, Op.INT):
        assert operand is not None
        stack.append((format_value(operand), _ATOM))
    elif op in _BINARY:
        right = stack.pop()
        stack.append(_joined(op, stack.pop(), right))
    elif op is Op.NOT:
        stack.append((f"not {_inside(stack.pop(), _NOT)}", _NOT))
    elif op is Op.NEG:
        stack.append((f"-{_inside(stack.pop(), _MINUS)}", _MINUS))
    elif op is Op.CALL:
        assert isinstance(operand, int)
        _call(stack, FUNCTIONS[operand].name, FUNCTIONS[operand].arity)
    elif op is Op.LIST:
        assert isinstance(operand, int)
        stack.append((f"[{_popped(stack, operand)}]", _ATOM))


def _call(stack: list[tuple[str, int]], name: str, arity: int) -> None:
    stack.append((f"{name}({_popped(stack, arity)})", _ATOM))


def _popped(stack: list[tuple[str, int]], count: int) -> str:
    """Take the topmost texts off the stack; return them with commas between."""
    parts = [text for text, _ in stack[len(stack) - count :]]
    del stack[len(stack) - count :]
    return ", ".join(parts)


def _joined(op: Op, left: tuple[str, int], right: tuple[str, int]) -> tuple[str, int]:
    word, precedence = _BINARY[op]
    return f"{_inside(left, precedence)} {word} {_inside(right, precedence + 1)}", precedence


def _inside(part: tuple[str, int], precedence: int) -> str:
    text, own = part
    return f"({text})" if own < precedence else text
