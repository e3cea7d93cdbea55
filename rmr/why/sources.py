"""Static sources of a predicate: the rules, and the effects of actions, that can derive a fact, goal or action.

A source is compared with the question by unification: constants must agree, and a variable of the head takes the value
that the question asks for, so that the search for the rule's match begins with it.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from rmr.base.values import Robot, Value
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    ANY,
    SELF_SLOT,
    Aggregate,
    Assertion,
    Code,
    Comprehension,
    Conjunct,
    Constant,
    DeriveAction,
    Derived,
    DeriveFact,
    DeriveGoal,
    Effect,
    Head,
    HeadValue,
    Operator,
    Pattern,
    Program,
    Steps,
    When,
)
from rmr.vm.evaluate import same
from rmr.why.question import Question


class RuleSource(NamedTuple):
    """An item of a rule's head that may derive what is asked for."""

    rule: int
    body: tuple[Conjunct, ...]
    """The rule's body, and that of the comprehension."""
    outer: int
    """Number of conjuncts of the rule's own body."""
    item: Derived
    here: bool
    """Whether the rule derives it for its own robot."""
    env: tuple[Value | None, ...]
    """Values that the question gives to the rule's slots; slot 0 if only one robot can fire it."""


class EffectSource(NamedTuple):
    """An action with an effect that is what is asked for."""

    action: int
    effect: Effect
    ok: bool
    """False: an ``else`` effect."""
    executor: int | None
    """None: any robot."""
    args: tuple[Pattern, ...]
    """Arguments that the action needs."""


def rule_sources(program: Program, asked: Question) -> list[RuleSource]:
    """Return the items of heads that may derive what is asked of one robot, in program order."""
    wanted = DeriveAction if asked.action else DeriveGoal if asked.goal else DeriveFact
    found = []
    for index, rule in enumerate(program.rules):
        for item, inner in _items(rule.head):
            if isinstance(item, wanted) and item.predicate == asked.predicate:
                env = _unified(item.owner, item.args, asked, rule.slots)
                if env is not None:
                    here = _slot(item.owner) == SELF_SLOT
                    found.append(RuleSource(index, (*rule.body, *inner), len(rule.body), item, here, tuple(env)))
    return found


def effect_sources(program: Program, asked: Question) -> list[EffectSource]:
    """Return the actions with an effect that is what is asked of one robot."""
    found = []
    for index, action in enumerate(program.predicates):
        for ok, effects in ((True, action.effects), (False, action.else_effects)):
            for effect in effects:
                if effect.predicate != asked.predicate or asked.goal or asked.action:
                    continue
                env = _unified(effect.owner, effect.args, asked, 1 + len(action.types))
                if env is not None:
                    args = tuple([ANY if value is None else Constant(value) for value in env[1:]])
                    executor = env[0]
                    found.append(EffectSource(index, effect, ok, None if executor is None else int(executor), args))  # type: ignore[arg-type]
    return found


def violation_sources(program: Program, asked: Question) -> list[Assertion]:
    """Return the time assertions whose violation is what is asked of one robot, a fact."""
    return [
        each
        for each in program.assertions
        if isinstance(each.violation, DeriveFact) and not asked.goal and not asked.action
        if each.violation.predicate == asked.predicate
        if _unified(each.violation.owner, each.violation.args, asked, each.slots) is not None
    ]


def may_be_sent(program: Program, asked: Question) -> bool:
    """Return whether another robot may send what is asked for: a fact, a goal, an action, or an effect."""
    if any(_slot(each.violation.owner) != SELF_SLOT for each in violation_sources(program, asked)):
        return True
    if any(not source.here for source in rule_sources(program, asked)):
        return True
    return any(_slot(source.effect.owner) != SELF_SLOT for source in effect_sources(program, asked))


def _items(head: Sequence[Head]) -> Iterator[tuple[Derived, tuple[Conjunct, ...]]]:
    """Yield the items of a head, each with the inner body that must match for it."""
    for each in head:
        part = each.item if isinstance(each, When) else each
        match part:
            case Comprehension(body=body, head=items):
                for item in items:
                    yield item, body
            case Aggregate(operator=operator, body=body, head=items):
                for item in items:
                    yield item, body if operator in (Operator.MIN, Operator.MAX) else ()
            case Steps(steps=steps):
                for item in steps:
                    yield item, ()
            case DeriveFact() | DeriveGoal() | DeriveAction():
                yield part, ()
            case HeadValue():
                pass


def _unified(owner: Code, args: Sequence[Code], asked: Question, slots: int) -> list[Value | None] | None:
    """Return the slots' values for which a head item is what is asked for; None if it never is."""
    assert asked.owner is not None
    env: list[Value | None] = [None] * slots
    pairs: list[tuple[Code, Pattern]] = [(owner, Constant(Robot(asked.owner))), *zip(args, asked.args, strict=True)]
    for code, pattern in pairs:
        if not isinstance(pattern, Constant):
            continue
        slot = _slot(code)
        known: Value | None = None
        if slot is not None:
            known = env[slot]
            if known is None:
                env[slot] = pattern.value
        elif len(code) == 1 and code[0].op in (Op.CONST, Op.INT):
            known = code[0].operand
        if known is not None and not same(known, pattern.value):
            return None
    return env


def _slot(code: Code) -> int | None:
    """Return the slot that an expression is; None if it is another expression."""
    if len(code) == 1 and code[0].op is Op.LOAD:
        assert isinstance(code[0].operand, int)
        return code[0].operand
    return None
