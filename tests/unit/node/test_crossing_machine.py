"""The state machine of a crossing, as values: a complete table, one writer of the phase, crossings kept apart."""

import ast
from itertools import product
from pathlib import Path
from random import Random

import pytest

import rmr.node.crossing
from rmr.base.geometry import Pose
from rmr.base.time import milliseconds, seconds
from rmr.base.values import Robot
from rmr.coord.events import Entered, EntryMissed, JobRequest, SlotAssigned, SlotLost
from rmr.node.crossing.crossing import Crossing
from rmr.node.crossing.phases import (
    IGNORED,
    TRANSITIONS,
    Asking,
    Inside,
    Left,
    OwnEvent,
    Phase,
    Preparing,
    SlotEvent,
    Slotted,
)
from rmr.node.crossing.situation import (
    CrossingPlan,
    InsideUntil,
    Leave,
    OpenHoldLine,
    Revise,
    SetReady,
    Situation,
    Unforeseen,
    Withdraw,
)
from rmr.vm.job import TimedJob

PHASES = Phase.__args__
EVENTS = SlotEvent.__args__
SOURCES = Path(rmr.node.crossing.__file__).parent


def job(serial: int = 1) -> TimedJob:
    return TimedJob(serial, 0, "crossing", "crossing(exit)", "at(@1, exit)", 0, seconds(20.0), (), Robot(1))


def in_phase(phase: type) -> Phase:
    return {Preparing: Preparing(), Asking: Asking(0), Slotted: Slotted(0, 0), Inside: Inside(0, None), Left: Left()}[
        phase
    ]


def event_of(kind: type, group_id: bytes = b"group.", start: int = 0):
    match kind.__name__:
        case "SlotAssigned":
            return SlotAssigned(group_id, 0, 1, 1, start, start + seconds(1), 1, 1)
        case "Entered":
            return Entered(group_id, start, start + seconds(1), cautious=False)
    return kind(group_id)


def test_phases_events_and_transitions_are_those_of_the_table():
    assert {phase for phase, _ in TRANSITIONS} == {*PHASES}
    assert {*TRANSITIONS.values()} == {*PHASES}
    assert {event for _, event in TRANSITIONS} == {*EVENTS, *OwnEvent}
    assert not IGNORED & TRANSITIONS.keys()


@pytest.mark.parametrize(("phase", "event"), list(product(PHASES, EVENTS)), ids=lambda one: one.__name__)
def test_each_event_of_coordination_has_a_row_or_is_ignored_or_reported_in_each_phase(phase, event):
    one = Crossing(job(), b"group.", b"group.", 0, None, in_phase(phase))
    commands = one.handle(0, event_of(event), Situation())
    if (phase, event) in TRANSITIONS:
        assert type(one.phase) is TRANSITIONS[phase, event]
        return
    assert type(one.phase) is phase
    impossible = phase is Inside and event in (SlotLost, EntryMissed, Entered)
    assert ((phase, event) in IGNORED) is not impossible
    assert commands == ([Unforeseen("inside", event.__name__)] if impossible else [])


def test_each_phase_ends_by_the_robots_own_events_as_the_table_says():
    for (phase, event), then in TRANSITIONS.items():
        if isinstance(event, OwnEvent):
            one = Crossing(job(), b"group.", b"group.", 0, None, in_phase(phase), beyond=event is OwnEvent.EXCUSED)
            match event:
                case OwnEvent.REQUESTED:
                    one.step(0, Situation(may_ask=True))
                case OwnEvent.EXCUSED:
                    one.step(0, Situation(may_ask=True, beyond=True, excused=True))
                case OwnEvent.RENEWED:
                    one.renew(0, job(), None)
                case OwnEvent.JOB_OVER:
                    one.finish()
                case OwnEvent.ACTION_FAILED:
                    one.fail()
                case OwnEvent.CLEARED:
                    one.plan = CrossingPlan(gated=True)
                    one.step(0, Situation(cleared=True))
            assert type(one.phase) is then, (phase, event)


