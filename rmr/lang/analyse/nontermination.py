"""Certain non-termination, found before the program runs.

Three kinds are reported. A *loop*: a rule consumes temporary facts and derives facts that satisfy it again, alone or in
a cycle of rules. A *growth*: a rule consumes nothing and derives a fact that is a new match of its own body, so the
number of facts grows without bound. A *persistent counter*: a rule consumes a fact and derives the successor of a
persistent one, whose old values stay.

The analysis has no false positives. A match must hold again for all values: each argument of the body's pattern is
repeated in the head unchanged, or is a variable with no other occurrence in the body. No other conjunct of the program
may consume the fact. Facts for other robots, and facts behind an action in `then`, do not count: also not behind a
provided action that is not declared, which is its own mistake (W108). Because of refraction
(a rule fires once for each match) a body that consumes nothing is no loop: only a new match makes it fire again.
"""

from collections.abc import Iterator

from rmr.base.record import record
from rmr.base.values import Robot
from rmr.bytecode import provided
from rmr.bytecode.program import Kind
from rmr.lang.analyse.names import Names
from rmr.lang.diagnostics.diagnostic import Diagnostics
from rmr.lang.read.syntax import (
    AggregateNode,
    Binary,
    ComprehensionNode,
    Expression,
    FactNode,
    ListTerm,
    Literal,
    Mark,
    ModuleNode,
    RuleItem,
    StepsNode,
    Variable,
    flat,
    walk,
)


@record
class _Firing:
    """The facts of its own robot that a rule consumes, keeps and derives at once."""

    rule: RuleItem
    consumed: tuple[FactNode, ...]
    kept: tuple[FactNode, ...]
    """Positive facts of the body that stay: persistent, `$`, sensed."""
    derived: dict[str, list[FactNode]]
    free: frozenset[str]
    """Variables with one occurrence in the body: they match any value."""


def warn_endless(module: ModuleNode, names: Names, found: Diagnostics) -> None:
    """Report the rules of `module` that never stop."""
    rules = [item for item in module.items if isinstance(item, RuleItem)]
    candidates = [rule for rule in rules if _may_repeat(rule) and not _reads_neighbours(rule, names)]
    if not candidates:
        return
    consumers = _consumers(rules, names)
    passing: dict[str, tuple[str, FactNode, RuleItem]] = {}
    """Edges of the graph of cycles: predicate to (derived predicate, derived fact, rule of one premise)."""
    for rule in candidates:
        firing = _firing(rule, names)
        if not firing.consumed:
            # Refraction: without consumption the same facts are the same match, which does not fire again.
            _growth(firing, names, found)
        elif _persistent_counter(firing, names, found):
            continue
        elif all(consumers[fact.name.text] == 1 for fact in firing.consumed):
            # A second consumer might take the derived fact first and so end the loop.
            if _is_loop(firing, names, consumers):
                _report_loop(firing, found)
            else:
                _pass_on(firing, names, consumers, passing)
    _cycles(passing, found)


def _may_repeat(rule: RuleItem) -> bool:
    """Whether a rule is a candidate: it derives a predicate of its body, or has one premise only."""
    if len(rule.body) == 1:
        return True
    body = [each.name.text for each in rule.body if isinstance(each, FactNode) and not each.absent]
    for part in rule.head:
        if isinstance(part, FactNode):
            if part.name.text in body:
                return True
        elif isinstance(part, StepsNode) and any(fact.name.text in body for fact in part.derived):
            return True
    return False


def _reads_neighbours(rule: RuleItem, names: Names) -> bool:
    """Whether a rule reads shared facts of another robot: these are not its own to use up, and come and go."""
    positive = [each for each in rule.body if isinstance(each, FactNode) and not each.absent]
    owners = [each.owner for each in positive]
    several = any(one is None or owners[0] is None or not _is_same(one, owners[0]) for one in owners[1:])
    return several and any(names.of(each).is_shared for each in positive)


def _consumers(rules: list[RuleItem], names: Names) -> dict[str, int]:
    """Return by predicate the number of conjuncts of the program that consume a fact of it."""
    counts: dict[str, int] = {}
    for rule in rules:
        inner = [part.body for part in flat(rule.head) if isinstance(part, ComprehensionNode | AggregateNode)]
        for body in (rule.body, *inner):
            for fact in body:
                if isinstance(fact, FactNode) and _is_used_up(fact, names):
                    counts[fact.name.text] = counts.get(fact.name.text, 0) + 1
    return counts


