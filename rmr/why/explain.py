"""Why-provenance: the tree of rules, facts, messages and actions that led to an item.

A node is an item; its children are what its cause rests on: for a firing the facts that the body and the comprehension
matched, for an effect the action, for a delivery the message on the sender's side. Leaves are given, come from outside
or are sensed. A sensed fact that is a declared effect of an action under way has that action below it: the sensor sees
what the action does.
"""

from typing import Final, NamedTuple

from rmr.base.printable import counted
from rmr.base.values import Robot, Value
from rmr.bytecode.program import Atom, Bind, Kind, Mode, Program, Rule, Slot
from rmr.vm.derive import DerivedKind
from rmr.vm.evaluate import NoValue, evaluate
from rmr.vm.provenance import (
    Cause,
    DeliveredCause,
    EffectCause,
    FiringCause,
    FiringRecord,
    GivenCause,
    HandlerCause,
    HeardCause,
    MissedCause,
    OutsideCause,
    SensedCause,
    StandsCause,
    StepCause,
    UndeliveredCause,
)
from rmr.vm.ranks import PENDING, rank_text, reading
from rmr.why.mind_index import MindIndex
from rmr.why.past import Past
from rmr.why.past_items import EndedGoal, PastAction, PastFact, PastGoal, PastItem, PastSend
from rmr.why.robot_history import failure_broadcast, shared_fact
from rmr.why.rule_words import conjunct_text, item_text, rule_name, rule_place_of, seconds_text
from rmr.why.why_tree import RuleFiring, WhyNode

DEPTH: Final = 3
"""Levels below the root that are shown."""

SENSES: Final = {
    "at": "sensed by localisation",
    "pose": "sensed by localisation",
    "peer": "from the list of robots",
    "robots": "from the list of robots",
    "neighbor": "sensed by the radio",
    "range": "sensed by the radio",
    "silent": "not heard for 15 seconds",
    "obstacle": "sensed by view or bumper",
    "turn": "from the schedule",
    "leads": "from the election",
    "failed": "from a failure broadcast",
}
"""What states the provided facts."""


class Premise(NamedTuple):
    """An item on which another one rests."""

    mind: MindIndex
    item: PastItem
    role: str = ""


class Because(NamedTuple):
    """A cause, explained."""

    word: str
    words: str
    premises: list[Premise]
    firing: RuleFiring | None = None


