"""Who has set out and was put off goes before all that have not set out: nobody else gets past it."""

from coord_harness import EVENT, ms

from rmr.coord.fence import Fence
from rmr.coord.ledger import Ledger
from rmr.coord.messages import Job
from rmr.coord.term import Term
from rmr.coord.timing import MS, Timing

LED = Term(1, 1)


def told(
    ledger: Ledger, robot: int, now_ms: int, approach_ms: int, deadline_ms: int, *, underway: bool = False
) -> bool:
    """Let `robot` tell its job at `now_ms`, when it needs `approach_ms` to the gate; return whether that is news."""
    now = ms(now_ms)
    release = now + ms(approach_ms)
    job = Job(EVENT, now, LED, 0, 0, release, ms(3000), ms(deadline_ms), ms(1000), 0, None, underway)
    return ledger.note(now, robot, job, Fence(1, Timing()))


def order(ledger: Ledger, now_ms: int) -> list[int]:
    """Plan at `now_ms` and return the robots in the order of their slots."""
    ledger.open = True
    ledger.plan(ms(now_ms), True)
    return sorted(ledger.bookings, key=lambda robot: ledger.bookings[robot].start or 0)


def crowd() -> Ledger:
    """Return the books of five robots: 2 and 3 are too late already, 4, 5 and 6 just in time if none goes before."""
    ledger = Ledger(1, Timing(), 0, 0)
    for robot, deadline_ms in ((2, 1000), (3, 1000), (4, 5200), (5, 6200), (6, 7200)):
        told(ledger, robot, 0, 2000, deadline_ms)
    return ledger


def test_late_robot_that_has_not_set_out_goes_last() -> None:
    assert order(crowd(), 10) == [4, 5, 6, 2, 3]


def test_robots_under_way_go_first_by_distance_regardless_of_deadline() -> None:
    ledger = crowd()
    told(ledger, 3, 20, 3000, 1000, underway=True)
    told(ledger, 5, 20, 4000, 6200, underway=True)
    told(ledger, 2, 20, 2500, 1000, underway=True)
    assert order(ledger, 30) == [2, 3, 5, 4, 6]
    told(ledger, 3, 40, 2000, 1000, underway=True)
    assert order(ledger, 50)[:2] == [3, 2]


def test_no_robot_under_way_gets_a_slot_before_it_can_be_there() -> None:
    ledger = crowd()
    told(ledger, 6, 20, 4000, 7200, underway=True)
    order(ledger, 30)
    assert (ledger.bookings[6].start or 0) >= ms(4030)


def test_a_repeated_job_does_not_bring_its_owner_nearer() -> None:
    ledger = crowd()
    told(ledger, 3, 20, 2500, 1000, underway=True)
    assert not told(ledger, 3, 5000, 0, 1000, underway=True)
    assert ledger.bookings[3].approach == 2500 * MS
    told(ledger, 3, 5100, 1200, 1000, underway=True)
    assert ledger.bookings[3].approach == 1200 * MS


def test_a_repeated_job_of_a_robot_that_waits_does_not_bring_it_nearer() -> None:
    ledger = crowd()
    for now_ms in (2100, 4100):  # a release that is past is told as one of now
        assert not told(ledger, 3, now_ms, 0, 1000)
        assert ledger.bookings[3].approach == 2000 * MS


def test_robot_no_longer_under_way_is_ordered_by_deadline_again() -> None:
    ledger = crowd()
    told(ledger, 3, 20, 2000, 1000, underway=True)
    assert order(ledger, 30)[0] == 3
    assert told(ledger, 3, 40, 2000, 1000)
    assert order(ledger, 50) == [4, 5, 6, 2, 3]
