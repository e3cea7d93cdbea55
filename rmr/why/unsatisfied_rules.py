"""How far the robots came with a rule: the satisfied part of its body, and what was missing or in the way.

The longest satisfied part is looked for in the facts that hold at the instant of the question. For each conjunct that
is missing there is a reason: consumed by which firing, blocked by which fact, never there.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, Final, NamedTuple

from rmr.base.time import NEVER, Instant
from rmr.base.values import Robot, Value
from rmr.bytecode.program import ANY, Atom, Bind, Conjunct, Constant, Fold, Guard, Mode, Program, Slot, Strategy
from rmr.vm.evaluate import NoValue, evaluate
from rmr.vm.provenance import FiringCause, FiringRecord, Rival
from rmr.vm.ranks import rank_text
from rmr.vm.urgency import due_of
from rmr.why.explain import Explainer
from rmr.why.mind_index import MindIndex
from rmr.why.partial_match import ConjunctVerdict, PartialMatch, PartialSearch, bound_by, matched
from rmr.why.past import Past
from rmr.why.past_items import PastFact
from rmr.why.past_ranks import OpenGoal, PastRank, PastRanks, RankSource, way_text
from rmr.why.question import Question
from rmr.why.rule_words import (
    Env,
    atom_text,
    conjunct_text,
    item_text,
    named,
    rule_name,
    rule_place_of,
    seconds_text,
)
from rmr.why.sources import RuleSource
from rmr.why.why_answer import removal
from rmr.why.why_tree import AbsenceNode

ROBOTS_SHOWN: Final = 3
"""Robots shown of those that could fire a rule for another one: those that came nearest."""
NEAR_SHOWN: Final = 3
"""Other facts of the predicate, and other robots, that are shown for a missing fact."""


class _Attempt(NamedTuple):
    """How far a robot came with a rule."""

    mind: MindIndex
    source: RuleSource
    match: PartialMatch


class UnsatisfiedRules:
    """Finds the reasons why rules did not bring about what is asked for, as of one instant."""

    def __init__(self, past: Past, now: Instant, follow: Callable[[Question, int, bool], list[AbsenceNode]]) -> None:
        """`follow` returns the reasons why a fact does not hold, or (True) has not come back, down to a depth."""
        self._past = past
        self._program = past.program
        self._now = now
        self._follow = follow
        self._passed_over = PassedOver(past, now)
        self._shown: set[str] = set()
        """Attempts that the answer has explained."""

    def attempts(self, asked: Question, source: RuleSource, depth: int) -> list[AbsenceNode]:
        """Return how far the robots came that could fire the rule for it."""
        home = source.env[0]
        minds = self._past.all_minds(self._now) if home is None else iter(self._one(home))
        attempts = [_Attempt(mind, source, self._match(mind, source)) for mind in minds]
        attempts.sort(key=lambda each: -each.match.satisfied)
        shown = [self._attempt(asked, each, depth) for each in attempts[:ROBOTS_SHOWN]]
        if len(attempts) > ROBOTS_SHOWN:
            shown.append(
                AbsenceNode("note", f"{len(attempts) - ROBOTS_SHOWN} more robots came no nearer with that rule")
            )
        return shown

    def _one(self, robot: Value) -> list[MindIndex]:
        assert isinstance(robot, Robot)
        mind = self._past.mind_at(robot, self._now)
        return [] if mind is None else [mind]

    def _match(self, mind: MindIndex, source: RuleSource) -> PartialMatch:
        env: list[Value | None] = list(source.env)
        env[0] = Robot(mind.robot)
        return PartialSearch(source.body, partial(self._holding, mind), env, self._now).best

    def _holding(self, mind: MindIndex, predicate: int) -> list[PastFact]:
        return mind.held(predicate, self._now)

    def _attempt(self, asked: Question, attempt: _Attempt, depth: int) -> AbsenceNode:
        mind, source, match = attempt
        name = rule_name(self._program, source.rule)
        place = rule_place_of(self._program, source.rule)
        whose = "" if source.here else f" on robot {mind.robot}"
        node = AbsenceNode("rule", "", place=None if place is None else (place.file, place.line, place.column))
        fired = self._last_firing(asked, mind, source)
        if fired is not None:
            when = f"{seconds_text(fired.at)} (firing {fired.number})"
            if not source.here:  # what became of the message is said beside
                node.text = f"{name}{whose} fired for it last {when}"
                return node
            node.children.append(AbsenceNode("note", f"it fired last {when}"))
        passed = self._passed_over.node(mind, source, match, 0 if fired is None else fired.number)
        if match.complete:
            node.text = f"{name}{whose}: its body is satisfied"
            node.children.append(AbsenceNode("note", self._not_fired(mind, source, match)))
            node.children += passed
            return node
        node.text = f"{name}{whose}: {match.satisfied} of {len(match.verdicts)} conditions are satisfied"
        key = f"{mind.robot} {source.rule} {match.env!r}"
        if key in self._shown:
            node.text += "  (shown above)"
            node.children.clear()
            return node
        self._shown.add(key)
        node.children += passed
        words = [
            conjunct_text(self._program, conjunct, mind.robot, self._named(attempt))
            for conjunct, verdict in zip(source.body, match.verdicts, strict=True)
            if verdict.holds
        ]
        if words:
            node.children.append(AbsenceNode("satisfied", f"satisfied: {', '.join(words)}"))
        for conjunct, verdict in zip(source.body, match.verdicts, strict=True):
            if not verdict.holds:
                node.children.append(self._unsatisfied(attempt, conjunct, verdict, depth))
        return node

    def _last_firing(self, asked: Question, mind: MindIndex, source: RuleSource) -> FiringRecord | None:
        for record in reversed(mind.firings.values()):
            if record.rule == source.rule and record.at <= self._now:
                for origin in record.derived:
                    for item in origin.chain:
                        if item.predicate == asked.predicate and asked.matches(int(item.owner), item.args):
                            return record
        return None

    def _not_fired(self, mind: MindIndex, source: RuleSource, match: PartialMatch) -> str:
        """Return why a satisfied rule did not fire, or brought nothing that holds."""
        env: list[Value] = list(match.env)  # type: ignore[arg-type]
        try:
            for code in (source.item.owner, *source.item.args):
                evaluate(code, env, self._now)
        except NoValue as reason:
            return f"its head has no value: {reason}"
        serials = tuple([verdict.fact.serial for verdict in match.verdicts[: source.outer] if verdict.fact is not None])
        for record in reversed(mind.firings.values()):
            if record.rule == source.rule and record.matched == serials and record.at <= self._now:
                when = seconds_text(record.at)
                return (
                    f"it has fired for these very facts, {when} (firing {record.number}), and fires once for each match"
                )
        last = next((each for each in reversed(mind.firings.values()) if each.at <= self._now), None)
        if last is None:
            return f"it has not fired by {seconds_text(self._now)}"
        rank = "" if last.rank is None else f", which leads to a goal ({rank_text(last.rank)})"
        other = rule_name(self._program, last.rule)
        return f"it has not fired by {seconds_text(self._now)}; the last firing was {last.number}, {other}{rank}"

    # -- conjuncts ----------------------------------------------------------------------------------------------------

    def _unsatisfied(self, attempt: _Attempt, conjunct: Conjunct, verdict: ConjunctVerdict, depth: int) -> AbsenceNode:
        mind = attempt.mind
        text = conjunct_text(self._program, conjunct, mind.robot, self._named(attempt))
        if verdict.holds is None:
            return AbsenceNode("undecided", f"not decided: {text}")
        if isinstance(conjunct, Guard | Bind | Fold):
            why = f" (no value: {verdict.reason})" if verdict.reason else ""
            return AbsenceNode("false", f"false: {text}{why}")
        if conjunct.mode is Mode.ABSENT:
            assert verdict.fact is not None
            blocking = self._words(mind, verdict.fact)
            because = Explainer(self._past, mind.robot).because(mind, verdict.fact).words
            since = seconds_text(verdict.fact.at)
            return AbsenceNode("blocked", f"in the way: {blocking} holds since {since}, {because}")
        return self._missing(attempt, conjunct, depth)

    def _named(self, attempt: _Attempt) -> Env:
        """Return the values of the rule's variables, with the names of those that have none."""
        return named(attempt.match.env, self._past.variables(attempt.source.rule))

    def _missing(self, attempt: _Attempt, atom: Atom, depth: int) -> AbsenceNode:
        """Return why no fact matches an atom."""
        mind, source, match = attempt
        text = atom_text(self._program, atom, mind.robot, self._named(attempt))
        env = list(match.env)
        past = [f for f in mind.by_predicate[atom.predicate] if f.at <= self._now and matched(atom, f, env) is not None]
        if any(fact.held_at(self._now) for fact in past):
            return AbsenceNode("missing", f"missing: {text}: another condition needs the only such fact")
        args = tuple([_pattern(each, match.env) for each in atom.args])
        asked = Question(atom.predicate, False, False, mind.robot, args)
        if past:
            words, rival = self._gone(mind, source, past[-1])
            node = AbsenceNode("missing", f"missing: {text}{words}")
            if depth > 0 and not rival:
                node.children += self._follow(asked, depth - 1, True)
            return node
        node = AbsenceNode("missing", f"missing: {text} never held{self._instead(mind, atom)}")
        elsewhere = self._elsewhere(mind, atom, env)
        if elsewhere:
            node.children.append(AbsenceNode("note", elsewhere))
        if depth > 0:
            node.children += self._follow(asked, depth - 1, False)
        return node

    def _gone(self, mind: MindIndex, source: RuleSource, fact: PastFact) -> tuple[str, bool]:
        """Return what has removed a fact, and whether that was a rule which came before this one."""
        words = (
            f" held from {seconds_text(fact.at)} until {seconds_text(fact.until)}: {removal(self._past, mind, fact)}"
        )
        if not isinstance(fact.removal, FiringCause):
            return words, False
        record = mind.firings[fact.removal.number]
        if record.rule == source.rule:
            return words + ", this rule", False
        for rival in record.rivals:
            if rival.rule == source.rule:
                why = preferred(self._program, mind.robot, record, rival)
                return f"{words}; this rule was satisfied then, too: {why}", True
        return words, False

    def _instead(self, mind: MindIndex, atom: Atom) -> str:
        held = mind.held(atom.predicate, self._now)[-NEAR_SHOWN:]
        return f"; there is {', '.join(self._words(mind, fact) for fact in held)}" if held else ""

    def _elsewhere(self, mind: MindIndex, atom: Atom, env: list[Value | None]) -> str:
        """Return which other robots hold the fact; rules read those of their own robot alone."""
        if self._program.predicates[atom.predicate].provided:
            return ""
        holders = []
        # Twelve robots at most, for each has to be replayed first.
        for robot in self._past.near(12):
            other = self._past.mind_at(robot, self._now)
            if other is not None and robot != mind.robot:
                held = other.held(atom.predicate, self._now)
                if any(bound_by(atom.args, fact.args, env) is not None for fact in held):
                    holders.append(robot)
        if not holders:
            return ""
        robots = ", ".join(f"@{robot}" for robot in holders[:NEAR_SHOWN])
        more = "" if len(holders) <= NEAR_SHOWN else f" and {len(holders) - NEAR_SHOWN} more"
        return f"{robots}{more} holds such a fact: a rule reads only the facts of its own robot"

    def _words(self, mind: MindIndex, fact: PastFact) -> str:
        return item_text(self._program, fact.predicate, mind.robot, fact.args)