class Explainer:
    """Builds the trees of one answer."""

    def __init__(self, past: Past, robot: int | None) -> None:
        """`robot` is the question's: numbers of its items need no robot."""
        self._past = past
        self._program = past.program
        self._robot = robot
        self._shown: set[tuple[int, int]] = set()

    def tree(self, premise: Premise, depth: int = DEPTH) -> WhyNode:
        """Return the tree of an item, cut `depth` levels below it."""
        mind, item, role = premise
        because = self.because(mind, item)
        node = WhyNode(
            self.number(mind, item),
            _kind(item),
            self.text(mind, item),
            mind.robot,
            item.at,
            because.word,
            self._words(mind, item, because),
            role,
            because.firing,
        )
        if not because.premises:
            return node
        key = mind.robot, item.number
        if key in self._shown:
            node.above = True
        elif depth <= 0:
            node.cut = True
        else:
            self._shown.add(key)
            # An aggregate may rest on thousands of facts.
            shown = because.premises[:40]
            node.omitted = len(because.premises) - len(shown)
            node.children = [self.tree(each, depth - 1) for each in shown]
        return node

    def number(self, mind: MindIndex, item: PastItem) -> str:
        """Return the number of an item as `--more` takes it."""
        return str(item.number) if mind.robot == self._robot else f"{mind.robot}.{item.number}"

    def text(self, mind: MindIndex, item: PastItem) -> str:
        """Return an item in program syntax."""
        match item:
            case PastGoal():
                return item_text(self._program, item.predicate, mind.robot, item.args, "?")
            case PastSend():
                mark = "?" if item.role is DerivedKind.GOAL else ""
                return item_text(self._program, item.predicate, item.destination, item.args, mark)
            case PastAction():
                return item_text(self._program, item.predicate, item.executor, item.args)
            case PastFact():
                return item_text(self._program, item.predicate, mind.robot, item.args)

    def _words(self, mind: MindIndex, item: PastItem, because: Because) -> str:
        match item:
            case PastAction():
                ended = item.cancelled_with
                goal = f", with {ended_text(self._program, mind.robot, ended)}" if ended is not None else ""
                return f"{because.words}; {stages(item)}{goal}"
            case PastSend():
                comma = "" if because.word == "rule" else ","
                return f"sent to @{item.destination}{comma} {because.words}{fate(item)}"
            case PastGoal() if item.achieved is not None:
                return f"{because.words}; achieved {seconds_text(item.achieved)}"
            case PastGoal() if item.withdrawn is not None:
                return f"{because.words}; {withdrawn_text(self._program, mind.robot, item)}"
            case PastGoal() | PastFact():
                return because.words

    # -- causes -------------------------------------------------------------------------------------------------------

    def because(self, mind: MindIndex, item: PastItem) -> Because:
        """Return the cause of an item and what it rests on."""
        cause: Cause = item.cause
        match cause:
            case GivenCause("robot"):
                return Because("given", "the robot's own number", [])
            case GivenCause(giver):
                return Because("given", f"given by the {giver}", [])
            case OutsideCause():
                return Because("outside", "inserted from outside", [])
            case SensedCause():
                return self._sensed(mind, item)
            case FiringCause(number, chain):
                return self._fired(mind, mind.firings[number], chain)
            case DeliveredCause():
                return self._delivered(mind, item, cause)
            case HeardCause(source):
                told = None if not isinstance(item, PastFact) else shared_fact(self._past.minds(source), item)
                return Because("heard", f"told by @{source}, a neighbour", [] if told is None else [Premise(*told)])
            case UndeliveredCause():
                return self._undelivered(mind, item, cause)
            case StandsCause(key):
                sent = mind.deliveries.get(key)
                premises = [Premise(mind, sent)] if isinstance(sent, PastSend) else []
                return Because("message", f"@{key.destination} has acknowledged the decision", premises)
            case MissedCause(job):
                return self._missed(mind, item, job)
            case EffectCause() | StepCause() | HandlerCause():
                return self._of_action(mind, cause)

    def _of_action(self, mind: MindIndex, cause: EffectCause | StepCause | HandlerCause) -> Because:
        action = mind.actions.get(cause.action)
        premises = [] if action is None else [Premise(mind, action)]
        match cause:
            case EffectCause(ok=True):
                return Because("effect", "effect of the action", premises)
            case EffectCause():
                return Because("effect", "`else` effect of the action, which failed", premises)
            case StepCause():
                return Because("step", "the step after the action", premises)
            case HandlerCause():
                return Because("handler", "inserted by the Python handler of the action", premises)

    def _sensed(self, mind: MindIndex, item: PastItem) -> Because:
        predicate = self._program.predicates[item.predicate]
        words = SENSES.get(predicate.name, "sensed") if predicate.provided else "sensed"
        assert isinstance(item, PastFact)
        if predicate.provided and predicate.name == "failed" and item.args:
            return self._failure(item, words)
        if predicate.provided and predicate.name == "turn":
            return self._turn(mind, item, words)
        for action in reversed(mind.actions.values()):
            if action.executor == mind.robot and action.under_way_at(item.at) and self.brings(action, item):
                premise = Premise(mind, action)
                return Because("sensed", f"{words}, the declared effect of the action under way", [premise])
        return Because("sensed", words, [])

    def brings(self, action: PastAction, fact: PastFact) -> bool:
        """Return whether a fact is a declared effect of an action for its executor."""
        env: list[Value] = [Robot(action.executor), *action.args]
        for effect in self._program.predicates[action.predicate].effects:
            if effect.predicate != fact.predicate:
                continue
            try:
                values = tuple([evaluate(code, env, fact.at) for code in effect.args])
                if values == fact.args and evaluate(effect.owner, env, fact.at) == action.executor:
                    return True
            except NoValue:
                continue
        return False

    def _turn(self, mind: MindIndex, item: PastFact, words: str) -> Because:
        """Explain a fact ``turn`` by the schedule and by what started the job that asks for the turn."""
        schedule = mind.schedules.get(item.serial)
        if schedule is not None:
            order = ", ".join(f"@{robot}" for robot in schedule.order)
            words += f" of leader @{schedule.leader} (term {schedule.term}): {order}"
        start = mind.asked_for(item)
        return Because("sensed", words, [] if start is None else [Premise(mind, start)])

    def _failure(self, item: PastFact, words: str) -> Because:
        source = item.args[0]
        assert isinstance(source, Robot)
        broadcast = failure_broadcast(self._past.minds(source), item)
        return Because("sensed", f"{words} of @{int(source)}", [] if broadcast is None else [Premise(*broadcast)])

    def _delivered(self, mind: MindIndex, item: PastItem, cause: DeliveredCause) -> Because:
        found = self._past.sender(cause, mind.robot, item.at)
        words = f"delivered by @{cause.source} (message {cause.sequence})"
        if found is None:
            return Because("message", f"{words}, of which there is no recording", [])
        return Because("message", words, [Premise(*found)])

    def _undelivered(self, mind: MindIndex, item: PastItem, cause: UndeliveredCause) -> Because:
        words = f"a message to @{cause.destination} was given up"
        lost = mind.undelivered(cause, item.at)
        return Because("undelivered", words, [Premise(mind, lost)] if isinstance(lost, PastSend) else [])

    def _missed(self, mind: MindIndex, item: PastItem, serial: int) -> Because:
        known = mind.jobs.get(serial)
        if known is None or known.job is None:
            return Because("deadline", "a deadline was missed", [])
        start = mind.start_of(serial, item.place)
        premises = [] if start is None else [Premise(mind, start)]
        return Because("deadline", f"the deadline of {known.job.name} was missed", premises)

    # -- firings ------------------------------------------------------------------------------------------------------

    def _fired(self, mind: MindIndex, record: FiringRecord, chain: int) -> Because:
        rule = self._program.rules[record.rule]
        atoms = [each for each in rule.body if isinstance(each, Atom) and each.mode is not Mode.ABSENT]
        premises = [
            Premise(mind, mind.facts[serial], _ROLES[atom.mode])
            for atom, serial in zip(atoms, record.matched, strict=True)
        ]
        inner = record.derived[chain].inner if chain < len(record.derived) else ()
        consumed = set(record.consumed)
        for serial in inner:
            role = "consumed" if serial in consumed else "kept" if self._linear(mind, serial) else "read"
            premises.append(Premise(mind, mind.facts[serial], role))
        premises += [Premise(mind, fact, "read") for fact in mind.heard_within(record)]
        firing = self.firing(mind, record, rule)
        words = f"by {rule_name(self._program, record.rule)}"
        if firing.conditions:
            words += f" where {', '.join(firing.conditions)}"
        if firing.goals:
            distance = _distance(firing.rank or 0)
            words += f", for the goal {', '.join(firing.goals)}{distance}"
        return Because("rule", words, premises, firing)

    def _linear(self, mind: MindIndex, serial: int) -> bool:
        return self._program.predicates[mind.facts[serial].predicate].kind is Kind.TEMPORARY

    def firing(self, mind: MindIndex, record: FiringRecord, rule: Rule) -> RuleFiring:
        """Return what is told of a firing."""
        conditions = [
            conjunct_text(self._program, each, mind.robot, record.bindings)
            for each in rule.body
            if not isinstance(each, Atom) or each.mode is Mode.ABSENT
        ]
        names = self._past.variables(record.rule)
        return RuleFiring(
            record.number,
            record.rule,
            rule_place_of(self._program, record.rule),
            {names.get(slot, f"${slot}"): value for slot, value in enumerate(_bound(rule, record.bindings))},
            tuple(conditions),
            self._goals(mind, record),
            record.rank,
        )

    def _goals(self, mind: MindIndex, record: FiringRecord) -> tuple[str, ...]:
        """Return the open goals to which a firing with a rank may lead."""
        if record.rank is None:
            return ()
        backwards = reading(self._program).backwards
        brought = backwards.brought[record.rule]
        return tuple(
            [
                item_text(self._program, predicate, mind.robot, args)
                for predicate, args in record.goals
                if any(each in backwards.distances(predicate) for each in brought)
            ]
        )


