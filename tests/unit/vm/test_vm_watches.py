"""Assertions across robots: the job with the start fact's robot, the watch with the finish fact's."""

from collections.abc import Iterable

import pytest
from vm_hand import AREA, INT, OPEN, ROBOT, Hand, V, _, actions, code

from rmr.base.time import NEVER, seconds
from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.program import Kind
from rmr.vm import watches
from rmr.vm.machine import Machine
from rmr.vm.machine_events import BoundReached, FinishAwaited, FinishSeen, JobFinished, JobMissed, JobStarted, VmEvent

pytestmark = pytest.mark.usefixtures("each_engine")

A, B, C = Robot(1), Robot(2), Robot(3)
X, Y = Symbol("x"), Symbol("y")


class Pair:
    """``handover: assert(gave(A, B, X), took(B, A, X), D, alarm(A, B))`` and machines for robots 1 and 2."""

    def __init__(self, kind: Kind = Kind.TEMPORARY, **more: object) -> None:
        hand = Hand()
        self.gave = hand.temporary("gave", ROBOT, AREA, INT)
        self.took = hand.predicate("took", kind, ROBOT, AREA)
        self.alarm = hand.action("alarm", ROBOT)
        hand.asserts(
            hand.atom(self.gave, V(1), V(2), V(3)),
            hand.atom(self.took, V(0), V(2)),
            V(3),
            hand.head(self.alarm, V(1)),
            name="handover",
            **{"finisher": V(1), **more},  # type: ignore[arg-type]
        )
        self.hand = hand
        self.giver, self.taker = hand.machine(robot=1), hand.machine(robot=2)

    def give(self, at: int, to: Robot = B, what: Symbol = X, within_s: int = 10) -> list[VmEvent]:
        self.giver.insert(at, self.gave, (to, what, within_s))
        self.giver.run(at)
        return self.giver.drain()

    def take(self, at: int, what: Symbol = X) -> list[VmEvent]:
        self.taker.insert(at, self.took, (A, what))
        self.taker.run(at)
        return self.taker.drain()

    def carry(self, at: int, events: Iterable[VmEvent]) -> None:
        """Let the other robot hear what `events` have for it."""
        for event in events:
            if isinstance(event, FinishAwaited) and event.destination == 2:
                self.taker.await_finish(at, 1, event.assertion, event.start_args, event.since)
            if isinstance(event, FinishSeen):
                self.giver.finish_seen(at, 2, event.assertion, event.args, event.at)


def test_finish_fact_is_requested_from_the_other_robot_and_reported() -> None:
    pair = Pair()
    events = pair.give(seconds(1))
    (job,) = pair.giver.jobs
    assert events == [JobStarted(job), FinishAwaited(2, 0, (B, X, 10), seconds(1))]
    assert (job.event, job.text) == ("handover(@1, x)", "took(@2, @1, x)")
    pair.carry(seconds(1.1), events)
    assert pair.taker.drain() == []
    news = pair.take(seconds(4))
    assert news == [FinishSeen(1, 0, (A, X), seconds(4))]
    pair.carry(seconds(4.2), news)
    assert pair.giver.drain() == [JobFinished(job)]
    assert (job.finish, job.missed, job.cause) == (seconds(4), False, None)
    assert pair.giver.next_wake == NEVER
    assert pair.take(seconds(5)) == [], "a watch is over with the first"


def test_a_fact_of_the_own_robot_or_of_others_ends_no_job_of_another_ones() -> None:
    pair = Pair()
    pair.give(0)
    pair.giver.insert(seconds(1), pair.took, (A, X))
    (job,) = pair.giver.jobs
    assert job.finish is None
    assert not pair.giver.finish_seen(seconds(1), 3, 0, (A, X), seconds(1))
    assert not pair.giver.finish_seen(seconds(1), 2, 0, (A, Y), seconds(1))
    assert not pair.giver.finish_seen(seconds(1), 2, 0, (B, X), seconds(1))
    assert job.finish is None


