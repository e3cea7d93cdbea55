"""The stops of a robot's past in words: what happened, what changed, what the engine chose from and passed over."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from rmr.base.printable import counted
from rmr.base.values import format_value
from rmr.bytecode.program import Atom, Mode, Program, Strategy
from rmr.node.actions.action_log import ActionEnded
from rmr.vm.derive import DerivedKind
from rmr.vm.provenance import (
    ActionRecord,
    Cause,
    DeliveredCause,
    FiringRecord,
    GivenCause,
    GoalRecord,
    HeardCause,
    InsertionRecord,
    JobRecord,
    MissedCause,
    OutsideCause,
    ProvenanceRecord,
    RemovalRecord,
    SendRecord,
    SensedCause,
    StandsCause,
    ToldRecord,
    UndeliveredCause,
)
from rmr.vm.ranks import rank_text
from rmr.vm.urgency import UNURGENT, due_of
from rmr.why.mind_index import MindIndex
from rmr.why.past_items import PastAction
from rmr.why.past_ranks import OpenGoal, PastRanks
from rmr.why.rule_words import conjunct_text, item_text, named, rule_name, seconds_text
from rmr.why.stops import Choice, PastStop, StopKind, Stops, choices, is_hidden, is_sensed, known_text, other_matches
from rmr.why.unsatisfied_rules import preferred

SHOWN_MAX: Final = 20
"""Changes of one stop, and passed-over matches of one rule, that are shown; of the others the number."""

Names = Mapping[int, str]
"""The variables of one rule, by slot."""


def stop_lines(stops: Stops, index: int, names: Sequence[Names]) -> Iterator[str]:
    """Yield the lines of a stop; `names` are the variables of each rule of the first program, where they are known."""
    if index < 0:
        yield "before the first input"
        return
    stop = stops.all[index]
    mind = stops.mind(index)
    if stop.firing is not None:
        yield f"{seconds_text(stop.at)}  firing {stop.firing.number}, {rule_name(mind.program, stop.firing.rule)}"
        first = stops.parts[0].program is mind.program
        yield from _bindings(stop.firing, names[stop.firing.rule] if first and stop.firing.rule < len(names) else {})
        yield from _conditions(mind, stop.firing)
    else:
        yield f"{seconds_text(stop.at)}  {_what(mind, stop)}"
    changes = list(dict.fromkeys(line for record in stop.records for line in _changes(mind, stop, record)))
    changes += [f"job {job} has ended" for job in stop.finished]
    yield from _cut(changes, "changes")


def _bindings(firing: FiringRecord, names: Names) -> Iterator[str]:
    """Yield the values of the rule's variables; those without a name are seen in the conditions."""
    values = [
        f"{name} = {format_value(firing.bindings[slot])}" for slot, name in names.items() if slot < len(firing.bindings)
    ]
    if values:
        yield f"   with {', '.join(values)}"


def _conditions(mind: MindIndex, firing: FiringRecord) -> Iterator[str]:
    """Yield the conditions of the body, with the values that satisfied them."""
    env = named(firing.bindings, {})
    for conjunct in mind.program.rules[firing.rule].body:
        text = conjunct_text(mind.program, conjunct, mind.robot, env)
        consumed = isinstance(conjunct, Atom) and conjunct.mode is Mode.CONSUME
        yield f"   if {text}{' (consumed)' if consumed else ''}"


def _cut(lines: list[str], what: str) -> Iterator[str]:
    for line in lines[:SHOWN_MAX]:
        yield f"   {line}"
    if len(lines) > SHOWN_MAX:
        yield f"   and {len(lines) - SHOWN_MAX} more {what}"


# -- inputs


def _what(mind: MindIndex, stop: PastStop) -> str:
    """Return what happened at a stop that is no firing."""
    if stop.life:
        if mind.begins == stop.at and mind.first_number > 1 and not mind.epoch:
            return "the robot goes on with another program"
        return f"the robot is started again (life {mind.epoch})" if mind.epoch else "the robot is started"
    if stop.action:
        action = mind.actions.get(stop.action)
        if action is None:
            return f"an action that the program before began {_end(stop)}"
        if stop.kind is StopKind.BEGINNING:
            return f"action {_action(mind, action)} begins"
        return f"action {_action(mind, action)} {_end(stop)}"
    assert stop.cause is not None
    return _input(mind, stop.cause)