def _distance(rank: int) -> str:
    """Return how far a firing is from a goal."""
    if rank >= PENDING:
        return f" ({rank_text(rank)})"
    return {0: "", 1: ", one more firing away"}.get(rank, f", {rank} more firings away")


def _bound(rule: Rule, values: tuple[Value, ...]) -> tuple[Value, ...]:
    """Return the values of the slots that the rule's own body binds: those of inner bodies come behind them."""
    bound = [slot.index for each in rule.body if isinstance(each, Atom) for slot in each.args if isinstance(slot, Slot)]
    bound += [each.slot for each in rule.body if isinstance(each, Bind)]
    return values[: 1 + max(bound, default=0)]


_ROLES: Final = {Mode.CONSUME: "consumed", Mode.KEEP: "kept", Mode.READ: "read"}


def _kind(item: PastItem) -> str:
    match item:
        case PastFact():
            return "fact"
        case PastAction():
            return "action"
        case PastSend():
            return "message"
        case PastGoal():
            return "goal"


def ended_text(program: Program, robot: int, goal: EndedGoal) -> str:
    """Return a goal with which something else has ended."""
    predicate, args = goal
    return item_text(program, predicate, robot, args, "?")  # type: ignore[arg-type]


def withdrawn_text(program: Program, robot: int, goal: PastGoal) -> str:
    """Return how an open goal came to its end without being achieved."""
    assert goal.withdrawn is not None
    if goal.served is None:
        return f"withdrawn {seconds_text(goal.withdrawn)}"
    return f"ended {seconds_text(goal.withdrawn)}, with {ended_text(program, robot, goal.served)}"


def stages(action: PastAction) -> str:
    """Return how far an action came."""
    words = []
    if action.held is not None:
        words.append(f"waited for its turn of {action.group}")
    if action.begun is not None:
        words.append(f"began {seconds_text(action.begun)}")
    if action.ended is None:
        words.append("has not ended" if action.begun is not None else "has not begun")
    elif action.failure is None:
        words.append(f"completed {seconds_text(action.ended)}")
    elif action.cancelled_with is not None:
        words.append(f"cancelled {seconds_text(action.ended)}")
    else:
        words.append(f"failed {seconds_text(action.ended)} ({action.failure})")
    return ", ".join(words)


def fate(send: PastSend) -> str:
    """Return what became of a message."""
    count = len(send.repeated)
    repeats = f", {counted(count, 'repeat')}" if count else ""
    if send.given_up is not None:
        return f"{repeats}, given up {seconds_text(send.given_up)} ({send.why})"
    if send.acknowledged is not None:
        return f"{repeats}, acknowledged {seconds_text(send.acknowledged)}"
    return f"{repeats}, not acknowledged"