def test_the_phase_has_one_writer():
    writers = []
    for path in sorted(SOURCES.glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            writers += [path.name for to in targets if isinstance(to, ast.Attribute) and to.attr == "phase"]
    assert writers == ["crossing.py"]


def test_a_crossing_is_written_by_its_own_module_alone():
    """What a crossing knows is changed by its methods; others call them."""
    written = []
    for path in sorted(SOURCES.glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, (ast.Assign, ast.AugAssign, ast.AnnAssign)):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                owners = [ast.unparse(to.value) for to in targets if isinstance(to, ast.Attribute)]
                written += [(path.name, owner) for owner in owners if owner.split(".")[0] == "crossing"]
    assert written == []


class Ledger:
    """Which groups the coordination core holds a request of, by the commands alone."""

    def __init__(self) -> None:
        self.live: set[bytes] = set()

    def take(self, one: Crossing, commands) -> None:
        for command in commands:
            match command:
                case JobRequest(group_id=group_id):
                    assert group_id == one.group_id
                    assert one.group_id not in self.live, "requested twice"
                    self.live.add(one.group_id)
                case Withdraw() | Leave():
                    self.live.remove(one.group_id)
                case Revise() | SetReady() | InsideUntil():
                    assert one.group_id in self.live, f"{command} without a request"
                case OpenHoldLine(opened=opened):
                    assert opened is isinstance(one.phase, Inside)
                case Unforeseen():
                    pytest.fail(f"{command}")
        requested = isinstance(one.phase, (Asking, Slotted, Inside))
        assert requested is (one.group_id in self.live)


def any_situation(rng: Random) -> Situation:
    def often() -> bool:
        return rng.random() < 0.8

    def rarely() -> bool:
        return rng.random() < 0.1

    plan = CrossingPlan(
        gated=often(), direction=rng.randrange(2), approach=milliseconds(rng.randrange(5000)), within=rarely(),
        obstructs_exit=rarely(),
    )  # fmt: skip
    return Situation(
        pose=rng.choice([None, Pose(rng.random(), rng.random(), 0.0)]), late_goes_next=rarely(), set_out=often(),
        ready=often(), excused=rarely(), may_ask=often(), plan=rng.choice([None, plan]), beyond=rarely(),
        within=rarely(), in_entrance=rarely(), retreating=rarely(), before_hold_line=often(), cleared=rarely(),
        eta_clear=milliseconds(rng.randrange(3000)),
    )  # fmt: skip


def happen(rng: Random, now: int, one: Crossing, live: set[bytes]):
    """Let anything happen that may: a tick, news of coordination for a live request, or news of the job."""
    situation, what = any_situation(rng), rng.random()
    if what < 0.5 or (what < 0.9 and one.group_id not in live):
        return one.step(now, situation)
    if what < 0.9:
        possible = [event for event in EVENTS if not (isinstance(one.phase, Inside) and event is not SlotAssigned)]
        return one.handle(now, event_of(rng.choice(possible), one.group_id, now + seconds(rng.randrange(5))), situation)
    if one.over:
        return one.retry(now, situation.plan)
    if what < 0.95 or isinstance(one.phase, Inside):
        return one.restart(now, job(rng.randrange(100)), None)
    return one.finish()


@pytest.mark.parametrize("seed", range(50))
def test_two_crossings_of_one_robot_keep_to_the_table_and_apart_whatever_happens(seed):
    rng, ledger, now, seen = Random(f"crossing/{seed}"), Ledger(), 0, set()
    crossings = [
        Crossing(job(serial), group_id, group_id, 0, None) for serial, group_id in enumerate([b"first.", b"other."])
    ]
    for _ in range(400):
        now += milliseconds(rng.randrange(400))
        one, other = rng.sample(crossings, 2)
        before, trigger = repr(other), one.trigger
        ledger.take(one, happen(rng, now, one, ledger.live))
        assert repr(other) == before, "another resource is none of its business"
        assert one.trigger >= trigger
        assert one.released(now) or one.waits
        assert isinstance(one.phase, Left) or one.next_wake < now + seconds(10)
        seen.add(type(one.phase))
    assert len(seen) >= 4
