"""From the parser's tree to the syntax tree.

One method for each rule or alias of the grammar, and nothing else: what a program means is for the checker.
Only what the syntax tree could not hold is reported here: numbers out of range and reserved words as names.
"""

# ruff: noqa: D102 - each public method builds the grammar rule or alias of its name; rmr.lark documents them
import math
import re
from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal
from typing import Any

from lark import Token, v_args
from lark.tree import Meta
from lark.visitors import Transformer_NonRecursive

from rmr.base.values import INT_MAX, INT_MIN, ROBOT_ID_MAX, Robot, Symbol
from rmr.lang import syntax
from rmr.lang.diagnostic import Diagnostics
from rmr.lang.source import Span

RESERVED = frozenset(
    [
        "type",
        "action",
        "sensor",
        "list",
        "const",
        "include",
        "order",
        "assert",
        "watch",
        "not",
        "then",
        "else",
        "true",
        "false",
    ]
)
"""Words that name nothing (see the language reference)."""

SECONDS = {"ms": Decimal("0.001"), "s": Decimal(1), "min": Decimal(60)}
"""The units of time literals."""

ESCAPES = {"n": "\n", "t": "\t", "r": "\r", '"': '"', "\\": "\\"}
"""What may follow a backslash in a string."""

DIGITS_MAX = 400
"""No number of the language needs more digits; longer ones are not even converted."""

TOO_LARGE = 1 << 64
"""Stands for any integer that is out of range."""

_inline: Callable[[Any], Any] = v_args(meta=True, inline=True)