def test_a_job_whose_finish_fact_is_the_robots_own_stays_at_home() -> None:
    pair = Pair()
    assert [type(event) for event in pair.give(0, to=A)] == [JobStarted]
    pair.giver.insert(seconds(1), pair.took, (A, X))
    (job,) = pair.giver.jobs
    assert (job.text, job.finish, job.remote) == ("took(@1, @1, x)", seconds(1), False)


def test_jobs_that_wait_for_the_same_fact_of_different_robots_are_two() -> None:
    pair = Pair()
    pair.give(0, to=B)
    pair.give(0, to=C)
    assert [job.finisher for job in pair.giver.jobs] == [B, C]
    pair.giver.finish_seen(1, 3, 0, (A, X), 1)
    assert [job.finish for job in pair.giver.jobs] == [None, 1]


def test_an_insertion_between_the_start_and_the_request_counts() -> None:
    pair = Pair()
    asked = pair.give(seconds(1))
    pair.take(seconds(0.5))
    pair.take(seconds(2), Y)
    pair.take(seconds(3))
    pair.take(seconds(4))
    pair.carry(seconds(5), asked)
    assert pair.taker.drain() == [FinishSeen(1, 0, (A, X), seconds(3))]
    assert pair.take(seconds(6)) == []


def test_what_was_inserted_before_the_start_does_not_count_if_it_is_temporary() -> None:
    pair = Pair()
    pair.take(seconds(0.5))
    pair.carry(seconds(2), pair.give(seconds(1)))
    assert pair.taker.drain() == []


@pytest.mark.parametrize("kind", [Kind.SENSED, Kind.PERSISTENT])
def test_a_fact_that_holds_counts_at_once_as_of_the_later_of_start_and_insertion(kind: Kind) -> None:
    for taken, at in ((seconds(0.5), seconds(1)), (seconds(2), seconds(2))):
        pair = Pair(kind)
        pair.take(taken)
        pair.carry(seconds(3), pair.give(seconds(1)))
        assert pair.taker.drain() == [FinishSeen(1, 0, (A, X), at)]


def test_a_sensed_fact_that_held_when_the_job_started_counts_though_it_is_gone() -> None:
    for withdrawn, news in ((seconds(2), [FinishSeen(1, 0, (A, X), seconds(1))]), (seconds(0.9), [])):
        pair = Pair(Kind.SENSED)
        pair.take(seconds(0.5))
        pair.taker.withdraw(withdrawn, pair.took, (A, X))
        pair.carry(seconds(3), pair.give(seconds(1)))
        assert pair.taker.drain() == news


def test_late_finish_report_keeps_the_miss_and_explains_it() -> None:
    for taken, cause in ((seconds(10), "network"), (seconds(10) + 1, "local")):
        pair = Pair()
        pair.carry(0, pair.give(0, within_s=10))
        news = pair.take(taken)
        pair.giver.run(seconds(11))
        (job,) = pair.giver.jobs
        missed, alarm = pair.giver.drain()
        assert missed == JobMissed(job)
        assert actions([alarm]) == [alarm]
        assert job.cause == "local", "as far as the robot knows"
        pair.carry(seconds(12), news)
        pair.giver.run(seconds(30))
        assert pair.giver.drain() == [JobFinished(job)]
        assert (job.missed, job.finish, job.cause) == (True, taken, cause)


def test_finish_report_before_the_next_run_is_handled_after_the_miss() -> None:
    pair = Pair()
    pair.carry(0, pair.give(0, within_s=10))
    pair.carry(seconds(12), pair.take(seconds(9)))
    (job,) = pair.giver.jobs
    assert [type(event) for event in pair.giver.drain()][-1] is JobFinished
    assert job.cause == "network"


