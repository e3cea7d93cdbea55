"""Section IV.C of the paper, claim by claim: discover, join or lead, wait n, list by deadline."""

from coord_harness import EVENT, Model, ms

from rmr.coord import events
from rmr.coord.fence import Fence
from rmr.coord.ledger import Ledger
from rmr.coord.messages import Job, Sched, decode
from rmr.coord.term import NOBODY, Term
from rmr.coord.timing import MS, Timing


def sent(model: Model) -> list[tuple[int, int, object]]:
    """Return a list that fills with (instant, sender, message) of every frame on the air."""
    log: list[tuple[int, int, object]] = []

    def watch(source: int, target: int, payload: bytes, now: int) -> bool:
        log.append((now, source, decode(payload)))
        return True

    model.air.filter = watch
    return log


def test_iv_c_a_triggered_robot_first_broadcasts_to_see_whether_there_is_a_leader() -> None:
    model = Model(1, 3)
    log = sent(model)
    model.trigger(0, 2, deadline=ms(9000))
    model.run(ms(2000))
    first = log[0][2]
    assert log[0][1] == 2
    assert isinstance(first, Job)
    assert first.term.leader == NOBODY


def test_iv_c_a_robot_that_is_told_of_a_leader_sends_it_a_message_to_join() -> None:
    model = Model(1, 2)
    model.trigger(0, 1, deadline=ms(20_000))
    model.run(ms(900))
    log = sent(model)
    model.minds[2].boot()
    model.trigger(ms(1500), 2, deadline=ms(20_000))
    model.run(ms(2200))
    joins = [m for _, source, m in log if source == 2 and isinstance(m, Job) and m.term.leader == 1]
    assert joins
    assert joins[0].trigger == ms(1500)
    assert model.minds[2].slot is not None
    assert model.minds[2].slot.leader == 1


def test_iv_c_otherwise_it_creates_a_group_and_leads_it() -> None:
    model = Model(1, 2)
    model.trigger(0, 2, deadline=ms(9000))
    model.run(ms(1000))
    assert any(isinstance(event, events.LeadershipBegan) for _, event in model.minds[2].log)
    assert model.leaders() == [2]


def waiting_time(deadline: int, peers: int) -> int:
    """Return n of a leader with one job of that deadline and that many peers that have not joined."""
    ledger = Ledger(1, Timing(), 0, 0)
    job = Job(EVENT, 0, Term(1, 1), 0, 0, 0, ms(3000), deadline, ms(950), 0, None)
    ledger.note(0, 1, job, Fence(1, Timing()))
    return ledger.wait(0, peers)


def test_iv_c_the_leader_waits_n_for_participants_set_by_the_deadline() -> None:
    relaxed, tight, hopeless = waiting_time(ms(30_000), 5), waiting_time(ms(4000), 5), waiting_time(ms(2000), 5)
    assert hopeless == 0, "who waits too long is more likely to miss the deadline"
    assert 0 < tight < relaxed <= Timing().schedule.wait_max, "who waits too little coordinates too few"
    assert tight <= ms(1000) // 4
    assert waiting_time(ms(30_000), 0) == 0, "nobody else can come"


def test_iv_c_slots_are_given_only_after_n() -> None:
    model = Model(1, 6)
    log = sent(model)
    model.trigger(0, 1, deadline=ms(30_000))
    model.run(ms(2500))
    schedules = [(at, m) for at, _, m in log if isinstance(m, Sched)]
    began = schedules[0][0]
    slotted = next(at for at, m in schedules if m.entries[0].start is not None)
    assert schedules[0][1].entries[0].start is None
    assert slotted - began > 100 * MS


def test_iv_c_the_list_is_updated_when_a_robot_joins() -> None:
    model = Model(1, 3)
    model.trigger(0, 1, deadline=ms(30_000))
    model.trigger(ms(1200), 2, deadline=ms(31_000))
    model.run(ms(2500))
    changes = [event for _, event in model.minds[1].log if isinstance(event, events.ScheduleChanged)]
    assert [change.order for change in changes] == [(1,), (1, 2)]


def test_iv_c_the_list_is_kept_by_deadline() -> None:
    model = Model(3, 6)
    order = [4, 2, 6, 1, 5, 3]
    for place, robot in enumerate(order):
        model.trigger(ms(robot), robot, deadline=ms(15_000 + 3000 * place))
    assert model.run_until(lambda: model.now > ms(50) and model.all_served(), ms(60_000))
    assert model.order() == order
    assert model.violations == []


def test_iv_c_more_robots_meet_their_deadlines_than_by_deadline_alone() -> None:
    """Opposed jobs: the one whose deadline is first would by itself make two others late."""
    model = Model(2, 3)
    model.trigger(0, 1, deadline=ms(7000), release=ms(3500), duration=ms(3000), direction=0)
    model.trigger(ms(1), 2, deadline=ms(7100), duration=ms(3000), direction=1)
    model.trigger(ms(2), 3, deadline=ms(7200), duration=ms(3000), direction=1)
    assert model.run_until(lambda: model.now > ms(50) and model.all_served(), ms(60_000))
    met = [entry.robot for entry in model.entries if entry.end <= model_deadline(entry.robot)]
    assert met == [2, 3]
    assert model.violations == []


def model_deadline(robot: int) -> int:
    """Return the deadlines of the test above."""
    return ms({1: 7000, 2: 7100, 3: 7200}[robot])
