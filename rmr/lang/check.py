"""The checker: everything that can be wrong with a program, found in one pass over the whole of it.

Parts of it live elsewhere: kinds and arities in names.py, types in infer.py, who owns what and what is bound
in project.py, doubts that do not stop compilation in warn.py. This module holds them together and checks what
the program states: facts, goals, effects, time assertions, the strategy.
"""

from dataclasses import dataclass, replace

from rmr.base.values import Symbol
from rmr.bytecode.program import SELF_SLOT
from rmr.lang.constants import resolve
from rmr.lang.diagnostic import Diagnostics, Note
from rmr.lang.infer import Inference
from rmr.lang.names import Names, collect, meant
from rmr.lang.project import Projector, variables
from rmr.lang.source import Span
from rmr.lang.steps import SELF, Environment, Projected
from rmr.lang.syntax import (
    Aggregate,
    Assertion,
    Call,
    Comprehension,
    Condition,
    Expression,
    Fact,
    FactItem,
    GoalItem,
    Include,
    ListTerm,
    Literal,
    Module,
    Name,
    Rule,
    Steps,
    Strategy,
    TypeDeclaration,
    TypeName,
    Variable,
    walk,
)
from rmr.lang.types import LATER, Types
from rmr.lang.warn import warn

PARTS_MAX = 250
"""Conjuncts of a body, parts of a head and arguments of a fact: a program with more is not written by hand."""

STRATEGIES = ("random", "textual")


@dataclass(frozen=True, slots=True)
class Watched:
    """A time assertion of one robot."""

    item: Assertion
    environment: Environment
    finish: tuple[Variable | Literal, ...]


@dataclass(frozen=True, slots=True)
class Checked:
    """A program without its mistakes; complete only if no error was reported."""

    module: Module
    names: Names
    types: Types
    rules: tuple[Projected, ...]
    assertions: tuple[Watched, ...]
    textual: bool


def check(module: Module, found: Diagnostics) -> Checked:
    """Check `module` as a whole and report to `found`."""
    module = resolve(module, found)
    module = replace(module, items=tuple(item for item in module.items if not _too_large(item, found)))
    later = {id(item) for item in module.items if _not_yet(item, found)}
    names = collect(module, found)
    types = Inference(names, module.broken, found).run(module)
    symbols = {
        node.value for node in walk(module.items) if isinstance(node, Literal) and isinstance(node.value, Symbol)
    }
    projector = Projector(names, types, frozenset(symbols), found)
    rules: list[Projected] = []
    assertions: list[Watched] = []
    for item in module.items:
        match item:
            case FactItem(fact=fact):
                _stated(fact, found)
            case GoalItem(fact=fact):
                _goal(fact, found)
            case TypeDeclaration():
                _effects(item, found)
            case Rule():
                _untimed(item, found)
                projected = None if id(item) in later else projector.rule(item)
                if projected is not None:
                    rules.append(projected)
            case Assertion():
                watched = _assertion(item, found)
                if watched is not None:
                    assertions.append(watched)
            case _:
                pass
    _assertion_names(module, found)
    checked = Checked(module, names, types, tuple(rules), tuple(assertions), _textual(module, found))
    warn(module, names, found)
    return checked


def _not_yet(item: object, found: Diagnostics) -> bool:
    """Report what the language has and the compiler does not, and say whether `item` holds any of it."""
    before = found.count
    for node in walk(item):
        match node:
            case Include():
                found.report("E002", "`include` is not supported yet", node.span)
            case Steps():
                found.report("E002", "`then` is not supported yet", node.span)
            case Aggregate():
                found.report("E002", "aggregates are not supported yet", node.span)
            case ListTerm() | TypeName(element=TypeName()):
                found.report("E002", "lists are not supported yet", node.span)
            case Call(name=name) if name.text in LATER:
                found.report("E002", f"the function `{name.text}` is not supported yet", node.span)
            case _:
                pass
    return found.count > before


