"""Constants: what `const` names, and expressions that have a value before the program runs.

Folding computes only what the virtual machine would compute as well; an expression that it does not fold is
left for the machine, or is an error where a constant is needed.
"""

from dataclasses import fields, is_dataclass, replace
from typing import Any

from rmr.base.values import Robot, Symbol
from rmr.bytecode.conform import sound
from rmr.bytecode.program import Base, Type
from rmr.lang.build import in_range
from rmr.lang.diagnostic import Diagnostics, Note
from rmr.lang.source import Span
from rmr.lang.syntax import (
    Binary,
    Constant,
    Expression,
    Fact,
    FactItem,
    GoalItem,
    ListTerm,
    Literal,
    Module,
    Name,
    Unary,
)
from rmr.lang.types import compatible, value_type


def fold(expression: Expression) -> Literal | None:
    """Return the value of an expression of constants, or None if it has none."""
    match expression:
        case Literal():
            return expression
        case ListTerm():
            return _list(expression)
        case Unary(operator="-", operand=operand):
            inner = fold(operand)
            if inner is None or not _is_number(inner.value):
                return None
            assert isinstance(inner.value, int | float)
            return _checked(-inner.value, expression.span)
        case Binary(operator=operator, left=left, right=right):
            one, other = fold(left), fold(right)
            if one is None or other is None or not (_is_number(one.value) and _is_number(other.value)):
                return None
            assert isinstance(one.value, int | float)
            assert isinstance(other.value, int | float)
            return _arithmetic(operator, one.value, other.value, expression.span)
        case _:
            return None


def _list(term: ListTerm) -> Literal | None:
    rest = Literal((), term.span) if term.rest is None else fold(term.rest)
    items = [fold(item) for item in term.items]
    values = tuple(item.value for item in items if item is not None)
    if rest is None or not isinstance(rest.value, tuple) or len(values) < len(items):
        return None
    value = (*values, *rest.value)
    kind = value_type(value)
    agree = all(compatible(Type(Base.LIST, element=value_type(each)), kind) for each in value)
    return Literal(value, term.span) if agree and sound(value) else None


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool | Robot)


def _arithmetic(operator: str, one: int | float, other: int | float, span: Span) -> Literal | None:
    try:
        match operator:
            case "+":
                return _checked(one + other, span)
            case "-":
                return _checked(one - other, span)
            case "*":
                return _checked(one * other, span)
            case "/":
                return _checked(one / other, span)
    except ArithmeticError:
        pass
    return None


def _checked(value: int | float, span: Span) -> Literal | None:
    return Literal(value, span) if in_range(value) else None


def resolve(module: Module, found: Diagnostics) -> Module:
    """Return `module` with every name of a constant replaced by its value, and stated values computed."""
    values: dict[Symbol, Literal] = {}
    places: dict[Symbol, Name] = {}
    for item in module.items:
        if isinstance(item, Constant):
            _define(item, values, places, found)
    items = tuple(_stated(_replaced(item, values)) if values else _stated(item) for item in module.items)
    return replace(module, items=items)


def _define(item: Constant, values: dict[Symbol, Literal], places: dict[Symbol, Name], found: Diagnostics) -> None:
    name = Symbol(item.name.text)
    if name in values:
        notes = (Note(places[name].span, "first defined here"),)
        found.report("E010", f"the constant `{name}` is defined twice", item.name.span, notes=notes)
        return
    value = fold(_replaced(item.value, values))
    if value is None:
        hint = "numbers, robots, strings, symbols, earlier constants, and + - * / of numbers"
        found.report("E023", f"the value of `{name}` is not constant", item.value.span, hint=hint)
        value = Literal(0, item.value.span)
    values[name], places[name] = value, item.name


def _stated(item: Any) -> Any:
    """Compute the arguments of a fact or goal that the program states."""
    if not isinstance(item, FactItem | GoalItem):
        return item
    fact: Fact = item.fact
    arguments = tuple(fold(argument) or argument for argument in fact.arguments)
    return replace(item, fact=replace(fact, arguments=arguments))


def _replaced(node: Any, values: dict[Symbol, Literal]) -> Any:
    """Return `node` with constants in place of their names; nesting is bounded by the parser."""
    if isinstance(node, Literal):
        value = values.get(node.value) if isinstance(node.value, Symbol) else None
        return Literal(value.value, node.span) if value is not None else node
    if isinstance(node, tuple):
        return tuple(_replaced(each, values) for each in node)
    if is_dataclass(node) and not isinstance(node, type | Span | Name):
        changes = {part.name: _replaced(getattr(node, part.name), values) for part in fields(node)}
        return type(node)(**changes)
    return node
