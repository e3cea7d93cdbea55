"""Why not: what could have brought about a fact that does not hold, and what was missing or in the way.

Every source of the fact is followed: messages on their way, actions whose declared effect it is, rules whose head it
fits, sensors. Of a rule the longest satisfied part of its body is looked for in the facts that hold at the instant of
the question, and for each conjunct that is missing the reason: consumed by which firing, blocked by which fact, never
there. What was never there is followed in the same way, down to a depth (negative provenance, Wu et al., Y!, SIGCOMM
2014).
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final, NamedTuple

from rmr.base.time import NEVER, Instant, in_seconds
from rmr.base.values import Robot, Value
from rmr.bytecode.program import ANY, Atom, Bind, Conjunct, Constant, Guard, Kind, Mode, Slot
from rmr.vm.derive import DerivedKind
from rmr.vm.evaluate import NoValue, evaluate
from rmr.vm.provenance import DeliveredCause, FiringCause, FiringRecord
from rmr.why.explain import DEPTH, SENSES, Explainer, stages
from rmr.why.mind_index import MindIndex, PastAction, PastFact, PastSend
from rmr.why.partial_match import PartialMatch, PartialSearch, Verdict, bound_by, matched
from rmr.why.past import Past
from rmr.why.question import Question
from rmr.why.rule_words import atom_text, conjunct_text, item_text, rule_name, rule_place_of, seconds_text
from rmr.why.sources import EffectSource, RuleSource, effect_sources, may_be_sent, rule_sources
from rmr.why.why_answer import goal_agrees, removal

ROBOTS_SHOWN: Final = 3
"""Robots shown of those that could fire a rule for another one: those that came nearest."""
NEAR_SHOWN: Final = 3
"""Other facts of the predicate that are shown for a missing one."""


@dataclass(slots=True)
class AbsenceNode:
    """A reason, and the reasons for it."""

    kind: str
    """``absent``, ``held``, ``rule``, ``satisfied``, ``missing``, ``blocked``, ``false``, ``undecided``, ``action``,
    ``message``, ``sensor``, ``step`` or ``note``."""
    text: str
    children: list["AbsenceNode"] = field(default_factory=list)
    place: tuple[str, int, int] | None = None
    """Of a rule: file, line, column."""

    def as_data(self) -> dict[str, Any]:
        """Return the tree for JSON."""
        where = None if self.place is None else dict(zip(("file", "line", "column"), self.place, strict=True))
        return {"kind": self.kind, "text": self.text, "place": where, "children": [c.as_data() for c in self.children]}


@dataclass(slots=True)
class AbsenceAnswer:
    """The answer to a question why not."""

    question: str
    at: Instant
    known_until: Instant
    trees: list[AbsenceNode]
    notes: list[str]

    def as_data(self) -> dict[str, Any]:
        """Return the answer for JSON."""
        return {
            "question": self.question,
            "at_s": in_seconds(self.at),
            "known_until_s": in_seconds(self.known_until),
            "absent": [tree.as_data() for tree in self.trees],
            "notes": self.notes,
        }


def why_not(past: Past, asked: Question, at: Instant | None = None, depth: int = DEPTH) -> AbsenceAnswer:
    """Return why what is `asked` does not hold at `at` (None: the end of what is known)."""
    until = past.known_until if at is None else min(at, past.known_until)
    answer = AbsenceAnswer(asked.text(past.program), until, past.known_until, [], [])
    if at is not None and at > past.known_until:
        answer.notes.append(f"the run is known until {seconds_text(past.known_until)}")
    finder = AbsenceFinder(past, until)
    for robot in past.robots if asked.owner is None else [asked.owner]:
        answer.trees.append(finder.absent(asked.of(robot), depth))
    return answer


class _Attempt(NamedTuple):
    """How far a robot came with a rule."""

    mind: MindIndex
    source: RuleSource
    match: PartialMatch


class AbsenceFinder:
    """Finds the reasons for one answer."""

    def __init__(self, past: Past, now: Instant) -> None:
        self._past = past
        self._program = past.program
        self._now = now
        self._seen: set[str] = set()

    # -- one fact -----------------------------------------------------------------------------------------------------

    def absent(self, asked: Question, depth: int) -> AbsenceNode:
        """Return why the fact, goal or action of one robot does not hold."""
        assert asked.owner is not None
        text = asked.text(self._program)
        mind = self._past.mind_at(asked.owner, self._now)
        if mind is None:
            return AbsenceNode("note", f"{text}: nothing of robot {asked.owner} was recorded")
        node = self._history(asked, mind, text)
        if node.kind == "held" or text in self._seen:
            return node
        self._seen.add(text)
        node.children += self._causes(asked, depth)
        if not node.children:
            node.children.append(AbsenceNode("note", self._no_source(asked)))
        return node

    def _history(self, asked: Question, mind: MindIndex, text: str) -> AbsenceNode:
        """Return whether and until when it held."""
        when = seconds_text(self._now)
        if asked.goal:
            return self._goal(asked, mind, text)
        if asked.action:
            return self._derived_action(asked, mind, text)
        past = [each for each in self._facts(mind, asked) if each.at <= self._now]
        holding = [each for each in past if each.held_at(self._now)]
        if holding:
            words = self._words(mind, holding[-1])
            return AbsenceNode("held", f"{words} holds since {seconds_text(holding[-1].at)}; ask without --not")
        if not past:
            return AbsenceNode("absent", f"{text} does not hold at {when}: it never did")
        last = past[-1]
        until = f"from {seconds_text(last.at)} until {seconds_text(last.until)}"
        node = AbsenceNode("absent", f"{text} does not hold at {when}")
        node.children.append(
            AbsenceNode("missing", f"{self._words(mind, last)} held {until}: {removal(self._past, mind, last)}")
        )
        return node

    def _goal(self, asked: Question, mind: MindIndex, text: str) -> AbsenceNode:
        goals = [each for each in mind.goals if each.predicate == asked.predicate and each.at <= self._now]
        for goal in reversed(goals):
            if goal_agrees(asked, goal):
                if goal.achieved is not None and goal.achieved <= self._now:
                    words = f"{text} is not open: it was achieved {seconds_text(goal.achieved)}"
                    return AbsenceNode("held", words)
                return AbsenceNode("held", f"{text} is open since {seconds_text(goal.at)}; ask without --not")
        return AbsenceNode("absent", f"{text} was never opened up to {seconds_text(self._now)}")

    def _derived_action(self, asked: Question, mind: MindIndex, text: str) -> AbsenceNode:
        for action in reversed(self._actions(mind, asked)):
            words = f"{item_text(self._program, action.predicate, action.executor, action.args)} was derived"
            return AbsenceNode("held", f"{words} {seconds_text(action.at)}; {self._stages(action)}")
        return AbsenceNode("absent", f"{text} was never derived up to {seconds_text(self._now)}")

    def _causes(self, asked: Question, depth: int) -> list[AbsenceNode]:
        """Return what could have brought it about, each with what was in the way."""
        found = [] if not may_be_sent(self._program, asked) else list(self._messages(asked))
        found += self._steps(asked)
        for source in effect_sources(self._program, asked):
            found += self._by_action(source, depth)
        for rule in rule_sources(self._program, asked):
            found += self._by_rule(asked, rule, depth)
        predicate = self._program.predicates[asked.predicate]
        if predicate.kind is Kind.SENSED:
            found.append(AbsenceNode("sensor", self._sensor(asked)))
        return found

    def _sensor(self, asked: Question) -> str:
        predicate = self._program.predicates[asked.predicate]
        words = SENSES.get(predicate.name, "sensed") if predicate.provided else "sensed"
        assert asked.owner is not None
        mind = self._past.mind_at(asked.owner, self._now)
        held = [] if mind is None else mind.held(asked.predicate, self._now)
        here = ", ".join(self._words(mind, fact) for fact in held[-NEAR_SHOWN:]) if mind else ""
        return f"it is {words.removeprefix('it is ')}, which has not stated it" + (
            f"; it states {here}" if here else ""
        )

    def _no_source(self, asked: Question) -> str:
        stated = [each for each in self._program.facts if each.predicate == asked.predicate]
        if stated and not asked.goal:
            texts = [item_text(self._program, each.predicate, each.owner, each.args) for each in stated[:NEAR_SHOWN]]
            return f"no rule and no effect of an action derives it; the program states {', '.join(texts)}"
        return (
            "no rule, no effect of an action and no sensor brings it about: it can only be given or come from outside"
        )

    # -- messages, steps and actions ----------------------------------------------------------------------------------

    def _messages(self, asked: Question) -> Iterator[AbsenceNode]:
        """Yield the messages that would bring it and have not arrived."""
        wanted = DerivedKind.ACTION if asked.action else DerivedKind.GOAL if asked.goal else DerivedKind.FACT
        assert asked.owner is not None
        receiver = self._past.mind_at(asked.owner, self._now)
        for sender in self._past.all_minds(self._now):
            for send in sender.sends:
                fits = send.role is wanted and send.destination == asked.owner and send.predicate == asked.predicate
                if not fits or send.at > self._now or not asked.matches(send.destination, send.args):
                    continue
                cause = DeliveredCause(sender.robot, send.epoch, -1 if send.sequence is None else send.sequence)
                if receiver is not None and receiver.arrived.get(cause, NEVER) <= self._now:
                    continue
                yield AbsenceNode("message", self._fate(sender, send))

    def _fate(self, sender: MindIndex, send: PastSend) -> str:
        what = item_text(self._program, send.predicate, send.destination, send.args)
        text = f"{what} was sent by @{sender.robot} {seconds_text(send.at)}"
        if isinstance(send.cause, FiringCause):
            text += f" ({rule_name(self._program, sender.firings[send.cause.number].rule)})"
        repeats = len([at for at in send.repeated if at <= self._now])
        again = "" if not repeats else f", repeated {repeats} time{'s' if repeats != 1 else ''}"
        if send.given_up is not None and send.given_up <= self._now:
            return f"{text}{again} and given up {seconds_text(send.given_up)}: {send.why}"
        return f"{text}{again} and has not arrived at @{send.destination} by {seconds_text(self._now)}"

    def _steps(self, asked: Question) -> Iterator[AbsenceNode]:
        """Yield the actions behind which it waits as a later step."""
        for mind in self._minds_for(asked):
            for action in mind.actions.values():
                waits = [
                    step
                    for step in action.then
                    if step.predicate == asked.predicate and asked.matches(int(step.owner), step.args)
                ]
                if not waits or action.at > self._now:
                    continue
                done = action.ended is not None and action.ended <= self._now
                if done and action.failure is None:
                    continue
                text = item_text(self._program, action.predicate, action.executor, action.args)
                words = "was dropped with the steps after" if done else "is a step that waits for the end of"
                yield AbsenceNode("step", f"it {words} action {text}: {self._stages(action)}")

    def _minds_for(self, asked: Question) -> list[MindIndex]:
        """Return the minds that may derive it: all where it may be sent."""
        if may_be_sent(self._program, asked):
            return list(self._past.all_minds(self._now))
        assert asked.owner is not None
        mind = self._past.mind_at(asked.owner, self._now)
        return [] if mind is None else [mind]

    def _by_action(self, source: EffectSource, depth: int) -> Iterator[AbsenceNode]:
        """Yield how far the actions came whose effect it is."""
        executors = list(self._past.robots) if source.executor is None else [source.executor]
        wanted = Question(source.action, False, True, source.executor, source.args)
        effect = "effect" if source.ok else "`else` effect"
        any_derived = False
        for robot in executors:
            mind = self._past.mind_at(robot, self._now)
            if mind is None:
                continue
            for action in self._actions(mind, wanted.of(robot))[-ROBOTS_SHOWN:]:
                any_derived = True
                text = item_text(self._program, action.predicate, action.executor, action.args)
                yield AbsenceNode("action", f"it is the {effect} of action {text}: {self._stages(action)}")
        if not any_derived and source.ok:
            text = item_text(self._program, source.action, source.executor, source.args)
            node = AbsenceNode("action", f"it is the effect of action {text}, which was never derived")
            if depth > 0 and source.executor is not None:
                node.children = self.absent(wanted, depth - 1).children
            yield node

    def _actions(self, mind: MindIndex, wanted: Question) -> list[PastAction]:
        return [
            action
            for action in mind.actions.values()
            if action.predicate == wanted.predicate
            and action.at <= self._now
            and action.executor == mind.robot
            and wanted.matches(action.executor, action.args)
        ]

    def _stages(self, action: PastAction) -> str:
        """Return how far an action had come, as of the instant of the question."""
        held = action.held is not None and action.held <= self._now
        begun = action.begun is not None and action.begun <= self._now
        if action.ended is not None and action.ended <= self._now:
            return stages(action)
        if begun:
            return f"began {seconds_text(action.begun or 0)} and is under way"
        if held:
            return f"waits for its turn of {action.group} since {seconds_text(action.held or 0)}"
        return f"waits for the wheels since {seconds_text(action.at)}"

    # -- rules --------------------------------------------------------------------------------------------------------

    def _by_rule(self, asked: Question, source: RuleSource, depth: int) -> list[AbsenceNode]:
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
        whose = "" if mind.robot == asked.owner else f" on robot {mind.robot}"
        node = AbsenceNode("rule", "", place=None if place is None else (place.file, place.line, place.column))
        fired = self._last_firing(asked, mind, source)
        if fired is not None:
            node.children.append(AbsenceNode("note", f"it fired last {seconds_text(fired.at)} (firing {fired.number})"))
        if match.complete:
            node.text = f"{name}{whose}: its body is satisfied"
            node.children.append(AbsenceNode("note", self._not_fired(mind, source, match)))
            return node
        node.text = f"{name}{whose}: {match.satisfied} of {len(match.verdicts)} conditions are satisfied"
        words = [
            conjunct_text(self._program, conjunct, mind.robot, match.env)
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
        rank = "" if last.rank is None else f", which leads to a goal (rank {last.rank})"
        other = rule_name(self._program, last.rule)
        return f"it has not fired by {seconds_text(self._now)}; the last firing was {last.number}, {other}{rank}"

    # -- conjuncts ----------------------------------------------------------------------------------------------------

    def _unsatisfied(self, attempt: _Attempt, conjunct: Conjunct, verdict: Verdict, depth: int) -> AbsenceNode:
        mind, _, match = attempt
        text = conjunct_text(self._program, conjunct, mind.robot, match.env)
        if verdict.holds is None:
            return AbsenceNode("undecided", f"not decided: {text}")
        if isinstance(conjunct, Guard | Bind):
            why = f" (no value: {verdict.reason})" if verdict.reason else ""
            return AbsenceNode("false", f"false: {text}{why}")
        if conjunct.mode is Mode.ABSENT:
            assert verdict.fact is not None
            blocking = self._words(mind, verdict.fact)
            because = Explainer(self._past, mind.robot).because(mind, verdict.fact).words
            since = seconds_text(verdict.fact.at)
            return AbsenceNode("blocked", f"in the way: {blocking} holds since {since}, {because}")
        return self._missing(attempt, conjunct, depth)

    def _missing(self, attempt: _Attempt, atom: Atom, depth: int) -> AbsenceNode:
        """Return why no fact matches an atom."""
        mind, source, match = attempt
        text = atom_text(self._program, atom, mind.robot, match.env)
        env = list(match.env)
        past = [f for f in mind.by_predicate[atom.predicate] if f.at <= self._now and matched(atom, f, env) is not None]
        if any(fact.held_at(self._now) for fact in past):
            return AbsenceNode("missing", f"missing: {text}: another condition needs the only such fact")
        if past:
            return AbsenceNode("missing", f"missing: {text}{self._gone(mind, source, past[-1])}")
        node = AbsenceNode("missing", f"missing: {text} never held{self._instead(mind, atom)}")
        elsewhere = self._elsewhere(mind, atom, env)
        if elsewhere:
            node.children.append(AbsenceNode("note", elsewhere))
        if depth > 0:
            args = tuple([_pattern(each, match.env) for each in atom.args])
            asked = Question(atom.predicate, False, False, mind.robot, args)
            node.children += (
                self.absent(asked, depth - 1).children if asked.text(self._program) not in self._seen else []
            )
        return node

    def _gone(self, mind: MindIndex, source: RuleSource, fact: PastFact) -> str:
        """Return what has removed a fact, and why that came before the rule."""
        words = (
            f" held from {seconds_text(fact.at)} until {seconds_text(fact.until)}: {removal(self._past, mind, fact)}"
        )
        if not isinstance(fact.removal, FiringCause):
            return words
        record = mind.firings[fact.removal.number]
        if record.rule == source.rule:
            return words + ", this rule"
        for rival in record.rivals:
            if rival.rule == source.rule:
                return f"{words}; this rule was satisfied then, too: {self._preferred(record, rival.rank)}"
        return words

    def _preferred(self, record: FiringRecord, rank: int | None) -> str:
        """Return why a firing came before a rule that was satisfied as well, with `rank`."""
        if record.rank == rank:
            textual = self._program.strategy.name == "TEXTUAL"
            return "the other one stands before it (order textual)" if textual else "the other one was drawn by chance"
        goal = ", ".join(item_text(self._program, predicate, None, args) for predicate, args in record.goals)
        here = "no open goal follows from this one" if rank is None else f"this one has rank {rank}"
        return f"the other one leads to an open goal ({goal}; rank {record.rank}), {here}"

    def _instead(self, mind: MindIndex, atom: Atom) -> str:
        held = mind.held(atom.predicate, self._now)[-NEAR_SHOWN:]
        return f"; there is {', '.join(self._words(mind, fact) for fact in held)}" if held else ""

    def _elsewhere(self, mind: MindIndex, atom: Atom, env: list[Value | None]) -> str:
        """Return which other robots hold the fact; rules read those of their own robot alone."""
        if self._program.predicates[atom.predicate].provided:
            return ""
        holders = []
        for other in self._past.all_minds(self._now):
            if other.robot != mind.robot:
                held = other.held(atom.predicate, self._now)
                if any(bound_by(atom.args, fact.args, env) is not None for fact in held):
                    holders.append(other.robot)
        if not holders:
            return ""
        robots = ", ".join(f"@{robot}" for robot in holders[:NEAR_SHOWN])
        more = "" if len(holders) <= NEAR_SHOWN else f" and {len(holders) - NEAR_SHOWN} more"
        return f"{robots}{more} holds such a fact: a rule reads only the facts of its own robot"

    # -- words --------------------------------------------------------------------------------------------------------

    def _facts(self, mind: MindIndex, asked: Question) -> list[PastFact]:
        return [fact for fact in mind.by_predicate[asked.predicate] if asked.matches(mind.robot, fact.args)]

    def _words(self, mind: MindIndex, fact: PastFact) -> str:
        return item_text(self._program, fact.predicate, mind.robot, fact.args)


def _pattern(pattern: object, env: tuple[Value | None, ...]) -> Any:
    """Return a pattern of a body with the values that are known; what is unknown matches anything."""
    if isinstance(pattern, Slot):
        value = env[pattern.index]
        return ANY if value is None else Constant(value)
    return pattern