def _pattern(pattern: object, env: tuple[Value | None, ...]) -> Any:
    """Return a pattern of a body with the values that are known; what is unknown matches anything."""
    if isinstance(pattern, Slot):
        value = env[pattern.index]
        return ANY if value is None else Constant(value)
    return pattern


# ---- matches that were satisfied when another match was chosen: their ranks, and why the other one came first
#
# A rule brings about what is asked for by some of its matches. The newest firing is looked for before which such a
# match was satisfied. While goals were open, the ranks of both matches are told, each with how it was found.

FIRINGS_MAX: Final = 50
"""Firings before which a match of a rule is looked for, the newest ones that took or brought a fact of its body."""


class PassedOver:
    """Finds satisfied matches that were not chosen, up to one instant."""

    def __init__(self, past: Past, now: Instant) -> None:
        self._past = past
        self._program = past.program
        self._now = now
        self._moments: dict[tuple[int, int, int], PastRanks] = {}

    def node(self, mind: MindIndex, source: RuleSource, match: PartialMatch, since: int) -> list[AbsenceNode]:
        """Return what came before a match of a rule, in a firing after number `since`; empty if there is no such.

        `match` is the best match at the instant of the question.
        """
        for number in self._firings(mind, source, match):
            record = mind.firings[number]
            if number <= since or not record.goals:
                continue
            env: list[Value | None] = list(source.env)
            env[0] = Robot(mind.robot)
            held = partial(mind.held_before, firing=number)
            found = PartialSearch(source.body, held, env, record.at).best
            taken = _outer(source, found)
            if found.complete and not (record.rule == source.rule and record.matched == _serials(taken)):
                return [self._told(mind, source, taken, record)]
        return []

    def _firings(self, mind: MindIndex, source: RuleSource, match: PartialMatch) -> list[int]:
        """Return the numbers of the firings that may have come before a match of the rule, the newest first."""
        if match.complete:
            newest = max((fact.place for fact in _outer(source, match)), default=0)
            later = [number for number, place in mind.firing_places.items() if place > newest]
            return [number for number in reversed(later) if mind.firings[number].at <= self._now][:FIRINGS_MAX]
        numbers: dict[int, None] = {}
        env = list(source.env)
        for conjunct in source.body:
            if not isinstance(conjunct, Atom):
                continue
            facts = [f for f in mind.by_predicate[conjunct.predicate] if matched(conjunct, f, env) is not None]
            for fact in facts:
                cause = fact.cause if conjunct.mode is Mode.ABSENT else fact.removal
                if isinstance(cause, FiringCause) and mind.firings[cause.number].at <= self._now:
                    numbers[cause.number] = None
        return sorted(numbers, reverse=True)[:FIRINGS_MAX]

    def _told(self, mind: MindIndex, source: RuleSource, taken: list[PastFact], record: FiringRecord) -> AbsenceNode:
        """Return the ranks of a match and of the firing that came before it."""
        ranks = self._moment(mind, record)
        own = ranks.of(source.rule, _serials(taken))
        first = ranks.of_firing(record)
        chosen = [mind.facts[serial] for serial in record.matched]
        other = f"firing {record.number}, {rule_name(self._program, record.rule)}"
        node = AbsenceNode("passed over", f"it was satisfied at {seconds_text(record.at)}, and {other}, came first")
        node.children.append(self._match("this match", mind, taken, own))
        node.children.append(self._match("the match that fired", mind, chosen, first))
        if own.rank == first.rank and own.source is first.source:
            node.children.append(AbsenceNode("note", self._tie(mind, source, record)))
        return node

    def _moment(self, mind: MindIndex, record: FiringRecord) -> PastRanks:
        key = mind.robot, mind.epoch, record.number
        if key not in self._moments:
            place = mind.firing_places[record.number]
            held = [fact for fact in mind.facts.values() if fact.place < place < fact.removed_place]
            goals = [OpenGoal(*goal) for goal in record.goals]
            self._moments[key] = PastRanks(self._program, mind.robot, record.at, held, goals)
        return self._moments[key]

    def _match(self, whose: str, mind: MindIndex, facts: list[PastFact], rank: PastRank) -> AbsenceNode:
        texts = [item_text(self._program, fact.predicate, mind.robot, fact.args) for fact in facts]
        of = f" of {', '.join(texts)}" if texts else ""
        node = AbsenceNode("match", f"{whose}{of}: {rank.text}", rank=rank)
        if rank.source is RankSource.FACTS and rank.way:
            node.children.append(AbsenceNode("way", f"then {way_text(self._program, mind.robot, rank.way)}"))
        return node

    def _tie(self, mind: MindIndex, source: RuleSource, record: FiringRecord) -> str:
        """Return why a firing came before a match of the same rank."""
        if record.rule != source.rule:
            rivals = [rival for rival in record.rivals if rival.rule == source.rule]
            words = [preferred(self._program, mind.robot, record, rival) for rival in rivals]
            return f"both have the same rank: {words[0]}" if words else "both have the same rank"
        return (
            "both are matches of one rule with the same rank: first goes the one for whose kept facts the rule "
            "has fired least recently, then the one with the oldest facts"
        )


