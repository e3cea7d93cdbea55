"""Why not: what could have brought about a fact that does not hold, and what was missing or in the way.

Every source of the fact is followed: messages on their way, actions whose declared effect it is, rules whose head it
fits, sensors. Of a rule the longest satisfied part of its body is looked for in the facts that hold at the instant of
the question, and for each conjunct that is missing the reason: consumed by which firing, blocked by which fact, never
there. What was never there is followed in the same way, down to a depth (negative provenance, Wu et al., Y!, SIGCOMM
2014).
"""

from collections.abc import Iterator
from typing import Final

from rmr.base.printable import counted
from rmr.base.time import Instant
from rmr.bytecode.program import ANY, Duty, Kind
from rmr.vm.derive import DerivedKind
from rmr.vm.provenance import DeliveredCause, FiringCause
from rmr.why.explain import DEPTH, SENSES, stages, withdrawn_text
from rmr.why.mind_index import MindIndex
from rmr.why.past import Past
from rmr.why.past_items import PastAction, PastFact, PastSend
from rmr.why.question import Question
from rmr.why.rule_words import item_text, rule_name, seconds_text
from rmr.why.sources import EffectSource, effect_sources, may_be_sent, rule_sources, violation_sources
from rmr.why.unsatisfied_rules import NEAR_SHOWN, UnsatisfiedRules
from rmr.why.why_answer import ANSWERS_MAX, goal_agrees, removal
from rmr.why.why_tree import AbsenceAnswer, AbsenceNode

ACTIONS_SHOWN: Final = 3
"""Actions shown of one robot, the newest ones."""


def why_not(past: Past, asked: Question, at: Instant | None = None, depth: int = DEPTH) -> AbsenceAnswer:
    """Return why what is `asked` does not hold at `at` (None: the end of what is known)."""
    until = past.known_until if at is None else min(at, past.known_until)
    answer = AbsenceAnswer(asked.text(past.program), until, past.known_until)
    if at is not None and at > past.known_until:
        answer.notes.append(f"the run is known until {seconds_text(past.known_until)}")
    finder = AbsenceFinder(past, until)
    robots = list(past.robots) if asked.owner is None else [asked.owner]
    for robot in robots[:ANSWERS_MAX]:
        answer.trees.append(finder.absent(asked.of(robot), depth))
    if len(robots) > ANSWERS_MAX:
        answer.notes.append(f"{len(robots) - ANSWERS_MAX} more robots are not shown: name the robot")
    return answer