def _action(mind: MindIndex, action: PastAction) -> str:
    return item_text(mind.program, action.predicate, action.executor, action.args)


def _end(stop: PastStop) -> str:
    """Return how an action ended."""
    for record in stop.records:
        if isinstance(record, ToldRecord) and isinstance(record.event, ActionEnded):
            return "completed" if record.event.failure is None else f"failed: {record.event.failure}"
    news = getattr(stop.cause, "news", None)
    if isinstance(news, DeliveredCause):
        completed = getattr(stop.cause, "ok", True)
        return f"{'completed' if completed else 'failed'}, as @{news.source} tells"
    return "goes on"


def _input(mind: MindIndex, cause: Cause) -> str:
    match cause:
        case GivenCause("robot"):
            return "given: the robot's own number"
        case GivenCause(giver):
            return f"given by the {giver}"
        case SensedCause():
            return "sensed"
        case DeliveredCause(source, _, sequence):
            return f"delivered by @{source} (message {sequence})"
        case HeardCause(source, lost):
            return f"@{source} is not heard any more" if lost else f"told by @{source}, a neighbour"
        case UndeliveredCause(destination, name, _):
            return f"a message {name} to @{destination} is given up"
        case StandsCause(sent):
            return f"@{sent.destination} has acknowledged a decision"
        case MissedCause(job):
            known = mind.jobs[job].job if job in mind.jobs else None
            return "a deadline has passed" + ("" if known is None else f": {known.name} of {known.text}")
        case OutsideCause():
            return "inserted from outside"
        case _:
            raise AssertionError("firings and ends of actions are told elsewhere")


def _changes(mind: MindIndex, stop: PastStop, record: ProvenanceRecord) -> Iterator[str]:
    program = mind.program
    match record:
        case InsertionRecord(_, _, predicate, args, _):
            yield f"+ {item_text(program, predicate, mind.robot, args)}"
        case RemovalRecord(_, serial, _):
            fact = mind.facts[serial]
            yield f"- {item_text(program, fact.predicate, mind.robot, fact.args)}"
        case GoalRecord(_, predicate, args, _):
            yield f"+ {item_text(program, predicate, mind.robot, args, '?')}"
        case ActionRecord(_, _, predicate, executor, args, _, _) if executor == mind.robot:
            yield f"+ action {item_text(program, predicate, executor, args)}"
        case SendRecord(_, role, destination, predicate, args, _):
            mark = "?" if role is DerivedKind.GOAL else ""
            what = "action " if role is DerivedKind.ACTION else ""
            yield f"> to @{destination}: {what}{item_text(program, predicate, destination, args, mark)}"
        case JobRecord(_, job, _) if job in stop.due:
            timed = mind.jobs[job].job
            assert timed is not None
            yield f"job {timed.name} of {timed.text} is due at {seconds_text(stop.due[job])}"
        case _:
            return


# -- what holds


def fact_texts(stops: Stops, index: int) -> tuple[list[str], list[str]]:
    """Return the facts by rules and those that the robot senses at a stop, in program syntax, each sorted."""
    program = stops.mind(index).program
    by_rules: list[str] = []
    sensed: list[str] = []
    for fact in stops.held(index):
        if is_sensed(program, fact.predicate):
            sensed.append(known_text(program, fact.predicate, stops.robot, fact.args))
        elif not is_hidden(program, fact.predicate):
            by_rules.append(known_text(program, fact.predicate, stops.robot, fact.args))
    return sorted(by_rules), sorted(sensed)


def goal_texts(stops: Stops, index: int) -> list[str]:
    """Return the goals that are open at a stop."""
    program = stops.mind(index).program
    return [item_text(program, goal.predicate, stops.robot, goal.args, "?") for goal in stops.open_goals(index)]


