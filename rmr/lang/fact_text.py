"""Facts given as text: a file of facts, an `--insert` on the command line.

Robots carry no parser. The process that starts them converts text to values, with the types of their program.
"""

from typing import NamedTuple

from rmr.base.printable import counted
from rmr.base.values import Robot, Value
from rmr.bytecode.program import ANY, SELF_SLOT, Constant, InitialFact, Kind, Pattern, Predicate, Program, Slot, Type
from rmr.bytecode.provided import PREDICATES
from rmr.lang.analyse.folding import Folder
from rmr.lang.analyse.names import meant
from rmr.lang.analyse.types import ROBOT, converted, declaration_text, fits, literal_type, type_text
from rmr.lang.diagnostics.diagnostic import Diagnostics
from rmr.lang.read.parser import parse
from rmr.lang.read.source_text import SourceText, Span
from rmr.lang.read.syntax import Call, Expression, FactItem, FactNode, GoalItem, Literal, Mark, Variable, walk


class FactError(Exception):
    """The text is no fact of the program; the message gives the reason, without the text itself.

    `code` is the diagnostic code of the same mistake in a program, `span` its place in the text.
    """

    def __init__(self, message: str, code: str = "E001", span: Span | None = None, hint: str | None = None) -> None:
        super().__init__(message if hint is None else f"{message}; {hint}")
        self.message = message
        self.code = code
        self.span = span
        self.hint = hint


def stated(fact: FactNode, program: Program) -> InitialFact:
    """Return the initial fact for `fact`; a variable as owner means every robot, and an argument may repeat it.

    Arguments are converted to the types of the program. Raises FactError.
    """
    index, predicate = _predicate(fact, program)
    owner = fact.arguments[0]
    args: list[Value | Slot] = []
    for argument, kind in zip(fact.arguments[1:], predicate.types, strict=True):
        if not isinstance(argument, Variable):
            args.append(_value(argument, kind, predicate))
        elif _is_owner(argument, owner):
            _check_robot(argument, kind, predicate)
            args.append(Slot(SELF_SLOT))
        else:
            raise FactError("a fact has constant arguments, only its owner may be a variable", "E023", argument.span)
    return InitialFact(index, _robot(owner), tuple(args))


def action_patterns(text: str, program: Program) -> tuple[str, tuple[Pattern, ...]]:
    """Return the name of an action and the patterns of its arguments, the executor first, for ``charge(@2, _)``.

    A name alone, ``charge``, matches every executor and argument. A variable is a wildcard; its occurrences match equal
    values. Raises FactError.
    """
    name = text.strip()
    fact = None
    if not name.isidentifier():
        fact = read_fact(text)
        name = fact.name.text
    index = program.index(name)
    if index is None or program.predicates[index].kind is not Kind.ACTION:
        known = [each.name for each in program.predicates if each.kind is Kind.ACTION]
        raise FactError(f"the program has no action `{name}`", hint=meant(name, known))
    predicate = program.predicates[index]
    if fact is None:
        return name, (ANY,) * (1 + len(predicate.types))
    if fact.mark is not Mark.NONE:
        raise FactError(f"`{name}` is an action: write it without a mark")
    _check_arity(fact, predicate)
    slots: dict[str, Slot] = {}
    patterns: list[Pattern] = []
    for argument, kind in zip(fact.arguments, (ROBOT, *predicate.types), strict=True):
        if not isinstance(argument, Variable):
            patterns.append(Constant(_value(argument, kind, predicate)))
        elif argument.anonymous:
            patterns.append(ANY)
        else:
            patterns.append(slots.setdefault(argument.name, Slot(len(slots))))
    return name, tuple(patterns)


class FactPattern(NamedTuple):
    """A fact, goal or action with variables, which match anything."""

    predicate: int
    goal: bool
    """Whether it was written with ``?``."""
    owner: int | None
    """None: any robot."""
    args: tuple[Pattern, ...]
    """Without the owner. Slot 0 is the owner; any other slot is a variable with several occurrences."""


def fact_pattern(text: str, program: Program) -> FactPattern:
    """Return the pattern in `text`: a fact ``at(@4, A)``, a goal ``?at(@4, exit)`` or an action ``moveto(R, _)``.

    Raises FactError.
    """
    found = Diagnostics()
    stripped = text.strip()
    if not stripped:
        raise FactError("there is nothing in it; write a fact such as `at(@4, exit)`")
    module = parse(SourceText("<fact>", stripped if stripped.endswith(".") else stripped + "."), found)
    problems = found.in_order()
    if problems:
        raise FactError(problems[0].message)
    item = module.items[0] if len(module.items) == 1 else None
    if not isinstance(item, FactItem | GoalItem) or item.fact.mark is Mark.KEEP:
        raise FactError("this is not a fact such as `at(@4, exit)`")
    fact = item.fact
    index, predicate = _known(fact, program, [each.name for each in program.predicates])
    if predicate.kind is Kind.ACTION and fact.mark is not Mark.NONE:
        raise FactError(f"`{predicate.name}` is an action: write it without a mark")
    _check_bang(fact, predicate)
    _check_arity(fact, predicate)
    owner = fact.arguments[0]
    slots: dict[str, Slot] = {}
    if isinstance(owner, Variable) and not owner.anonymous:
        slots[owner.name] = Slot(SELF_SLOT)
    args: list[Pattern] = []
    for argument, kind in zip(fact.arguments[1:], predicate.types, strict=True):
        if not isinstance(argument, Variable):
            args.append(Constant(_value(argument, kind, predicate)))
        else:
            args.append(ANY if argument.anonymous else slots.setdefault(argument.name, Slot(len(slots) + 1)))
    return FactPattern(index, isinstance(item, GoalItem), _robot(owner), tuple(args))


