"""Prints the intermediate form (`rmr.vm.generate.form`) as Python source: one statement a line, one space a level."""

from collections.abc import Callable, Iterable
from typing import Any

from rmr.vm.generate.form import (
    Assign,
    AssignAll,
    Block,
    Break,
    Continue,
    Define,
    Delete,
    Evaluate,
    If,
    Loop,
    Raise,
    Return,
    Statement,
    Try,
    Update,
    While,
    Yield,
)


def text_of(block: Iterable[Statement]) -> str:
    """Return the source of statements."""
    lines: list[str] = []
    _write(block, "", lines)
    return "".join(lines)


def _write(block: Iterable[Statement], margin: str, lines: list[str]) -> None:
    for statement in block:
        kind = type(statement)
        simple = _SIMPLE.get(kind)
        if simple is not None:
            lines.append(f"{margin}{simple(statement)}\n")
        else:
            _COMPOUND[kind](statement, margin, lines)


def _inside(block: Block, margin: str, lines: list[str]) -> None:
    if block:
        _write(block, margin + " ", lines)
    else:
        lines.append(f"{margin} pass\n")


def _otherwise(block: Block, margin: str, lines: list[str]) -> None:
    if block:
        lines.append(f"{margin}else:\n")
        _inside(block, margin, lines)


def _if(statement: If, margin: str, lines: list[str]) -> None:
    """Write an ``if`` and the chain of ``elif`` that follows it."""
    word = "if"
    while True:
        lines.append(f"{margin}{word} {statement.test}:\n")
        _inside(statement.then, margin, lines)
        rest = statement.otherwise
        if len(rest) != 1 or not isinstance(rest[0], If):
            _otherwise(rest, margin, lines)
            return
        word = "elif"
        statement = rest[0]


def _loop(statement: Loop, margin: str, lines: list[str]) -> None:
    lines.append(f"{margin}for {statement.target} in {statement.items}:\n")
    _inside(statement.body, margin, lines)
    _otherwise(statement.otherwise, margin, lines)


def _while(statement: While, margin: str, lines: list[str]) -> None:
    lines.append(f"{margin}while {statement.test}:\n")
    _inside(statement.body, margin, lines)
    _otherwise(statement.otherwise, margin, lines)


def _try(statement: Try, margin: str, lines: list[str]) -> None:
    lines.append(f"{margin}try:\n")
    _inside(statement.body, margin, lines)
    name = f" as {statement.name}" if statement.name else ""
    lines.append(f"{margin}except {statement.exception}{name}:\n")
    _inside(statement.handler, margin, lines)


def _function(statement: Define, margin: str, lines: list[str]) -> None:
    lines.append(f"{margin}def {statement.name}({', '.join(statement.parameters)}):\n")
    _inside(statement.body, margin, lines)


_SIMPLE: dict[type, Callable[[Any], str]] = {
    Assign: lambda it: f"{it.target} = {it.value}",
    AssignAll: lambda it: " = ".join([*it.targets, it.value]),
    Update: lambda it: f"{it.target} {it.operator}= {it.value}",
    Delete: lambda it: f"del {it.target}",
    Evaluate: lambda it: it.text,
    Yield: lambda it: f"yield {it.value}",
    Return: lambda it: f"return {it.value}" if it.value else "return",
    Raise: lambda it: f"raise {it.value}",
    Break: lambda _: "break",
    Continue: lambda _: "continue",
}
"""Statements that take one line."""

_COMPOUND: dict[type, Callable[[Any, str, list[str]], None]] = {
    If: _if,
    Loop: _loop,
    While: _while,
    Try: _try,
    Define: _function,
}
"""Statements with blocks."""