# -- what the engine chooses from


def agenda_lines(stops: Stops, index: int) -> Iterator[str]:
    """Yield the satisfied rules in the engine's order, each with the match with which it would fire."""
    firing, inputs, resumes = stops.agenda(index)
    mind = stops.mind(index)
    if firing is None:
        yield "no rule is satisfied"
        return
    if resumes:
        yield "the engine has stopped for this call of the robot, and goes on in a later one:"
    if inputs:
        yield f"the engine chooses after {counted(inputs, 'more input')}:"
    found = choices(firing)
    for place, choice in enumerate(found, 1):
        fires = "  <- fires next" if choice.fires else ""
        yield f"{place}. {rule_name(mind.program, choice.rule)}: {_match(mind, choice.matched)}{_order(choice)}{fires}"
    first = found[0]
    equal = [each for each in found if (each.rank, each.urgency) == (first.rank, first.urgency)]
    if len(equal) > 1:
        textual = mind.program.strategy is Strategy.TEXTUAL
        yield f"the first {len(equal)} are equal: " + (
            "the order of the text decides" if textual else "one of them is drawn by chance"
        )


def _order(choice: Choice) -> str:
    """Return rank and urgency of a choice, as far as it has them."""
    ranked = "" if choice.rank is None else f"  {rank_text(choice.rank)}"
    return ranked + ("" if choice.urgency >= UNURGENT else f"  for a job due at {seconds_text(due_of(choice.urgency))}")


def _match(mind: MindIndex, serials: Sequence[int]) -> str:
    facts = [mind.facts[serial] for serial in serials]
    return ", ".join(item_text(mind.program, fact.predicate, mind.robot, fact.args) for fact in facts) or "always"


def passed_lines(stops: Stops, index: int) -> Iterator[str]:
    """Yield what the engine passed over when it chose the firing of a stop, and why."""
    firing = stops.all[index].firing
    assert firing is not None
    mind = stops.mind(index)
    program = mind.program
    told = False
    for rival in firing.rivals:
        told = True
        yield f"{rule_name(program, rival.rule)}: {_match(mind, rival.matched)}"
        yield f"   passed over: {preferred(program, mind.robot, firing, rival)}"
    matches = other_matches(mind, firing)
    rule = rule_name(program, firing.rule)
    if matches is None:
        yield f"{rule} draws numbers by chance: its other matches are not worked out"
        return
    ranks = _ranks(mind, firing) if firing.goals and matches else None
    for serials in matches[:SHOWN_MAX]:
        yield f"{rule}, another match: {_match(mind, serials)}"
        yield f"   passed over: {_why_other_match(program, firing, ranks, serials)}"
    if len(matches) > SHOWN_MAX:
        yield f"and {len(matches) - SHOWN_MAX} more matches of {rule}"
    if not told and not matches:
        yield "nothing: no other rule was satisfied, and this one by no other facts"


def _ranks(mind: MindIndex, firing: FiringRecord) -> PastRanks:
    place = mind.firing_places[firing.number]
    held = [fact for fact in mind.facts.values() if fact.place < place < fact.removed_place]
    return PastRanks(mind.program, mind.robot, firing.at, held, [OpenGoal(*goal) for goal in firing.goals])


def _why_other_match(program: Program, firing: FiringRecord, ranks: PastRanks | None, serials: tuple[int, ...]) -> str:
    """Return why a match of the rule that fired came after the one that fired."""
    oldest = "the match of the oldest facts goes first"
    if ranks is not None:
        own = ranks.of(firing.rule, serials)
        fired = ranks.of_firing(firing)
        if (own.rank, own.source) != (fired.rank, fired.source):
            return f"{own.text}; that of the one that fired: {fired.text}"
        oldest = (
            "both have the same rank: first goes that whose kept facts fired least recently, then that of the oldest"
        )
    if program.strategy is Strategy.DEADLINE and program.assertions:
        return f"the match for the job that is due first goes first; of equal ones, {oldest}"
    return oldest