def _too_large(item: object, found: Diagnostics) -> bool:
    for node in walk(item):
        parts: tuple[object, ...] = ()
        match node:
            case Rule(body=body, head=head):
                parts = max(body, head, key=len)
            case Comprehension(body=body, head=derived):
                parts = max(body, derived, key=len)
            case Fact(arguments=arguments) | Call(arguments=arguments):
                parts = arguments
            case TypeDeclaration(parameters=parameters):
                parts = parameters
        if len(parts) > PARTS_MAX:
            assert isinstance(node, Rule | Comprehension | Fact | Call | TypeDeclaration)
            found.report("E008", f"this has {len(parts)} parts, more than {PARTS_MAX}", node.span)
            return True
    return False


# ---- facts and goals


def _owner(fact: Fact, found: Diagnostics) -> Variable | None:
    owner = fact.owner
    if owner is not None and not isinstance(owner, Variable | Literal):
        found.report("E023", "the owner of a stated fact is a robot, or a variable for every robot", owner.span)
    return owner if isinstance(owner, Variable) else None


def _stated(fact: Fact, found: Diagnostics) -> None:
    owner = _owner(fact, found)
    for argument in fact.arguments[1:]:
        if isinstance(argument, Literal):
            continue
        if isinstance(argument, Variable) and owner is not None and argument.name == owner.name != "_":
            found.report("E002", "the owner as a value of a stated fact is not supported yet", argument.span)
            continue
        hint = None
        if isinstance(argument, Variable) and argument.name[0].isupper():
            hint = f"a constant would be `{argument.name[0].lower()}{argument.name[1:]}`"
        found.report("E023", "a fact that the program states has constant arguments", argument.span, hint=hint)


def _goal(fact: Fact, found: Diagnostics) -> None:
    owner = _owner(fact, found)
    seen = {owner.name} if owner is not None else set()
    for argument in fact.arguments[1:]:
        if isinstance(argument, Literal):
            continue
        if not isinstance(argument, Variable):
            found.report("E023", "a goal's arguments are constants, or variables for anything", argument.span)
        elif argument.name in seen and not argument.anonymous:
            found.report("E002", f"`{argument.name}` twice in a goal is not supported yet", argument.span)
        else:
            seen.add(argument.name)


# ---- effects


def _effects(item: TypeDeclaration, found: Diagnostics) -> None:
    named: dict[str, Span] = {}
    for parameter in item.parameters:
        variable = parameter.variable
        if variable is None or variable.anonymous:
            continue
        if variable.name in named:
            notes = (Note(named[variable.name], "here"),)
            found.report("E031", f"`{variable.name}` names two arguments", variable.span, notes=notes)
        named[variable.name] = variable.span
    first = item.parameters[0].variable if item.parameters else None
    for effect in (*item.effects, *item.else_effects):
        for each in variables(effect):
            if each.name not in named:
                hint = "name the arguments: `type action moveto(R: robot, A: area) -o at(R, A).`"
                found.report("E030", f"no argument is called `{each.name}`", each.span, hint=hint)
        _no_anonymous(effect, found)
        owner = effect.owner
        own = isinstance(owner, Variable) and first is not None and owner.name == first.name
        if owner is not None and not own and not (isinstance(owner, Variable) and owner.name not in named):
            found.report("E002", "an effect on another robot than the executor is not supported yet", owner.span)


def _no_anonymous(fact: Fact, found: Diagnostics) -> None:
    for each in walk(fact):
        if isinstance(each, Variable) and each.anonymous:
            found.report("E030", "`_` has no value", each.span, hint="name what is derived")


# ---- rules


def _untimed(rule: Rule, found: Diagnostics) -> None:
    """`now()` stands in heads only: time alone satisfies no rule."""
    inner = [part.body for part in rule.head if isinstance(part, Comprehension)]
    for body in (rule.body, *inner):
        for conjunct in body:
            _no_now(conjunct.expression if isinstance(conjunct, Condition) else conjunct, found)


def _no_now(node: object, found: Diagnostics) -> None:
    for each in walk(node):
        if isinstance(each, Call) and each.name.text == "now":
            hint = "time alone satisfies no rule; a time assertion watches a deadline"
            found.report("E034", "`now()` stands in heads only", each.span, hint=hint)


