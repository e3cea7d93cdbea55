"""Facts that arrive as text: a lab's `facts:` and `finish:`, a file of facts, an `--insert` on the command line.

Robots carry no parser, so whoever starts them turns text into values with the help of the program that they
will run.
"""

from rmr.base.values import Robot
from rmr.bytecode.program import ANY, Anything, Constant, InitialFact, InitialGoal, Kind, Program
from rmr.lang.constants import fold
from rmr.lang.diagnostic import Diagnostics
from rmr.lang.emit import converted
from rmr.lang.names import meant
from rmr.lang.parser import parse
from rmr.lang.provided import type_text
from rmr.lang.source import Source
from rmr.lang.syntax import Expression, Fact, FactItem, Literal, Mark, Variable
from rmr.lang.types import fits, literal_type


class FactError(Exception):
    """The text is no fact of the program; the message says why, without the text itself.

    `code` is that of the diagnostic which the same mistake would be in a program.
    """

    def __init__(self, message: str, code: str = "E001", hint: str | None = None) -> None:
        super().__init__(message if hint is None else f"{message}; {hint}")
        self.code = code


def parse_fact(text: str, program: Program) -> InitialFact:
    """Return the fact that `text` states, such as ``due(@1, 25)``; a variable owner is every robot.

    Arguments are converted to the types of the program. Raises FactError.
    """
    return stated(read_fact(text), program)


def stated(fact: Fact, program: Program) -> InitialFact:
    """Return what `fact` states, as `parse_fact`. Raises FactError."""
    pattern = _pattern(fact, program)
    values = [each.value for each in pattern.args if isinstance(each, Constant)]
    if len(values) != len(pattern.args):
        raise FactError("a fact has constant arguments, only its owner may be a variable", "E023")
    return InitialFact(pattern.predicate, pattern.owner, tuple(values))


def parse_pattern(text: str, program: Program) -> InitialGoal:
    """Return the pattern that `text` spells, such as ``at(R, exit)``; variables match anything. Raises FactError."""
    return _pattern(read_fact(text), program)


def _pattern(fact: Fact, program: Program) -> InitialGoal:
    name = fact.name.text
    index = program.index(name)
    if index is None:
        known = [each.name for each in program.predicates if each.kind is not Kind.ACTION]
        raise FactError(f"the program knows no fact `{name}`", "E015", meant(name, known))
    predicate = program.predicates[index]
    if predicate.kind is Kind.ACTION:
        raise FactError(f"`{name}` is an action, not a fact", "E012")
    if fact.mark is Mark.BANG and predicate.kind is not Kind.PERSISTENT:
        raise FactError(f"`{name}` is a {predicate.kind.name.lower()} fact, not a persistent one", "E012")
    if len(fact.arguments) != len(predicate.types) + 1:
        raise FactError(f"`{name}` has {len(predicate.types) + 1} arguments, not {len(fact.arguments)}", "E011")
    owner = _owner(fact.arguments[0])
    seen: list[str] = [each.name for each in fact.arguments if isinstance(each, Variable) and not each.anonymous]
    if len(set(seen)) != len(seen):
        raise FactError("the same variable twice is not supported yet")
    pairs = zip(fact.arguments[1:], predicate.types, strict=True)
    args: list[Anything | Constant] = []
    for argument, kind in pairs:
        if isinstance(argument, Variable):
            args.append(ANY)
            continue
        literal = fold(argument)
        if literal is None:
            raise FactError("arguments are constants", "E023")
        if not fits(literal_type(literal), kind):
            given = type_text(literal_type(literal))
            raise FactError(f"an argument of `{name}` is {type_text(kind)}, not {given}", "E020")
        args.append(Constant(converted(literal.value, kind)))
    return InitialGoal(index, owner, tuple(args))


def read_fact(text: str) -> Fact:
    """Return the fact that `text` spells, whatever program it is for. Raises FactError."""
    found = Diagnostics()
    stripped = text.strip()
    module = parse(Source("<fact>", stripped if stripped.endswith(".") else stripped + "."), found)
    problems = found.in_order()
    if problems:
        raise FactError(problems[0].message)
    if len(module.items) != 1 or not isinstance(module.items[0], FactItem):
        raise FactError("this is not a fact such as `at(R, exit)`")
    return module.items[0].fact


def _owner(owner: Expression) -> int | None:
    if isinstance(owner, Variable):
        return None
    if isinstance(owner, Literal) and isinstance(owner.value, Robot):
        return int(owner.value)
    raise FactError("the first argument is a robot such as `@1`, or a variable for every robot", "E021")
