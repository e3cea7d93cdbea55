"""Semantic actions of the parser: one syntax node per reduction.

One method for each rule or alias of the grammar, and nothing else: the checker assigns the meaning.
Reported here is only what a syntax tree cannot represent: numbers out of range, reserved words as names, unknown
escapes and heads like `2`.
"""

# ruff: noqa: D102 - each public method builds the grammar rule or alias of its name; rmr.lark documents them
import math
import re
from dataclasses import replace
from itertools import chain

from rmr.base.values import INT_MAX, INT_MIN, ROBOT_ID_MAX, Robot, Symbol
from rmr.lang.diagnostics.diagnostic import Diagnostics
from rmr.lang.read import syntax
from rmr.lang.read.lexer import Token
from rmr.lang.read.source_text import Span

RESERVED = frozenset(
    [
        "type",
        "action",
        "sensor",
        "list",
        "const",
        "fun",
        "let",
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
"""Reserved words: they are never names (see the language reference)."""


SECONDS = {"s": 1, "min": 60}
"""Seconds per unit of a time literal; milliseconds are scaled in the exponent instead."""

ESCAPES = {"n": "\n", "t": "\t", "r": "\r", '"': '"', "\\": "\\"}
"""Escape sequences of a string: the letter after the backslash, and its value."""

DIGITS_MAX = 400
"""Longest time literal that is converted; a longer one counts as infinite and is out of range."""

TOO_LARGE = 1 << 64
"""Placeholder for any integer out of range; its digits are not converted, which would take quadratic time."""


class Builder:
    """Builds the syntax trees of one file bottom-up; a method gets the span of its node and the nodes below it."""

    def __init__(self, file: str, found: Diagnostics) -> None:
        self._file = file
        self._found = found
        self._large: dict[int, syntax.Literal] = {}
        """Literals out of range, by start of span; building a `-` replaces the entry of its operand."""

    def finish(self) -> None:
        """Report the numbers out of range among the nodes built since the last call."""
        for literal in self._large.values():
            what = "a 64-bit float" if isinstance(literal.value, float) else "64 bits"
            self._found.report("E005", f"this number does not fit into {what}", literal.span)
        self._large.clear()

    # ---- places, names, facts

    def _token_span(self, token: Token) -> Span:
        return Span(self._file, token.start, token.end)

    def _name(self, token: Token) -> syntax.Name:
        span = self._token_span(token)
        if token.text in RESERVED:
            message = f"`{token.text}` is a reserved word and names nothing"
            hint = "a head derives a fact by naming it: `done(R)`" if token.text == "assert" else "choose another"
            self._found.report("E006", message, span, hint=hint)
        return syntax.Name(token.text, span)

    def _variable(self, token: Token) -> syntax.Variable:
        return syntax.Variable(token.text, self._token_span(token))

    def _fact(
        self, span: Span, call: syntax.Call, mark: Token | None = None, *, absent: bool = False
    ) -> syntax.FactNode:
        kind = syntax.Mark(mark.text if mark is not None else "")
        return syntax.FactNode(call.name, call.arguments, span, kind, absent)

    # ---- items

    def type_declaration(
        self,
        span: Span,
        word: Token | None,
        mark: Token | None,
        name: Token,
        parameters: tuple[syntax.Parameter, ...],
    ) -> syntax.TypeDeclaration:
        kinds = {"!": syntax.Declared.PERSISTENT, "sensor": syntax.Declared.SENSED}
        kind = kinds[mark.text] if mark is not None else syntax.Declared.TEMPORARY
        unordered, shared = self._placed(word)
        return syntax.TypeDeclaration(kind, self._name(name), parameters, span, unordered=unordered, shared=shared)

    def _placed(self, word: Token | None) -> tuple[Span | None, Span | None]:
        """Return the place of ``unordered`` and that of ``shared``, of which one may stand behind ``type``."""
        if word is None:
            return None, None
        place = self._token_span(word)
        return (place, None) if word.text == "unordered" else (None, place)

    def type_called_so(
        self, span: Span, name: Token, parameters: tuple[syntax.Parameter, ...]
    ) -> syntax.TypeDeclaration:
        return self.type_declaration(span, None, None, name, parameters)

    def action_declaration(
        self,
        span: Span,
        word: Token | None,
        name: Token,
        parameters: tuple[syntax.Parameter, ...],
        _arrow: Token | None,
        effects: tuple[syntax.FactNode, ...] | None,
        otherwise: tuple[syntax.FactNode, ...] | None,
    ) -> syntax.TypeDeclaration:
        kind = syntax.Declared.ACTION
        unordered, shared = self._placed(word)
        return syntax.TypeDeclaration(
            kind, self._name(name), parameters, span, effects or (), otherwise or (), unordered, shared
        )

    def parameters(self, _span: Span, *parameters: tuple[syntax.Parameter, ...] | None) -> tuple[syntax.Parameter, ...]:
        return tuple(chain.from_iterable(each for each in parameters if each is not None))

    def parameter(
        self, span: Span, variable: Token | None, extreme: Token | None, kind: syntax.TypeName
    ) -> tuple[syntax.Parameter, ...]:
        """Return the parameter; two of them if the token before the type is a type itself, and a comma is missing."""
        named = None if variable is None else self._variable(variable)
        # By `min` or `max` of an argument the best fact is chosen.
        if extreme is None or extreme.text in ("min", "max"):
            return (syntax.Parameter(named, kind, span, "" if extreme is None else extreme.text),)
        if extreme.text == "sum":  # as in Meld
            hint = "declare what is added up, each fact with who brings it; a rule adds: `S = sum(X, p(R, _, X))`"
            message = "no predicate adds up its facts; `min` and `max` keep the best one"
            self._found.report("E001", message, self._token_span(extreme), hint=hint)
            return (syntax.Parameter(named, kind, span, ""),)
        hint = "`,` stands between arguments, between conditions, and between what a head derives"
        at = Span(self._file, extreme.end, extreme.end)
        self._found.report("E001", f"a `,` is missing before `{kind.name}`", at, hint=hint)
        first = self._token_span(extreme)
        whole = first if named is None else named.span.to(first)
        before = syntax.Parameter(named, syntax.TypeName(extreme.text, None, first), whole, "")
        return before, syntax.Parameter(None, kind, kind.span, "")

    def type_name(self, span: Span, word: Token, element: syntax.TypeName | None = None) -> syntax.TypeName:
        text = "list" if element is not None else self._name(word).text
        return syntax.TypeName(text, element, span)

    def effects(self, _span: Span, *facts: syntax.FactNode) -> tuple[syntax.FactNode, ...]:
        return facts

    def effect(self, span: Span, mark: Token | None, call: syntax.Call) -> syntax.FactNode:
        return self._fact(span, call, mark)

    def constant(self, span: Span, name: Token, value: syntax.Expression) -> syntax.ConstantItem:
        return syntax.ConstantItem(self._name(name), value, span)

    def function(
        self,
        span: Span,
        name: Token,
        parameters: tuple[syntax.Formal, ...],
        result: syntax.TypeName | None,
        body: syntax.Expression,
    ) -> syntax.FunctionItem:
        return syntax.FunctionItem(self._name(name), parameters, result, body, span)

    def formals(self, _span: Span, *formals: syntax.Formal | None) -> tuple[syntax.Formal, ...]:
        return tuple(formal for formal in formals if formal is not None)

    def formal(self, span: Span, variable: Token, kind: syntax.TypeName | None) -> syntax.Formal:
        return syntax.Formal(self._variable(variable), kind, span)

    def include(self, span: Span, path: Token) -> syntax.IncludeItem:
        return syntax.IncludeItem(self._unescape(path), span)

    def strategy(self, span: Span, name: Token) -> syntax.StrategyItem:
        return syntax.StrategyItem(self._name(name), span)

    def fact(self, span: Span, mark: Token | None, call: syntax.Call) -> syntax.FactItem:
        kind = syntax.Mark.BANG if mark is not None else syntax.Mark.NONE
        # Without the full stop that ends the item: diagnostics underline the fact alone.
        span = call.span if mark is None else self._token_span(mark).to(call.span)
        return syntax.FactItem(syntax.FactNode(call.name, call.arguments, span, kind), span)

    def goal(self, span: Span, call: syntax.Call) -> syntax.GoalItem:
        fact = syntax.FactNode(call.name, call.arguments, call.span, syntax.Mark.GOAL)
        return syntax.GoalItem(fact, span)

    def rule(
        self, span: Span, body: tuple[syntax.Conjunct, ...], _arrow: Token, head: tuple[syntax.HeadItem, ...]
    ) -> syntax.RuleItem:
        return syntax.RuleItem(body, head, span)

    def assertion(
        self,
        span: Span,
        name: Token | None,
        word: Token,
        start: syntax.FactNode,
        finish: syntax.FactNode,
        deadline: syntax.Expression,
        violation: syntax.Call,
    ) -> syntax.AssertionItem:
        named = None if name is None else self._name(name)
        action = syntax.FactNode(violation.name, violation.arguments, violation.span)
        return syntax.AssertionItem(named, word.kind == "ASSERT", start, finish, deadline, action, span)

    # ---- bodies and heads

    def body(
        self, _span: Span, *conjuncts: syntax.FactNode | syntax.FoldNode | syntax.Expression
    ) -> tuple[syntax.Conjunct, ...]:
        return tuple(self._conjunct(conjunct) for conjunct in conjuncts)

    def _conjunct(self, part: syntax.FactNode | syntax.FoldNode | syntax.Expression) -> syntax.Conjunct:
        if isinstance(part, syntax.FactNode | syntax.FoldNode):
            return part
        return syntax.conjunct_of(part)

    def marked(self, span: Span, mark: Token, call: syntax.Call) -> syntax.FactNode:
        return self._fact(span, call, mark)

    def absent(self, span: Span, mark: Token, call: syntax.Call) -> syntax.FactNode:
        return self._fact(span, call, mark, absent=True)

    def absent_all(
        self,
        span: Span,
        first: syntax.FactNode | syntax.FoldNode | syntax.Expression,
        others: tuple[syntax.Conjunct, ...],
    ) -> syntax.FoldNode:
        return syntax.FoldNode(syntax.Name("count", span), None, (self._conjunct(first), *others), span)

    def observed(self, span: Span, mark: Token | None, call: syntax.Call) -> syntax.FactNode:
        return self._fact(span, call, mark)

    def derived(self, span: Span, mark: Token | None, call: syntax.Call) -> syntax.FactNode:
        # `assert(p(R))`, a habit from Prolog: read as `p(R)`, the reserved word having been reported by `_name`.
        if call.name.text == "assert" and len(call.arguments) == 1 and isinstance(call.arguments[0], syntax.Call):
            call = call.arguments[0]
        return self._fact(span, call, mark)

    def withdrawn(self, span: Span, mark: Token, call: syntax.Call) -> syntax.FactNode:
        return self._fact(span, call, mark, absent=True)

    def head(self, _span: Span, *items: syntax.HeadItem | None) -> tuple[syntax.HeadItem, ...]:
        return tuple(item for item in items if item is not None)

    def nothing(self, _span: Span, number: Token) -> None:
        if number.text != "1":
            message = f"a head is a list of facts, or `1` for nothing, not `{number.text}`"
            self._found.report("E001", message, self._token_span(number), hint="write `1`")

    def choice(
        self,
        span: Span,
        condition: syntax.Expression,
        then: tuple[syntax.HeadItem, ...],
        otherwise: tuple[syntax.HeadItem, ...] | None,
    ) -> syntax.ChoiceNode:
        return syntax.ChoiceNode(condition, then, otherwise or (), span)

    def steps(self, span: Span, *derived: syntax.FactNode) -> syntax.FactNode | syntax.StepsNode:
        return derived[0] if len(derived) == 1 else syntax.StepsNode(derived, span)

    def comprehension(
        self,
        span: Span,
        variables: tuple[syntax.Variable, ...],
        body: tuple[syntax.Conjunct, ...],
        head: tuple[syntax.FactNode, ...],
    ) -> syntax.ComprehensionNode:
        return syntax.ComprehensionNode(variables, body, head, span)

    def variables(self, _span: Span, *tokens: Token) -> tuple[syntax.Variable, ...]:
        return tuple(self._variable(token) for token in tokens)

    def derivations(self, _span: Span, *facts: syntax.FactNode) -> tuple[syntax.FactNode, ...]:
        return facts

    def aggregate(
        self,
        span: Span,
        operator: Token,
        term: syntax.Expression | None,
        result: Token,
        body: tuple[syntax.Conjunct, ...],
        head: tuple[syntax.FactNode, ...],
    ) -> syntax.AggregateNode:
        name = self._name(operator)
        return syntax.AggregateNode(name, term, self._variable(result), body, head, span)

    # ---- expressions

    def binary(
        self, span: Span, left: syntax.Expression, operator: Token, right: syntax.Expression
    ) -> syntax.Expression:
        spelling = "!=" if operator.text == "<>" else operator.text
        return syntax.Binary(spelling, left, right, span)

    def let(self, span: Span, *parts: syntax.Binding | syntax.Expression) -> syntax.LetTerm:
        bindings = tuple(part for part in parts if isinstance(part, syntax.Binding))
        body = parts[-1]
        assert not isinstance(body, syntax.Binding)
        return syntax.LetTerm(bindings, body, span)

    def binding(self, span: Span, variable: Token, value: syntax.Expression) -> syntax.Binding:
        return syntax.Binding(self._variable(variable), value, span)

    def negation(self, span: Span, operand: syntax.Expression) -> syntax.Expression:
        return syntax.Unary("not", operand, span)

    def minus(self, span: Span, _minus: Token, operand: syntax.Expression) -> syntax.Expression:
        if not isinstance(operand, syntax.Literal) or type(operand.value) not in {int, float}:
            return syntax.Unary("-", operand, span)
        assert isinstance(operand.value, int | float)
        self._large.pop(operand.span.start, None)
        return self._number(-operand.value, span)

    def variable(self, _span: Span, token: Token) -> syntax.Variable:
        return self._variable(token)

    def symbol(self, _span: Span, token: Token) -> syntax.Literal:
        name = self._name(token)
        return syntax.Literal(Symbol(name.text), name.span)

    def _number(self, value: int | float, span: Span) -> syntax.Literal:
        literal = syntax.Literal(value, span)
        if not in_range(value):
            self._large[span.start] = literal
        return literal

    def integer(self, span: Span, token: Token) -> syntax.Literal:
        return self._number(_integer(token.text), span)

    def decimal(self, span: Span, token: Token) -> syntax.Literal:
        return self._number(float(token.text), span)

    def seconds(self, span: Span, token: Token) -> syntax.Literal:
        number = token.text.rstrip("mins")
        return self._number(_seconds(number, token.text[len(number) :]), span)

    def robot(self, span: Span, token: Token) -> syntax.Literal:
        number = _integer(token.text[1:])
        if number > ROBOT_ID_MAX:
            self._found.report("E005", f"robot ids go from 0 to {ROBOT_ID_MAX}", span)
            number = 0
        return syntax.Literal(Robot(number), span)

    def text(self, span: Span, token: Token) -> syntax.Literal:
        return syntax.Literal(self._unescape(token), span)

    def true(self, span: Span, _token: Token) -> syntax.Literal:
        return syntax.Literal(True, span)

    def false(self, span: Span, _token: Token) -> syntax.Literal:
        return syntax.Literal(False, span)

    def call(self, span: Span, name: Token, arguments: tuple[syntax.Expression, ...] | None) -> syntax.Call:
        return syntax.Call(self._name(name), arguments or (), span)

    def arguments(self, _span: Span, *arguments: syntax.Expression) -> tuple[syntax.Expression, ...]:
        return arguments

    def group(self, span: Span, inner: syntax.Expression) -> syntax.Expression:
        if isinstance(inner, syntax.Call):
            return replace(inner, grouped=True, span=span)
        return inner

    def list_term(
        self, span: Span, items: tuple[syntax.Expression, ...] | None, rest: syntax.Expression | None
    ) -> syntax.ListTerm:
        return syntax.ListTerm(items or (), rest, span)

    def _unescape(self, token: Token) -> str:
        def replaced(matched: re.Match[str]) -> str:
            letter = matched.group(1)
            if letter not in ESCAPES:
                message = f"`\\{letter}` is no escape"
                hint = 'known are \\n \\t \\r \\" and \\\\'
                self._found.report("E001", message, self._token_span(token), hint=hint)
            return ESCAPES.get(letter, letter)

        return re.sub(r"\\(.)", replaced, token.text[1:-1])


def _integer(digits: str) -> int:
    significant = digits.lstrip("0") or "0"
    return int(significant) if len(significant) <= len(str(INT_MAX)) else TOO_LARGE


def _seconds(number: str, unit: str) -> float:
    """Return a time in seconds: the float nearest to the decimal written."""
    if len(number) > DIGITS_MAX:
        return math.inf
    if unit != "ms":
        return float(number) * SECONDS[unit]
    # Scaled in the exponent: dividing by 1000 would round a second time.
    mantissa, _, exponent = number.lower().partition("e")
    return float(f"{mantissa}e{int(exponent or '0') - 3}")


def in_range(value: object) -> bool:
    """Whether a number fits the language's ints (64 bits) and floats (finite)."""
    if isinstance(value, float):
        return math.isfinite(value)
    return not isinstance(value, int) or INT_MIN <= value <= INT_MAX