def _known(fact: FactNode, program: Program, known: list[str]) -> tuple[int, Predicate]:
    """Return index and row of the predicate of `fact`; `known` are the names that it may have been meant for."""
    name = fact.name.text
    index = program.index(name)
    if index is None:
        hint = meant(name, known) or ("every robot provides it, but no rule uses it" if name in PREDICATES else None)
        raise FactError(f"the program knows no fact `{name}`", "E015", fact.name.span, hint)
    return index, program.predicates[index]


def _check_bang(fact: FactNode, predicate: Predicate) -> None:
    if fact.mark is Mark.BANG and predicate.kind is not Kind.PERSISTENT:
        kind = predicate.kind.name.lower()
        raise FactError(f"`{predicate.name}` is a {kind} fact, not a persistent one", "E012")


def _predicate(fact: FactNode, program: Program) -> tuple[int, Predicate]:
    """Return index and row of the predicate of `fact`, after a check of kind and arity."""
    name = fact.name.text
    known = [each.name for each in program.predicates if each.kind is not Kind.ACTION]
    index, predicate = _known(fact, program, known)
    if predicate.kind is Kind.ACTION:
        raise FactError(f"`{name}` is an action, not a fact", "E012", fact.name.span)
    _check_bang(fact, predicate)
    _check_arity(fact, predicate)
    return index, predicate


def _check_arity(fact: FactNode, predicate: Predicate) -> None:
    arity = len(predicate.types) + 1
    if len(fact.arguments) != arity:
        message = f"`{predicate.name}` has {counted(arity, 'argument')}, not {len(fact.arguments)}"
        raise FactError(message, "E011", hint=_signature(predicate))


def _signature(predicate: Predicate) -> str:
    """Return the hint with the declaration of a predicate."""
    word = {Kind.PERSISTENT: "!", Kind.SENSED: "sensor ", Kind.ACTION: "action "}.get(predicate.kind, "")
    return f"it is `{declaration_text(predicate.name, predicate.types, word)}`"


def _value(argument: Expression, kind: Type, predicate: Predicate) -> Value:
    folder = Folder({})
    literal = folder.fold(argument)
    for each in folder.valueless:
        raise FactError(f"this has no value: {each.reason}", "E005" if each.out_of_range else "E023", each.span)
    if not isinstance(literal, Literal):
        varies = any(isinstance(each, Variable | Call) for each in walk(literal))
        message, code = ("arguments are constants", "E023") if varies else ("its types contradict each other", "E020")
        raise FactError(message, code, argument.span)
    if not fits(literal_type(literal), kind):
        raise _misfit(argument, kind, literal_type(literal), predicate)
    return converted(literal.value, kind)


def _misfit(argument: Expression, kind: Type, given: Type, predicate: Predicate) -> FactError:
    message = f"an argument of `{predicate.name}` is {type_text(kind)}, not {type_text(given)}"
    return FactError(message, "E020", argument.span, _signature(predicate))


def _is_owner(variable: Variable, owner: Expression) -> bool:
    return isinstance(owner, Variable) and variable.name == owner.name and not variable.anonymous


def _check_robot(argument: Expression, kind: Type, predicate: Predicate) -> None:
    if not fits(ROBOT, kind):
        raise _misfit(argument, kind, ROBOT, predicate)


def read_fact(text: str) -> FactNode:
    """Return the syntax tree of the fact in `text`, independent of any program. Raises FactError."""
    found = Diagnostics()
    stripped = text.strip()
    module = parse(SourceText("<fact>", stripped if stripped.endswith(".") else stripped + "."), found)
    problems = found.in_order()
    if problems:
        raise FactError(problems[0].message)
    if len(module.items) != 1 or not isinstance(module.items[0], FactItem):
        raise FactError("this is not a fact such as `at(R, exit)`")
    return module.items[0].fact


def _robot(owner: Expression) -> int | None:
    if isinstance(owner, Variable):
        return None
    if isinstance(owner, Literal) and isinstance(owner.value, Robot):
        return int(owner.value)
    raise FactError("the first argument is a robot such as `@1`, or a variable for every robot", "E021", owner.span)
