"""Time assertions: the robot that holds a job, the scope of the start fact, the robot that reports the end.

The owner of the start fact holds the job. Finish fact and violation may belong to other robots, which are arguments of
the start fact or constants. Deadline and violation use variables of the start fact only. A variable of the finish fact
that the start fact does not bind is a wildcard.
"""

from rmr.base.record import record
from rmr.bytecode.program import SELF_SLOT
from rmr.lang.diagnostics.diagnostic import DiagnosticNote, Diagnostics
from rmr.lang.lower.ordering import bound_hint, variables
from rmr.lang.lower.robot_rules import SELF, Environment
from rmr.lang.read.syntax import AssertionItem, Expression, FactNode, Literal, ModuleNode, Name, Variable, walk


@record
class Watched:
    """A time assertion with its environment."""

    item: AssertionItem
    environment: Environment
    finish: tuple[Variable | Literal, ...]
    """Arguments of the finish fact; an unbound variable with one occurrence is replaced by `_`."""


def watched(item: AssertionItem, found: Diagnostics) -> Watched | None:
    """Return `item` with slots for its variables, or None after reporting an error."""
    home = item.start.owner
    if home is None or item.finish.owner is None or item.violation.owner is None:
        return None
    facts = (item.start, item.finish)
    robots = [_is_robot(fact, word, found) for fact, word in zip(facts, ("start", "finish"), strict=True)]
    plain = [_is_plain(argument, found) for fact in facts for argument in fact.arguments[1:]]
    if not all(robots + plain):
        return None
    environment = Environment({SELF: SELF_SLOT})
    if isinstance(home, Variable) and not home.anonymous:
        environment.slots[home.name] = SELF_SLOT
    for each in variables(item.start.arguments[1:]):
        environment.slot(each.name)
    if not _is_bound_by_start(item, environment, found):
        return None
    return Watched(item, environment, _finish(item.finish, environment))


def _is_robot(fact: FactNode, word: str, found: Diagnostics) -> bool:
    if isinstance(fact.owner, Variable | Literal):
        return True
    assert fact.owner is not None
    found.report("E021", f"the owner of the {word} fact is a variable or a robot", fact.owner.span)
    return False


def _is_plain(argument: Expression, found: Diagnostics) -> bool:
    if isinstance(argument, Variable | Literal):
        return True
    found.report("E023", "the facts of a time assertion have variables and constants as arguments", argument.span)
    return False


def _is_bound_by_start(item: AssertionItem, environment: Environment, found: Diagnostics) -> bool:
    good = True
    for node in (item.finish.owner, item.deadline, item.violation.arguments):
        for each in walk(node):
            if isinstance(each, Variable) and not environment.knows(each.name):
                notes = (
                    DiagnosticNote(
                        item.start.span, "binds the finish fact's robot, and what deadline and violation use"
                    ),
                )
                hint = bound_hint(each, environment)
                found.report("E030", f"the start fact does not bind `{each.name}`", each.span, hint=hint, notes=notes)
                good = False
    return good


def _finish(finish: FactNode, environment: Environment) -> tuple[Variable | Literal, ...]:
    """Return the arguments of the finish fact; unbound variables become wildcards, repeated ones get a slot."""
    names = [each.name for each in variables(finish.arguments[1:])]
    arguments: list[Variable | Literal] = []
    for argument in finish.arguments[1:]:
        assert isinstance(argument, Variable | Literal)
        if isinstance(argument, Literal) or argument.anonymous or environment.knows(argument.name):
            arguments.append(argument)
        elif names.count(argument.name) == 1:
            arguments.append(Variable("_", argument.span))
        else:
            environment.slot(argument.name)
            arguments.append(argument)
    return tuple(arguments)


def check_names(module: ModuleNode, found: Diagnostics) -> None:
    """Report time assertions that share a name, stated or that of the finish fact."""
    called: dict[str, tuple[Name, bool]] = {}
    for item in module.items:
        if not isinstance(item, AssertionItem):
            continue
        name = item.name or item.finish.name
        earlier, stated = called.setdefault(name.text, (name, item.name is not None))
        if earlier is not name:
            notes = (DiagnosticNote(earlier.span, "first used here"),)
            message = f"two time assertions are called `{name.text}`"
            named = stated and item.name is not None
            hint = None if named else "without a name it has that of its finish fact; name them: `name: assert(...)`"
            found.report("E010", message, name.span, hint=hint, notes=notes)