# ---- time assertions


def _assertion(item: Assertion, found: Diagnostics) -> Watched | None:
    home = item.start.owner
    if home is None or item.finish.owner is None or item.violation.owner is None:
        return None
    if isinstance(home, Literal):
        found.report("E002", "a time assertion for one named robot is not supported yet", home.span)
        return None
    if not isinstance(home, Variable):
        found.report("E021", "the owner of the start fact is a variable", home.span)
        return None
    for fact in (item.finish, item.violation):
        owner = fact.owner
        if not (isinstance(owner, Variable) and owner.name == home.name and not owner.anonymous):
            notes = (Note(home.span, "the job's robot"),)
            found.report("E002", "a time assertion across robots is not supported yet", fact.span, notes=notes)
            return None
    environment = Environment({SELF: SELF_SLOT, home.name: SELF_SLOT})
    plain = [_plain(argument, found) for fact in (item.start, item.finish) for argument in fact.arguments[1:]]
    if not all(plain):
        return None
    for each in variables(item.start.arguments[1:]):
        environment.slot(each.name)
    if not _bound_by_start(item, environment, found):
        return None
    return Watched(item, environment, _finish(item.finish, environment))


def _plain(argument: Expression, found: Diagnostics) -> bool:
    if isinstance(argument, Variable | Literal):
        return True
    found.report("E023", "the facts of a time assertion have variables and constants as arguments", argument.span)
    return False


def _bound_by_start(item: Assertion, environment: Environment, found: Diagnostics) -> bool:
    good = True
    for node in (item.deadline, item.violation.arguments):
        for each in walk(node):
            if isinstance(each, Variable) and (each.anonymous or not environment.knows(each.name)):
                notes = (Note(item.start.span, "binds what deadline and violation may use"),)
                found.report("E030", f"the start fact does not bind `{each.name}`", each.span, notes=notes)
                good = False
    _no_now(item.deadline, found)
    return good


def _finish(finish: Fact, environment: Environment) -> tuple[Variable | Literal, ...]:
    """Return F's arguments; what S does not bind matches anything."""
    names = [each.name for each in variables(finish.arguments[1:])]
    arguments: list[Variable | Literal] = []
    for argument in finish.arguments[1:]:
        if isinstance(argument, Variable) and not argument.anonymous and not environment.knows(argument.name):
            if names.count(argument.name) == 1:
                argument = Variable("_", argument.span)  # noqa: PLW2901
            else:
                environment.slot(argument.name)
        assert isinstance(argument, Variable | Literal)
        arguments.append(argument)
    return tuple(arguments)


def _assertion_names(module: Module, found: Diagnostics) -> None:
    """Report time assertions that share a name, stated or that of the finish fact."""
    called: dict[str, tuple[Name, bool]] = {}
    for item in module.items:
        if not isinstance(item, Assertion):
            continue
        name = item.name or item.finish.name
        earlier, stated = called.setdefault(name.text, (name, item.name is not None))
        if earlier is not name:
            notes = (Note(earlier.span, "first used here"),)
            message = f"two time assertions are called `{name.text}`"
            named = stated and item.name is not None
            hint = None if named else "without a name it has that of its finish fact; name them: `name: assert(...)`"
            found.report("E010", message, name.span, hint=hint, notes=notes)


# ---- strategy


def _textual(module: Module, found: Diagnostics) -> bool:
    stated = [item for item in module.items if isinstance(item, Strategy)]
    for item in stated:
        name = item.name.text
        if name not in STRATEGIES:
            hint = meant(name, list(STRATEGIES)) or "known are `random` and `textual`"
            found.report("E015", f"there is no order `{name}`", item.name.span, hint=hint)
    for item in stated[1:]:
        notes = (Note(stated[0].span, "first stated here"),)
        found.report("E010", "the order is stated twice", item.span, notes=notes)
    return bool(stated) and stated[0].name.text == "textual"
