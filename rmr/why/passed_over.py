"""Matches that were satisfied when another match was chosen: their ranks, and why the other one came first.

A rule brings about what is asked for by some of its matches. The newest firing is looked for before which such a match
was satisfied. While goals were open, the ranks of both matches are told, each with how it was found.
"""

from functools import partial
from typing import Final

from rmr.base.time import NEVER, Instant
from rmr.base.values import Robot, Value
from rmr.bytecode.program import Atom, Mode, Program, Strategy
from rmr.vm.provenance import FiringCause, FiringRecord, Rival
from rmr.vm.ranks import rank_text
from rmr.vm.urgency import due_of
from rmr.why.mind_index import MindIndex
from rmr.why.partial_match import PartialMatch, PartialSearch, matched
from rmr.why.past import Past
from rmr.why.past_items import PastFact
from rmr.why.past_ranks import OpenGoal, PastRank, PastRanks, RankSource, way_text
from rmr.why.rule_words import item_text, rule_name, seconds_text
from rmr.why.sources import RuleSource
from rmr.why.why_tree import AbsenceNode

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
