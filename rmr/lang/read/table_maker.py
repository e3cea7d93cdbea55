"""Makes the tables of the grammar: `python -m rmr.lang.read.table_maker` writes `tables.json`.

lark's interactive parser tells by `choices()` what its automaton does in the state on top of its stack. Pushing the
state that a choice leads to, and asking again, visits every state once. States are numbered in the order in which
they are met and symbols are taken in alphabetical order, so equal grammars give equal files.
"""

import json
import re
from collections import deque
from functools import cache

from lark import Lark
from lark.grammar import Rule
from lark.lexer import TerminalDef
from lark.parsers.lalr_interactive_parser import InteractiveParser

from rmr.lang.read.grammar import TABLES_FILE, GrammarRule, Tables, Terminal, checksum, grammar_text

START = "item"
"""The grammar's start symbol."""


@cache
def parser_of(text: str) -> Lark:
    """Return lark's parser of the grammar `text`. Raises lark's GrammarError if it is none or is not LALR(1)."""
    return Lark(text, parser="lalr", lexer="contextual", start=START)


def made(text: str) -> Tables:
    """Return the tables of the grammar `text`. Raises as `parser_of` does."""
    lark = parser_of(text)
    rules = sorted(lark.rules, key=lambda rule: (rule.origin.name, [symbol.name for symbol in rule.expansion]))
    actions = _actions(lark.parse_interactive(), rules)
    terminals = sorted(lark.terminals, key=_precedence)
    return Tables(
        actions,
        start=0,
        end=actions[0][START],
        rules=[_rule(rule) for rule in rules],
        terminals=[_terminal(each) for each in terminals],
        ignored=sorted(lark.ignore_tokens),
    )


def as_text(tables: Tables, text: str) -> str:
    """Return the file of the `tables` of the grammar `text`: JSON, a line for each state, rule and terminal."""
    fields = {"grammar": checksum(text), **tables._asdict()}
    return "{\n" + ",\n".join(f"{json.dumps(name)}: {_lines(value)}" for name, value in fields.items()) + "\n}\n"


def _lines(value: object) -> str:
    if not isinstance(value, list):
        return json.dumps(value)
    return "[\n" + ",\n".join(json.dumps(each) for each in value) + "\n]"


def _actions(parser: InteractiveParser, rules: list[Rule]) -> list[dict[str, int]]:
    """Return the action table: by state and symbol, a state to shift or go to, or ~r to reduce by rule r."""
    rule_numbers = {rule: number for number, rule in enumerate(rules)}
    numbers: dict[object, int] = {parser.parser_state.position: 0}
    unvisited = deque([parser])
    actions: list[dict[str, int]] = []
    while unvisited:
        parser = unvisited.popleft()
        row: dict[str, int] = {}
        choices: dict[str, tuple[object, object]] = parser.choices()  # type: ignore[no-untyped-call]
        for symbol, (_, target) in sorted(choices.items(), key=lambda choice: choice[0]):
            if isinstance(target, Rule):
                row[symbol] = ~rule_numbers[target]
                continue
            if target not in numbers:
                numbers[target] = len(numbers)
                reached: InteractiveParser = parser.copy()  # type: ignore[no-untyped-call]
                reached.parser_state.state_stack.append(target)
                unvisited.append(reached)
            row[symbol] = numbers[target]
        actions.append(row)
    return actions


def _rule(rule: Rule) -> GrammarRule:
    """Return the production for `rule` with the children that lark would keep: fixed spellings are dropped."""
    present = iter(enumerate(rule.expansion))
    children: list[int | None] = []
    for absent in rule.options.empty_indices or (False,) * len(rule.expansion):
        if absent:
            children.append(None)
            continue
        number, symbol = next(present)
        if not getattr(symbol, "filter_out", False):
            children.append(~number if symbol.name.startswith("_") and not symbol.is_term else number)
    origin = str(rule.origin.name)
    name = "" if origin.startswith("_") else str(rule.alias or origin)
    return GrammarRule(name, origin, len(rule.expansion), children, bool(rule.options.expand1 and not rule.alias))


def _precedence(terminal: TerminalDef) -> tuple[int, bool, int, str]:
    """Return the key of the order in which terminals are tried: fixed spellings last, the longest of them first."""
    pattern = terminal.pattern
    return -terminal.priority, pattern.type == "str", -len(pattern.value), terminal.name


def _terminal(terminal: TerminalDef) -> Terminal:
    pattern = terminal.pattern
    is_fixed = terminal.pattern.type == "str"
    return Terminal(
        terminal.name,
        pattern.value if is_fixed else None,
        re.escape(pattern.value) if is_fixed else pattern.to_regexp(),
        terminal.priority > 0,
    )


def main() -> None:
    """Write the tables of the package's grammar."""
    text = grammar_text()
    TABLES_FILE.write_text(as_text(made(text), text), encoding="utf-8")


if __name__ == "__main__":
    main()