def test_restarted_job_requests_again_and_is_not_ended_by_an_old_report() -> None:
    pair = Pair()
    pair.carry(0, pair.give(0))
    old = pair.take(seconds(1))
    again = pair.give(seconds(2))
    (job,) = pair.giver.jobs
    assert [type(event) for event in again] == [JobStarted, FinishAwaited]
    pair.carry(seconds(3), old)
    assert job.finish is None
    pair.carry(seconds(3), again)
    pair.carry(seconds(5), pair.take(seconds(4)))
    assert (len(pair.giver.jobs), job.finish) == (1, seconds(4))


def test_a_later_request_takes_the_place_of_the_older_watch() -> None:
    pair = Pair()
    pair.carry(0, pair.give(0))
    pair.carry(seconds(2), pair.give(seconds(1)))
    assert pair.take(seconds(3)) == [FinishSeen(1, 0, (A, X), seconds(3))]


def test_a_request_that_was_overtaken_by_a_later_one_replaces_no_watch() -> None:
    pair = Pair()
    first = [event for event in pair.give(0) if isinstance(event, FinishAwaited)]
    pair.take(seconds(2))
    pair.carry(seconds(4), pair.give(seconds(3)))
    pair.carry(seconds(5), first)
    pair.carry(seconds(6), pair.take(seconds(6)))
    assert pair.giver.jobs[0].finish == seconds(6)


def test_finish_report_belongs_to_the_job_of_its_time() -> None:
    pair = Pair()
    pair.carry(0, pair.give(0, within_s=5))
    news = pair.take(seconds(4))
    pair.giver.run(seconds(6))
    pair.give(seconds(7))
    pair.giver.drain()
    pair.carry(seconds(8), news)
    first, second = pair.giver.jobs
    assert pair.giver.drain() == [JobFinished(first)]
    assert (first.cause, second.finish) == ("network", None)


def test_finish_report_with_a_future_time_counts_as_now() -> None:
    pair = Pair()
    pair.give(0)
    assert pair.giver.finish_seen(seconds(1), 2, 0, (A, X), seconds(99))
    assert pair.giver.jobs[0].finish == seconds(1)


def test_a_named_robot_alone_has_the_jobs_of_an_assertion_on_it() -> None:
    pair = Pair(robot=1)
    pair.taker.insert(0, pair.gave, (A, X, 10))
    assert pair.taker.jobs == []
    assert len(pair.give(0)) == 2


def test_a_named_robot_may_be_the_one_that_finishes() -> None:
    pair = Pair(finisher=Robot(2))
    events = pair.give(0, to=C)
    assert isinstance(events[1], FinishAwaited)
    assert events[1].destination == 2
    pair.carry(0, events)
    pair.carry(1, pair.take(1))
    assert pair.giver.jobs[0].finish == 1


def test_a_finisher_that_is_no_robot_starts_no_job_and_is_counted() -> None:
    hand = Hand()
    begin, end, alarm = hand.temporary("begin", OPEN), hand.temporary("end"), hand.action("alarm")
    hand.asserts(hand.atom(begin, V(1)), hand.atom(end), 10, hand.head(alarm), finisher=V(1))
    machine = hand.machine()
    machine.insert(0, begin, (3,))
    assert (machine.jobs, machine.expression_failures) == ([], 1)
    machine.insert(0, begin, (Robot(3),))
    assert len(machine.jobs) == 1


@pytest.mark.parametrize(
    ("watcher", "assertion", "args"),
    [
        (1, 1, (B, X, 10)),
        (1, -1, (B, X, 10)),
        (2, 0, (B, X, 10)),
        (1, 0, (C, X, 10)),
        (1, 0, (B, X)),
        (1, 0, (B, "x", 10)),
    ],
)
def test_a_request_that_no_robot_of_the_program_makes_is_refused(
    watcher: int, assertion: int, args: tuple[Value, ...]
) -> None:
    pair = Pair()
    with pytest.raises(ValueError, match=r"assertion|gave"):
        pair.taker.await_finish(0, watcher, assertion, args, 0)
    assert pair.take(1) == []