class AbsenceFinder:
    """Finds the reasons for one answer."""

    def __init__(self, past: Past, now: Instant) -> None:
        self._past = past
        self._program = past.program
        self._now = now
        self._seen: set[str] = set()
        self._rules = UnsatisfiedRules(past, now, self.reasons)

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

    def reasons(self, asked: Question, depth: int, again: bool = False) -> list[AbsenceNode]:
        """Return why a fact does not hold, unless the answer says so already; `again`: why it has not come back."""
        text = asked.text(self._program)
        if text in self._seen:
            return []
        if not again:
            return self.absent(asked, depth).children
        self._seen.add(text)
        return self._causes(asked, depth)

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
        node = AbsenceNode("absent", f"{text} does not hold at {when}" + (": it never did" if not past else ""))
        for last in past[-1:]:
            until = f"from {seconds_text(last.at)} until {seconds_text(last.until)}"
            words = f"{self._words(mind, last)} held {until}: {removal(self._past, mind, last)}"
            node.children.append(AbsenceNode("missing", words))
        best = self._program.predicates[asked.predicate].best
        if best is not None:
            asked = asked._replace(args=(*asked.args[: best.argument], *[ANY] * (len(asked.args) - best.argument)))
            kept = [each for each in mind.held(asked.predicate, self._now) if asked.matches(mind.robot, each.args)]
            words = "in its place: " + ", ".join(self._words(mind, each) for each in kept[-NEAR_SHOWN:])
            node.children += [AbsenceNode("note", words)] if kept else []
        return node

    def _goal(self, asked: Question, mind: MindIndex, text: str) -> AbsenceNode:
        goals = [each for each in mind.goals if each.predicate == asked.predicate and each.at <= self._now]
        for goal in reversed(goals):
            if goal_agrees(asked, goal):
                if goal.achieved is not None and goal.achieved <= self._now:
                    words = f"{text} is not open: it was achieved {seconds_text(goal.achieved)}"
                    return AbsenceNode("held", words)
                if goal.withdrawn is not None and goal.withdrawn <= self._now:
                    how = withdrawn_text(self._program, mind.robot, goal)
                    return AbsenceNode("held", f"{text} is not open: it {'has' if goal.served else 'was'} {how}")
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
        for assertion in violation_sources(self._program, asked):
            words = f"it is the violation of {assertion.name}: no such job has missed its deadline"
            found.append(AbsenceNode("deadline", words))
        for rule in rule_sources(self._program, asked):
            found += self._rules.attempts(asked, rule, depth)
        predicate = self._program.predicates[asked.predicate]
        if predicate.kind is Kind.SENSED:
            found.append(AbsenceNode("sensor", self._sensor(asked)))
        return found

    def _sensor(self, asked: Question) -> str:
        predicate = self._program.predicates[asked.predicate]
        words = SENSES.get(predicate.name, "sensed") if predicate.provided else "sensed"
        if any(each.predicate == asked.predicate and each.duty is Duty.HEARD for each in self._program.ensemble):
            words = "told by the neighbour"
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
                cause = None if send.key is None else DeliveredCause(sender.robot, *send.key[1:])
                arrival = None if receiver is None or cause is None else receiver.arrived.get(cause)
                if arrival is not None and arrival.at <= self._now:
                    continue
                yield AbsenceNode("message", self._fate(sender, send))

    def _fate(self, sender: MindIndex, send: PastSend) -> str:
        what = item_text(self._program, send.predicate, send.destination, send.args)
        text = f"{what} was sent by @{sender.robot} {seconds_text(send.at)}"
        if isinstance(send.cause, FiringCause):
            text += f" ({rule_name(self._program, sender.firings[send.cause.number].rule)})"
        repeats = len([at for at in send.repeated if at <= self._now])
        again = "" if not repeats else f", repeated {counted(repeats, 'time')}"
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
            for action in self._actions(mind, wanted.of(robot))[-ACTIONS_SHOWN:]:
                any_derived = True
                text = item_text(self._program, action.predicate, action.executor, action.args)
                yield AbsenceNode("action", f"it is the {effect} of action {text}: {self._stages(action)}")
        if not any_derived:
            text = item_text(self._program, source.action, source.executor, source.args)
            node = AbsenceNode("action", f"it is the {effect} of action {text}, which was never derived")
            derivable = [robot for robot in executors if rule_sources(self._program, wanted.of(robot))]
            for robot in derivable[:ACTIONS_SHOWN] if depth > 0 and source.ok else ():  # nobody asks for a failure
                node.children += self.reasons(wanted.of(robot), depth - 1)
            if not derivable:
                node.children.append(AbsenceNode("note", "no rule derives that action"))
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

    def _turn_began(self, action: PastAction) -> Instant | None:
        """Return when another action that waited for the same turn began: all of them have it from then on."""
        mind = self._past.mind_at(action.executor, self._now)
        begun = [
            other.begun
            for other in ([] if mind is None else mind.actions.values())
            if other.group == action.group
            and other.begun is not None
            and (action.held or 0) <= other.begun <= self._now
        ]
        return min(begun, default=None)

    def _order(self, action: PastAction) -> str:
        """Return the schedule that an action waits for, the robots before its own."""
        mind = self._past.mind_at(action.executor, self._now)
        known = [] if mind is None else [event for at, event in mind.schedule_log if at <= self._now]
        fits = [event for event in known if action.executor in event.order]
        if not fits:
            return ", without a place in a schedule yet"
        order = fits[-1].order
        place = order.index(action.executor)
        before = ", ".join(f"@{robot}" for robot in order[:place])
        behind = f" behind {before}" if before else ""
        return f", as number {place + 1} of the schedule of leader @{fits[-1].leader}{behind}"

    def _stages(self, action: PastAction) -> str:
        """Return how far an action had come, as of the instant of the question."""
        held = action.held is not None and action.held <= self._now
        begun = action.begun is not None and action.begun <= self._now
        if action.ended is not None and action.ended <= self._now:
            return stages(action)
        if begun:
            return f"began {seconds_text(action.begun or 0)} and is under way"
        if held and (since := self._turn_began(action)) is not None:
            return f"has its turn of {action.group} since {seconds_text(since)} and waits for the wheels"
        if held:
            return f"waits for its turn of {action.group} since {seconds_text(action.held or 0)}{self._order(action)}"
        return f"waits for the wheels since {seconds_text(action.at)}"

    # -- words --------------------------------------------------------------------------------------------------------

    def _facts(self, mind: MindIndex, asked: Question) -> list[PastFact]:
        return [fact for fact in mind.by_predicate[asked.predicate] if asked.matches(mind.robot, fact.args)]

    def _words(self, mind: MindIndex, fact: PastFact) -> str:
        return item_text(self._program, fact.predicate, mind.robot, fact.args)
