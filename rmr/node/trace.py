"""The trace of a robot, with one vocabulary for processes, the simulator and `rmr eval`.

An entry is a dict: `t` (seconds of lab time), `robot`, `what` (a name of `EVENTS`), and the fields of that name. Facts,
goals and actions are in program syntax; facts that stand for a rule over several robots are in words. The host takes
the entries; if it does not, the robot keeps only the newest. A robot without a trace records nothing, at no cost.
"""

from enum import IntEnum
from typing import Any, Final, NamedTuple

from rmr.base.time import Instant, in_seconds
from rmr.base.values import Robot, Value, format_fact, format_value
from rmr.bytecode.hidden_words import hidden_words
from rmr.bytecode.program import ANY, Kind, Program
from rmr.vm.failures import rule_place

ENTRIES_MAX: Final = 4096
"""Entries kept for the host; the oldest half goes first."""


class TraceLevel(IntEnum):
    """How much a robot notes."""

    NOTHING = 0
    NOTES = 1
    """Everything but the comings and goings of its facts; of a program that spins the first firings alone, for they
    would push out everything else."""
    FIRINGS = 2
    """Every firing, for a host that takes the entries away after each call."""
    FACTS = 3
    """The comings and goings of facts too."""


class TraceEvent(NamedTuple):
    """One word of the vocabulary."""

    fields: tuple[str, ...]
    """What an entry holds beside `t`, `robot` and `what`."""
    meaning: str


EVENTS: Final[dict[str, TraceEvent]] = {
    "fired": TraceEvent(("rule",), "a rule was applied: its place in the source, or its number in the byte-code"),
    "expression_failed": TraceEvent(("where", "reason"), "an expression has no value; what needed it was left out"),
    "bound_reached": TraceEvent(
        ("kept", "bound"), "more came than the robot keeps; the rest is dropped; reported once"
    ),
    "restless": TraceEvent(("firings",), "the program has had satisfied rules for 60 calls in a row; reported once"),
    "repeats": TraceEvent(
        ("rule", "firings"),
        "a rule has fired so often for the same facts while no goal was achieved; reported once per rule",
    ),
    "inserted": TraceEvent(("fact",), "a fact of the robot now holds; only where facts are traced"),
    "removed": TraceEvent(("fact",), "a fact was consumed or withdrawn; only where facts are traced"),
    "achieved": TraceEvent(("goal",), "a goal was discharged"),
    "unwanted": TraceEvent(("goal",), "an open goal was withdrawn, or has ended with the goal that it served"),
    "finished": TraceEvent((), "the lab's finish fact holds"),
    "action": TraceEvent(("action",), "an action has begun"),
    "cancelled": TraceEvent(("action", "goal"), "an action was stopped: the goal that it served has ended"),
    "action_ended": TraceEvent(("action", "failure"), "an action is over: why it failed, or null"),
    "raised": TraceEvent(
        ("action", "traceback"), "its handler raised an exception: a line for each call, the last one last"
    ),
    "said": TraceEvent(("text",), "the action `say`"),
    "light": TraceEvent(("colour",), "the action `light`"),
    "blocked": TraceEvent(("reason",), "a drive has no way, since robots that count as dead bar it: which, since when"),
    "at": TraceEvent(("area",), "the robot has arrived at an area"),
    "job_started": TraceEvent(("job", "deadline_s"), "a time assertion's job has started, or started anew"),
    "job_finished": TraceEvent(("job",), "its finish fact was inserted, in time or late"),
    "deadline_missed": TraceEvent(("job",), "its deadline passed without the finish fact"),
    "sent": TraceEvent(("destination", "fact"), "a fact, goal or action, or news of one, set out for another robot"),
    "repeated": TraceEvent(("destination", "fact"), "it was sent again, for want of an acknowledgement"),
    "delivered": TraceEvent(("destination", "fact"), "the other robot has acknowledged it"),
    "undelivered": TraceEvent(("destination", "predicate", "fact", "why"), "it was given up"),
    "received": TraceEvent(("source", "predicate", "fact"), "it has arrived here and takes effect"),
    "malformed": TraceEvent(("source", "why"), "a frame that no robot of this program sends was dropped"),
    "other_program": TraceEvent(("source",), "another robot runs another program"),
    "asks": TraceEvent(("event", "approach_s", "inside_s", "after_s", "way"), "the robot asks for a turn"),
    "slotted": TraceEvent(("event", "rank", "start_s", "end_s"), "it has a slot"),
    "slot_lost": TraceEvent(("event", "missed"), "its slot is gone; whether it let it pass"),
    "entered": TraceEvent(
        ("event", "cautious"), "its turn has begun; cautious: it cannot know that no other robot is inside"
    ),
    "left": TraceEvent(("event",), "its turn is over"),
    "withdrawn": TraceEvent(("event",), "it needs the turn no longer, or asks anew, perhaps elsewhere"),
    "scheduled": TraceEvent(("event", "leader", "term", "order"), "a new schedule of an event was heard or made"),
    "leads": TraceEvent(("event", "term"), "the robot leads an event's schedule"),
    "program": TraceEvent(
        ("digest", "facts", "ended"), "the robot has changed its program: how many facts it keeps, what has ended"
    ),
    "cannot_meet": TraceEvent(
        ("job", "step", "needs_s", "left_s"),
        "no split of its time over the job's steps meets the deadline: the longest step, what all need, what is left",
    ),
}
"""Every word, with the fields of its entries."""


class Trace:
    """One robot's notes."""

    __slots__ = ("_robot", "entries", "level")

    def __init__(self, robot: int, level: TraceLevel) -> None:
        self.level: Final = level
        self.entries: list[dict[str, Any]] = []
        self._robot = robot

    def note(self, now: Instant, what: str, **fields: Any) -> None:
        """Note that `what`, a word of `EVENTS`, has happened."""
        assert tuple(fields) == EVENTS[what].fields, (what, *fields)
        if self.level is TraceLevel.NOTHING:
            return
        if len(self.entries) >= ENTRIES_MAX:
            del self.entries[: ENTRIES_MAX // 2]
        self.entries.append({"t": round(in_seconds(now), 6), "robot": self._robot, "what": what, **fields})


def fact_text(program: Program, predicate: int, owner: int, args: tuple[Value, ...]) -> str:
    """Return a fact or an action in program syntax; of a rule over several robots in words."""
    if program.ensemble:
        words = hidden_words(program, predicate, [format_value(each) for each in (Robot(owner), *args)])
        if words is not None:
            return words
    declared = program.predicates[predicate]
    mark = "!" if declared.kind is Kind.PERSISTENT else ""
    return format_fact(declared.name, (Robot(owner), *args), mark)


def goal_text(program: Program, predicate: int, owner: int, args: tuple[object, ...]) -> str:
    """Return a goal in program syntax; what is ANY in it is ``_``."""
    texts = [format_value(Robot(owner)), *("_" if arg is ANY else format_value(arg) for arg in args)]  # type: ignore
    return f"{program.predicates[predicate].name}({', '.join(texts)})"


def rule_text(program: Program, rule: int) -> str:
    """Return where a rule stands, ``corridor.rmr:12``; without the debug section ``rule 0``."""
    return rule_place(program, rule).removeprefix("rule at ")