def _is_used_up(fact: FactNode, names: Names) -> bool:
    return not fact.absent and fact.mark not in (Mark.KEEP, Mark.GOAL) and names.of(fact).kind is Kind.TEMPORARY


def _firing(rule: RuleItem, names: Names) -> _Firing:
    positive = [each for each in rule.body if isinstance(each, FactNode) and not each.absent]
    home = positive[0].owner if positive else None
    derived: dict[str, list[FactNode]] = {}
    for fact in _at_once(rule, names):
        if home is not None and _is_same(fact.owner, home):
            derived.setdefault(fact.name.text, []).append(fact)
    seen: dict[str, int] = {}
    for each in walk(rule.body):
        if isinstance(each, Variable):
            seen[each.name] = seen.get(each.name, 0) + 1
    return _Firing(
        rule,
        tuple(fact for fact in positive if _is_used_up(fact, names)),
        tuple(fact for fact in positive if not _is_used_up(fact, names)),
        derived,
        frozenset(name for name, count in seen.items() if count == 1),
    )


def _at_once(rule: RuleItem, names: Names) -> Iterator[FactNode]:
    """Yield the facts that a head derives at once: of steps, those before the first action."""
    for part in rule.head:
        steps = part.derived if isinstance(part, StepsNode) else (part,)
        for fact in steps:
            if not isinstance(fact, FactNode) or _is_action(fact, names):
                break
            if fact.mark is not Mark.GOAL:
                yield fact


def _is_action(fact: FactNode, names: Names) -> bool:
    signature = names.of(fact)
    return signature.kind is Kind.ACTION or (signature.declaration is None and fact.name.text in provided.ACTIONS)


def _derived(rule: RuleItem) -> Iterator[FactNode]:
    """Yield the facts that a head derives outside of comprehensions and aggregates, those behind an action included."""
    for part in rule.head:
        for fact in part.derived if isinstance(part, StepsNode) else (part,):
            if isinstance(fact, FactNode) and fact.mark is not Mark.GOAL:
                yield fact


# ---- loops of one rule


def _is_loop(firing: _Firing, names: Names, consumers: dict[str, int]) -> bool:
    """Whether the rule derives every fact that it consumes, and its other conditions stay true."""
    # A derived fact might make a `not` of the body false.
    if any(isinstance(each, FactNode) and (each.absent or each.mark is Mark.GOAL) for each in firing.rule.body):
        return False
    # Each derived fact satisfies one pattern only: a body that uses up two facts needs two again.
    left = {name: list(facts) for name, facts in firing.derived.items()}
    for fact in firing.consumed:
        again = next((each for each in left.get(fact.name.text, ()) if _matches(fact, each, firing.free)), None)
        if again is None:
            return False
        left[fact.name.text].remove(again)
    # Facts that the rule only reads must stay as well: no sensor and no other rule may withdraw them.
    return all(names.of(fact).kind is not Kind.SENSED and fact.name.text not in consumers for fact in firing.kept)


def _matches(pattern: FactNode, derived: FactNode, free: frozenset[str]) -> bool:
    """Whether a derived fact matches a pattern of its own rule for all values of the variables."""
    if len(pattern.arguments) != len(derived.arguments):
        return False
    pairs = zip(pattern.arguments[1:], derived.arguments[1:], strict=True)
    return all(
        _is_same(one, other) or (isinstance(one, Variable) and (one.anonymous or one.name in free))
        for one, other in pairs
    )


def _is_same(one: Expression | None, other: Expression | None) -> bool:
    match one, other:
        case Variable(name=here), Variable(name=there):
            return here == there != "_"
        case Literal(value=here), Literal(value=there):
            return here == there and type(here) is type(there)  # in Python True == 1 == 1.0
        case _:
            return False


def _report_loop(firing: _Firing, found: Diagnostics) -> None:
    fact = firing.consumed[0]
    name = fact.name.text
    same = all(
        any(_is_equal(each, other) for other in firing.derived.get(each.name.text, ())) for each in firing.consumed
    )
    if same:
        message = f"this rule never stops: it uses up `{name}` and derives the same fact again"
        hint = f"`${name}(...)` in the body keeps the fact, and the rule fires once for each match"
    else:
        message = f"this rule never stops: each `{name}` that it uses up is followed by another one"
        hint = "add a condition that ends it, such as `N < 10`"
    found.report("W113", message, firing.rule.span, hint=hint)


def _is_equal(one: FactNode, other: FactNode) -> bool:
    return len(one.arguments) == len(other.arguments) and all(map(_is_same, one.arguments, other.arguments))


# ---- cycles of rules