def test_a_request_about_another_robots_job_is_refused() -> None:
    pair = Pair(robot=3)
    with pytest.raises(ValueError, match="handover"):
        pair.taker.await_finish(0, 1, 0, (B, X, 10), 0)
    local = Pair(finisher=V(0))
    with pytest.raises(ValueError, match="handover"):
        local.taker.await_finish(0, 1, 0, (B, X, 10), 0)


@pytest.mark.parametrize(("assertion", "args"), [(1, (A, X)), (-1, (A, X)), (0, (A,)), (0, (A, 4))])
def test_finish_report_that_no_robot_of_the_program_sends_is_refused(assertion: int, args: tuple[Value, ...]) -> None:
    pair = Pair()
    pair.give(0)
    with pytest.raises(ValueError, match=r"assertion|took"):
        pair.giver.finish_seen(0, 2, assertion, args, 0)


def test_watches_are_bounded_and_the_oldest_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watches, "WATCHES_MAX", 2)
    pair = Pair()
    for name in "uvwx":
        pair.carry(0, pair.give(0, what=Symbol(name)))
    assert pair.taker.drain() == [BoundReached("watches", 2, 0)]
    assert pair.taker.dropped == {"watches": 2}
    assert [pair.take(1, Symbol(name)) != [] for name in "uvwx"] == [False, False, True, True]


def test_the_memory_of_insertions_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watches, "RECENT_MAX", 2)
    pair = Pair()
    asked = pair.give(0)
    for name in "xyz":
        pair.take(1, Symbol(name))
    pair.carry(2, asked)
    assert pair.taker.drain() == []


def test_robots_without_possible_requests_keep_no_insertion_history() -> None:
    pair = Pair(finisher=V(0))
    pair.take(1)
    assert not pair.taker._affairs.asked


def three(deadline: object = 10) -> tuple[Hand, int, int]:
    """``lap(A, B) .. lap(B, A)``: start and finish facts of one predicate."""
    hand = Hand()
    lap, alarm = hand.temporary("lap", ROBOT), hand.action("alarm")
    hand.asserts(hand.atom(lap, V(1)), hand.atom(lap, V(0)), deadline, hand.head(alarm), finisher=V(1))
    return hand, lap, alarm


def test_one_insertion_may_end_another_robots_job_and_start_one_here() -> None:
    hand, lap, _alarm = three()
    first, second = hand.machine(robot=1), hand.machine(robot=2)
    first.insert(0, lap, (B,))
    started, asked = first.drain()
    assert isinstance(asked, FinishAwaited)
    second.await_finish(0, 1, 0, asked.start_args, asked.since)
    second.insert(1, lap, (A,))
    assert [type(event) for event in second.drain()] == [FinishSeen, JobStarted, FinishAwaited]
    assert isinstance(started, JobStarted)


def test_the_violation_of_a_job_across_robots_is_derived_once_and_on_time() -> None:
    hand, lap, alarm = three(code(2))
    machine: Machine = hand.machine(robot=1)
    machine.insert(0, lap, (B,))
    assert machine.next_wake == seconds(2)
    machine.run(seconds(2))
    machine.run(seconds(9))
    assert [(a.predicate, a.executor) for a in actions(machine.drain())] == [(alarm, 1)]


def test_a_pattern_that_leaves_something_open_is_met_by_anything() -> None:
    hand = Hand()
    begin, end, alarm = hand.temporary("begin", ROBOT), hand.temporary("end", INT, INT, INT), hand.action("alarm")
    hand.asserts(hand.atom(begin, V(1)), hand.atom(end, V(2), V(2), _), 10, hand.head(alarm), finisher=V(1))
    machine = hand.machine(robot=2)
    machine.await_finish(0, 1, 0, (B,), 0)
    machine.insert(1, end, (1, 2, 3))
    assert machine.drain() == []
    machine.insert(2, end, (2, 2, 3))
    assert machine.drain() == [FinishSeen(1, 0, (2, 2, 3), 2)]
