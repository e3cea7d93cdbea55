"""Prints the intermediate form (`rmr.vm.generate.form`) as Python source: one statement a line, one space a level."""

from collections.abc import Iterable, Iterator

from rmr.vm.generate.form import (
    Assign,
    AssignAll,
    Block,
    Break,
    Call,
    Continue,
    Delete,
    Function,
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
    return "".join(f"{line}\n" for statement in block for line in _lines(statement, ""))


def _lines(statement: Statement, margin: str) -> Iterator[str]:
    match statement:
        case If():
            yield from _conditional(statement, margin)
        case Loop(target, items, body, otherwise):
            yield f"{margin}for {target} in {items}:"
            yield from _inside(body, margin)
            yield from _else(otherwise, margin)
        case While(test, body, otherwise):
            yield f"{margin}while {test}:"
            yield from _inside(body, margin)
            yield from _else(otherwise, margin)
        case Try(exception, name, handler, body):
            yield f"{margin}try:"
            yield from _inside(body, margin)
            yield f"{margin}except {exception}{f' as {name}' if name else ''}:"
            yield from _inside(handler, margin)
        case Function(name, parameters, body):
            yield f"{margin}def {name}({', '.join(parameters)}):"
            yield from _inside(body, margin)
        case _:
            yield margin + _simple(statement)


def _simple(statement: Statement) -> str:
    """Return a statement that takes one line."""
    match statement:
        case Assign(target, value):
            return f"{target} = {value}"
        case AssignAll(targets, value):
            return " = ".join([*targets, value])
        case Update(target, operator, value):
            return f"{target} {operator}= {value}"
        case Delete(target):
            return f"del {target}"
        case Call(text):
            return text
        case Yield(value):
            return f"yield {value}"
        case Return(value):
            return f"return {value}" if value else "return"
        case Raise(value):
            return f"raise {value}"
        case Break():
            return "break"
        case Continue():
            return "continue"
    raise AssertionError(statement)


def _conditional(statement: If, margin: str) -> Iterator[str]:
    """Yield an ``if`` and the chain of ``elif`` that follows it."""
    word = "if"
    rest = statement
    while True:
        yield f"{margin}{word} {rest.test}:"
        yield from _inside(rest.then, margin)
        if len(rest.otherwise) != 1 or not isinstance(rest.otherwise[0], If):
            break
        word = "elif"
        rest = rest.otherwise[0]
    yield from _else(rest.otherwise, margin)


def _else(block: Block, margin: str) -> Iterator[str]:
    if block:
        yield f"{margin}else:"
        yield from _inside(block, margin)


def _inside(block: Block, margin: str) -> Iterator[str]:
    inner = margin + " "
    if not block:
        yield f"{inner}pass"
    for statement in block:
        yield from _lines(statement, inner)