@_inline
class Builder(Transformer_NonRecursive[Token, Any]):
    """Builds the syntax tree of one item that begins `offset` characters into `file`."""

    def __init__(self, file: str, offset: int, found: Diagnostics) -> None:
        super().__init__()
        self._file = file
        self._offset = offset
        self._found = found

    # ---- places, names, facts

    def _span(self, meta: Meta) -> Span:
        return Span(self._file, self._offset + meta.start_pos, self._offset + meta.end_pos)

    def _token_span(self, token: Token) -> Span:
        assert token.start_pos is not None
        assert token.end_pos is not None
        return Span(self._file, self._offset + token.start_pos, self._offset + token.end_pos)

    def _name(self, token: Token) -> syntax.Name:
        span = self._token_span(token)
        if token.value in RESERVED:
            self._found.report("E006", f"`{token}` is a reserved word and names nothing", span, hint="choose another")
        return syntax.Name(str(token), span)

    def _variable(self, token: Token) -> syntax.Variable:
        return syntax.Variable(str(token), self._token_span(token))

    def _fact(self, meta: Meta, call: syntax.Call, mark: Token | None = None, *, absent: bool = False) -> syntax.Fact:
        kind = syntax.Mark(str(mark) if mark is not None else "")
        return syntax.Fact(call.name, call.arguments, self._span(meta), kind, absent)

    # ---- items

    def item(self, _meta: Meta, item: syntax.Item) -> syntax.Item:
        return item

    def type_declaration(
        self, meta: Meta, mark: Token | None, name: Token, parameters: tuple[syntax.Parameter, ...]
    ) -> syntax.TypeDeclaration:
        kinds = {"!": syntax.Declared.PERSISTENT, "sensor": syntax.Declared.SENSED}
        kind = kinds[str(mark)] if mark is not None else syntax.Declared.TEMPORARY
        return syntax.TypeDeclaration(kind, self._name(name), parameters, self._span(meta))

    def action_declaration(
        self,
        meta: Meta,
        name: Token,
        parameters: tuple[syntax.Parameter, ...],
        _arrow: Token | None,
        effects: tuple[syntax.Fact, ...] | None,
        otherwise: tuple[syntax.Fact, ...] | None,
    ) -> syntax.TypeDeclaration:
        kind = syntax.Declared.ACTION
        span = self._span(meta)
        return syntax.TypeDeclaration(kind, self._name(name), parameters, span, effects or (), otherwise or ())

    def parameters(self, _meta: Meta, *parameters: syntax.Parameter | None) -> tuple[syntax.Parameter, ...]:
        return tuple(parameter for parameter in parameters if parameter is not None)

    def parameter(self, meta: Meta, variable: Token | None, kind: syntax.TypeName) -> syntax.Parameter:
        return syntax.Parameter(None if variable is None else self._variable(variable), kind, self._span(meta))

    def type_name(self, meta: Meta, word: Token, element: syntax.TypeName | None = None) -> syntax.TypeName:
        text = "list" if element is not None else self._name(word).text
        return syntax.TypeName(text, element, self._span(meta))

    def effects(self, _meta: Meta, *facts: syntax.Fact) -> tuple[syntax.Fact, ...]:
        return facts

    def effect(self, meta: Meta, mark: Token | None, call: syntax.Call) -> syntax.Fact:
        return self._fact(meta, call, mark)

    def constant(self, meta: Meta, name: Token, value: syntax.Expression) -> syntax.Constant:
        return syntax.Constant(self._name(name), value, self._span(meta))

    def include(self, meta: Meta, path: Token) -> syntax.Include:
        return syntax.Include(self._unescape(path), self._span(meta))

    def strategy(self, meta: Meta, name: Token) -> syntax.Strategy:
        return syntax.Strategy(self._name(name), self._span(meta))

    def fact(self, meta: Meta, mark: Token | None, call: syntax.Call) -> syntax.FactItem:
        kind = syntax.Mark.BANG if mark is not None else syntax.Mark.NONE
        span = call.span if mark is None else self._token_span(mark).to(call.span)
        return syntax.FactItem(syntax.Fact(call.name, call.arguments, span, kind), self._span(meta))

    def goal(self, meta: Meta, call: syntax.Call) -> syntax.GoalItem:
        fact = syntax.Fact(call.name, call.arguments, call.span, syntax.Mark.GOAL)
        return syntax.GoalItem(fact, self._span(meta))

    def rule(
        self, meta: Meta, body: tuple[syntax.Conjunct, ...], _arrow: Token, head: tuple[syntax.HeadItem, ...]
    ) -> syntax.Rule:
        return syntax.Rule(body, head, self._span(meta))

    def assertion(
        self,
        meta: Meta,
        name: Token | None,
        word: Token,
        start: syntax.Fact,
        finish: syntax.Fact,
        deadline: syntax.Expression,
        violation: syntax.Call,
    ) -> syntax.Assertion:
        named = None if name is None else self._name(name)
        action = syntax.Fact(violation.name, violation.arguments, violation.span)
        return syntax.Assertion(named, word == "assert", start, finish, deadline, action, self._span(meta))

    # ---- bodies and heads

    def body(self, _meta: Meta, *conjuncts: syntax.Fact | syntax.Expression) -> tuple[syntax.Conjunct, ...]:
        return tuple(self._conjunct(conjunct) for conjunct in conjuncts)

    def _conjunct(self, part: syntax.Fact | syntax.Expression) -> syntax.Conjunct:
        if isinstance(part, syntax.Fact):
            return part
        if isinstance(part, syntax.Call) and not part.grouped:
            return syntax.Fact(part.name, part.arguments, part.span)
        if isinstance(part, syntax.Unary) and part.operator == "not" and isinstance(part.operand, syntax.Call):
            call = part.operand
            if call.grouped:
                return syntax.Condition(part, part.span)
            return syntax.Fact(call.name, call.arguments, part.span, absent=True)
        return syntax.Condition(part, part.span)

    def marked(self, meta: Meta, mark: Token, call: syntax.Call) -> syntax.Fact:
        return self._fact(meta, call, mark)

    def absent(self, meta: Meta, mark: Token, call: syntax.Call) -> syntax.Fact:
        return self._fact(meta, call, mark, absent=True)

    def observed(self, meta: Meta, mark: Token | None, call: syntax.Call) -> syntax.Fact:
        return self._fact(meta, call, mark)

    def derived(self, meta: Meta, mark: Token | None, call: syntax.Call) -> syntax.Fact:
        return self._fact(meta, call, mark)

    def head(self, _meta: Meta, *items: syntax.HeadItem | None) -> tuple[syntax.HeadItem, ...]:
        return tuple(item for item in items if item is not None)

    def nothing(self, _meta: Meta, number: Token) -> None:
        if number != "1":
            message = f"a head is a list of facts, or `1` for nothing, not `{number}`"
            self._found.report("E001", message, self._token_span(number), hint="write `1`")

    def steps(self, meta: Meta, *derived: syntax.Fact) -> syntax.Fact | syntax.Steps:
        return derived[0] if len(derived) == 1 else syntax.Steps(derived, self._span(meta))

    def comprehension(
        self,
        meta: Meta,
        variables: tuple[syntax.Variable, ...],
        body: tuple[syntax.Conjunct, ...],
        head: tuple[syntax.Fact, ...],
    ) -> syntax.Comprehension:
        return syntax.Comprehension(variables, body, head, self._span(meta))

    def variables(self, _meta: Meta, *tokens: Token) -> tuple[syntax.Variable, ...]:
        return tuple(self._variable(token) for token in tokens)

    def derivations(self, _meta: Meta, *facts: syntax.Fact) -> tuple[syntax.Fact, ...]:
        return facts

    def aggregate(
        self,
        meta: Meta,
        operator: Token,
        term: syntax.Expression | None,
        result: Token,
        body: tuple[syntax.Conjunct, ...],
        head: syntax.Fact,
    ) -> syntax.Aggregate:
        name = self._name(operator)
        return syntax.Aggregate(name, term, self._variable(result), body, head, self._span(meta))

    # ---- expressions

    def binary(
        self, meta: Meta, left: syntax.Expression, operator: Token, right: syntax.Expression
    ) -> syntax.Expression:
        spelling = "!=" if operator == "<>" else str(operator)
        return syntax.Binary(spelling, left, right, self._span(meta))

    def negation(self, meta: Meta, operand: syntax.Expression) -> syntax.Expression:
        return syntax.Unary("not", operand, self._span(meta))

    def minus(self, meta: Meta, _minus: Token, operand: syntax.Expression) -> syntax.Expression:
        span = self._span(meta)
        if isinstance(operand, syntax.Literal) and type(operand.value) in {int, float}:
            assert isinstance(operand.value, int | float)
            return syntax.Literal(-operand.value, span)
        return syntax.Unary("-", operand, span)

    def variable(self, _meta: Meta, token: Token) -> syntax.Variable:
        return self._variable(token)

    def symbol(self, _meta: Meta, token: Token) -> syntax.Literal:
        name = self._name(token)
        return syntax.Literal(Symbol(name.text), name.span)

    def integer(self, meta: Meta, token: Token) -> syntax.Literal:
        return syntax.Literal(_integer(token), self._span(meta))

    def decimal(self, meta: Meta, token: Token) -> syntax.Literal:
        return syntax.Literal(_float(str(token), Decimal(1)), self._span(meta))

    def seconds(self, meta: Meta, token: Token) -> syntax.Literal:
        number = str(token).rstrip("mins")
        return syntax.Literal(_float(number, SECONDS[token[len(number) :]]), self._span(meta))

    def robot(self, meta: Meta, token: Token) -> syntax.Literal:
        number = _integer(token[1:])
        span = self._span(meta)
        if number > ROBOT_ID_MAX:
            self._found.report("E005", f"robot ids go from 0 to {ROBOT_ID_MAX}", span)
            number = 0
        return syntax.Literal(Robot(number), span)

    def text(self, meta: Meta, token: Token) -> syntax.Literal:
        return syntax.Literal(self._unescape(token), self._span(meta))

    def true(self, meta: Meta, _token: Token) -> syntax.Literal:
        return syntax.Literal(True, self._span(meta))

    def false(self, meta: Meta, _token: Token) -> syntax.Literal:
        return syntax.Literal(False, self._span(meta))

    def call(self, meta: Meta, name: Token, arguments: tuple[syntax.Expression, ...] | None) -> syntax.Call:
        return syntax.Call(self._name(name), arguments or (), self._span(meta))

    def arguments(self, _meta: Meta, *arguments: syntax.Expression) -> tuple[syntax.Expression, ...]:
        return arguments

    def group(self, meta: Meta, inner: syntax.Expression) -> syntax.Expression:
        if isinstance(inner, syntax.Call):
            return replace(inner, grouped=True, span=self._span(meta))
        return inner

    def list_term(
        self, meta: Meta, items: tuple[syntax.Expression, ...] | None, rest: syntax.Expression | None
    ) -> syntax.ListTerm:
        return syntax.ListTerm(items or (), rest, self._span(meta))

    def _unescape(self, token: Token) -> str:
        def replaced(matched: re.Match[str]) -> str:
            letter = matched.group(1)
            if letter not in ESCAPES:
                message = f"`\\{letter}` is no escape"
                hint = 'known are \\n \\t \\r \\" and \\\\'
                self._found.report("E001", message, self._token_span(token), hint=hint)
            return ESCAPES.get(letter, letter)

        return re.sub(r"\\(.)", replaced, token[1:-1])


def _integer(digits: str) -> int:
    significant = digits.lstrip("0") or "0"
    return int(significant) if len(significant) <= len(str(INT_MAX)) else TOO_LARGE


def _float(digits: str, unit: Decimal) -> float:
    if len(digits) > DIGITS_MAX:
        return math.inf
    try:
        return float(Decimal(digits) * unit)
    except ArithmeticError:
        return math.inf


def in_range(value: object) -> bool:
    """Whether a number of the source is one that the language can hold."""
    if isinstance(value, float):
        return math.isfinite(value)
    return not isinstance(value, int) or INT_MIN <= value <= INT_MAX
