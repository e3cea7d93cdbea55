"""The answer to a question why: the trees of all that matches, newest first."""

from typing import Final

from rmr.base.time import Instant
from rmr.vm.provenance import EffectCause, FiringCause, HeardCause
from rmr.why.explain import DEPTH, Explainer, Premise
from rmr.why.mind_index import MindIndex
from rmr.why.past import Past
from rmr.why.past_items import PastAction, PastFact, PastGoal, PastItem
from rmr.why.question import Question, WhyError
from rmr.why.rule_words import item_text, rule_name, seconds_text
from rmr.why.why_tree import WhyAnswer

ANSWERS_MAX: Final = 10
"""Answers shown where several items match; the newest ones."""


def why(
    past: Past, asked: Question, at: Instant | None = None, depth: int = DEPTH, more: str | None = None
) -> WhyAnswer:
    """Return the explanation of what is `asked`, as of `at` (None: the end), or of item number `more`.

    Raises WhyError if there is no such item.
    """
    until = past.known_until if at is None else min(at, past.known_until)
    answer = WhyAnswer(asked.text(past.program), until, past.known_until)
    if at is not None and at > past.known_until:
        answer.notes.append(f"the run is known until {seconds_text(past.known_until)}")
    if more is not None:
        answer.trees.append(Explainer(past, asked.owner).tree(_item(past, asked, more), depth))
        return answer
    found = _found(past, asked, until)
    for premise in found[:ANSWERS_MAX]:
        answer.trees.append(Explainer(past, asked.owner).tree(premise, depth))
        note = _end(past, premise, until)
        if note:
            answer.notes.append(note)
    if len(found) > ANSWERS_MAX:
        answer.notes.append(f"{len(found) - ANSWERS_MAX} older answers are not shown")
    if not found:
        answer.notes.append(_never(asked, answer))
    return answer


def _never(asked: Question, answer: WhyAnswer) -> str:
    happened = "was never derived" if asked.action else "was never opened" if asked.goal else "never held"
    return (
        f"{answer.question} {happened} up to {seconds_text(answer.at)}; "
        "ask with --not which rules could have derived it and what was missing"
    )


def _item(past: Past, asked: Question, more: str) -> Premise:
    first, dot, last = more.partition(".")
    number = last if dot else first
    robot = int(first) if dot and first.isdecimal() else asked.owner
    if robot is None:
        raise WhyError(f"--more {more}: the fact names no robot; write the number as ROBOT.NUMBER")
    found = past.item(robot, int(number)) if number.isdecimal() and robot in past.robots else None
    if found is None:
        raise WhyError(f"--more {more}: there is no such number in this run")
    return Premise(*found)


def _found(past: Past, asked: Question, until: Instant) -> list[Premise]:
    """Return the newest item for each distinct fact, goal or action that matches, newest first."""
    newest: dict[object, Premise] = {}
    for robot in past.robots if asked.owner is None else [asked.owner]:
        for mind in past.minds(robot):
            if mind.begins <= until:
                for item in _items(mind, asked):
                    if item.at <= until and _matches(asked, mind, item):
                        newest[robot, repr(item.args)] = Premise(mind, item)
    return sorted(newest.values(), key=lambda each: (-each.item.at, each.mind.robot, -each.item.number))


def _items(mind: MindIndex, asked: Question) -> list[PastItem]:
    if asked.goal:
        return [goal for goal in mind.goals if goal.predicate == asked.predicate]
    if asked.action:
        return [action for action in mind.actions.values() if action.predicate == asked.predicate]
    return list(mind.by_predicate[asked.predicate])


def _matches(asked: Question, mind: MindIndex, item: PastItem) -> bool:
    if asked.goal:
        return isinstance(item, PastGoal) and goal_agrees(asked.of(mind.robot), item)
    owner = item.executor if isinstance(item, PastAction) else mind.robot
    assert isinstance(item, PastAction | PastFact)
    return asked.matches(owner, item.args)


def goal_agrees(asked: Question, goal: PastGoal) -> bool:
    """Return whether constants agree wherever both the question and the goal have one."""
    pairs = zip(asked.args, goal.args, strict=True)
    return all(getattr(one, "value", None) in (None, getattr(other, "value", None)) for one, other in pairs)


def _end(past: Past, premise: Premise, until: Instant) -> str:
    """Return how a fact ended that holds no more; empty for one that holds."""
    mind, item, _ = premise
    if not isinstance(item, PastFact):
        return ""
    explainer = Explainer(past, mind.robot)
    text = explainer.text(mind, item)
    if item.until <= until:
        return f"{text} held until {seconds_text(item.until)}: {removal(past, mind, item)}"
    present = past.mind_at(mind.robot, until)
    if present is not mind and present is not None:
        return f"{text} was lost when robot {mind.robot} was restarted, {seconds_text(present.begins)}"
    return ""


def removal(past: Past, mind: MindIndex, fact: PastFact) -> str:
    """Return what removed a fact that holds no more."""
    best = past.program.predicates[fact.predicate].best
    if best is not None:
        key = fact.args[: best.argument]
        after = (each for each in mind.by_predicate[fact.predicate] if each.number > fact.number)
        better = next((each for each in after if each.args[: best.argument] == key), None)
        return "replaced by " + ("a better one" if better is None else Explainer(past, mind.robot).text(mind, better))
    if isinstance(fact.removal, FiringCause):
        rule = mind.firings[fact.removal.number].rule
        return f"consumed by firing {fact.removal.number}, {rule_name(past.program, rule)}"
    if isinstance(fact.removal, EffectCause) and (action := mind.actions.get(fact.removal.action)) is not None:
        text = item_text(past.program, action.predicate, action.executor, action.args)
        return f"replaced by the effect of action {text}"
    if isinstance(fact.removal, HeardCause):
        return f"@{fact.removal.source} {'was not heard any more' if fact.removal.lost else 'told that it is gone'}"
    return "no longer sensed"