def preferred(program: Program, robot: int, record: FiringRecord, rival: Rival) -> str:
    """Return why a firing came before a rule that was satisfied as well."""
    rank = rival.rank
    if record.rank == rank and record.urgency != rival.urgency:
        return _more_urgent(record.urgency, rival.urgency)
    if record.rank == rank:
        textual = program.strategy is Strategy.TEXTUAL
        return "the other one stands before it (order textual)" if textual else "the other one was drawn by chance"
    goal = ", ".join(item_text(program, predicate, robot, args) for predicate, args in record.goals)
    here = "no open goal follows from this one" if rank is None else f"this one has {rank_text(rank)}"
    return f"the other one leads to an open goal ({goal}; {rank_text(record.rank)}), {here}"


def _more_urgent(first: int, second: int) -> str:
    """Return why one firing came before another one of the same rank (``order deadline``)."""
    due, other = due_of(first), due_of(second)
    if due == other:
        return f"both serve jobs due at {seconds_text(due)}, and the other one is nearer to the end of its job"
    here = "this one serves no job" if other == NEVER else f"that of this one is due at {seconds_text(other)}"
    return f"the job that the other one serves is due at {seconds_text(due)}, {here} (order deadline)"


def _outer(source: RuleSource, match: PartialMatch) -> list[PastFact]:
    """Return the facts that the rule's own body has taken, in its order."""
    body = zip(source.body[: source.outer], match.verdicts[: source.outer], strict=True)
    return [verdict.fact for conjunct, verdict in body if verdict.fact is not None and _takes(conjunct)]


def _takes(conjunct: object) -> bool:
    return isinstance(conjunct, Atom) and conjunct.mode is not Mode.ABSENT


def _serials(facts: list[PastFact]) -> tuple[int, ...]:
    return tuple([fact.serial for fact in facts])