def _pass_on(
    firing: _Firing, names: Names, consumers: dict[str, int], passing: dict[str, tuple[str, FactNode, RuleItem]]
) -> None:
    """Add the edge of a rule that turns every fact of one predicate into a fact of another one that is consumed."""
    if len(firing.rule.body) != 1 or not _is_any(firing.consumed[0], firing.free):
        return
    fact = firing.consumed[0]
    for name, [derived, *_] in firing.derived.items():
        if names.signatures[name].kind is Kind.TEMPORARY and consumers.get(name) == 1:
            passing[fact.name.text] = (name, derived, firing.rule)
            return


def _is_any(fact: FactNode, free: frozenset[str]) -> bool:
    """Whether a pattern matches every fact of its predicate."""
    owner = fact.owner
    return isinstance(owner, Variable) and all(
        isinstance(each, Variable) and (each.anonymous or each.name in free) for each in fact.arguments
    )


def _cycles(passing: dict[str, tuple[str, FactNode, RuleItem]], found: Diagnostics) -> None:
    done: set[str] = set()
    for start in passing:
        path: list[str] = []
        name = start
        # Cycles of up to 50 rules are searched for.
        while name in passing and name not in done and name not in path and len(path) < 50:
            path.append(name)
            name = passing[name][0]
        if name in path:  # the walk has come back to itself; what leads into the cycle is left out of the message
            cycle = path[path.index(name) :]
            way = ", ".join(f"`{each}`" for each in (*cycle, name))
            message = f"these rules never stop: {way} follow each other for ever"
            hint = "add a condition that ends it, or let an action stand between: `moveto(R, A) then ...`"
            found.report("W113", message, passing[name][2].span, hint=hint)
        done.update(path)


# ---- growth


def _growth(firing: _Firing, names: Names, found: Diagnostics) -> None:
    """Report a rule that consumes nothing and derives a new match of its own body."""
    if any(isinstance(each, FactNode) and (each.absent or each.mark is Mark.GOAL) for each in firing.rule.body):
        return
    for fact in firing.kept:
        for derived in firing.derived.get(fact.name.text, ()):
            if names.of(fact).kind is Kind.SENSED or not _matches(fact, derived, firing.free):
                continue
            if names.of(fact).kind is Kind.TEMPORARY or _is_other(fact, derived):
                message = f"this rule never stops: every `{fact.name.text}` leads to another one, and all of them stay"
                hint = "end it with a condition, such as `N < 10`"
                if any(isinstance(each, Binary) for each in derived.arguments):
                    hint += "; to count, use up a temporary fact: `type count(robot, int).`"
                found.report("W114", message, firing.rule.span, hint=hint)
                return


def _persistent_counter(firing: _Firing, names: Names, found: Diagnostics) -> bool:
    """Report a rule that consumes a fact and increments a persistent one; return whether it does.

    The old values stay, so the next consumed fact matches any of them.
    """
    absent = {each.name.text for each in firing.rule.body if isinstance(each, FactNode) and each.absent}
    for fact in firing.kept:
        name = fact.name.text
        if names.of(fact).kind is not Kind.PERSISTENT or name in absent:
            continue
        for derived in _derived(firing.rule):
            is_counted = derived.name.text == name and _is_same(derived.owner, fact.owner)
            if is_counted and _matches(fact, derived, firing.free) and _is_other(fact, derived):
                message = f"`{name}` is persistent: the old fact stays beside the new one, and this rule matches both"
                hint = f"a temporary fact is replaced: `type {name}(...)` and `{name}(...)`, without `!`"
                found.report("W114", message, firing.rule.span, hint=hint)
                return True
    return False


def _is_other(pattern: FactNode, derived: FactNode) -> bool:
    """Whether a derived fact differs from the fact it follows from, for all values of the variables."""
    return any(
        isinstance(one, Variable) and _grows(one, other)
        for one, other in zip(pattern.arguments[1:], derived.arguments[1:], strict=False)
    )


def _grows(variable: Variable, value: Expression) -> bool:
    """Whether `value` is strictly monotonic in `variable`: never equal to it or to an earlier value."""
    match value:
        case Binary(operator="+" | "-", left=Variable(name=name), right=Literal(value=step)):
            return name == variable.name and step not in (0, "", ()) and not isinstance(step, Robot)
        case Binary(operator="+", left=Literal(value=step), right=Variable(name=name)):
            return name == variable.name and step not in (0, "", ()) and not isinstance(step, Robot)
        case ListTerm(items=[_, *_], rest=Variable(name=name)):
            return name == variable.name
        case _:
            return False
