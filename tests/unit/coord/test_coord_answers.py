"""Several robots answer one broadcast: each answer comes at its own time, and stays away when another will do."""

from collections.abc import Callable
from itertools import pairwise
from random import Random

import pytest
from coord_harness import EVENT, Model, ms

from rmr.coord.coordination import Coordination, JobRequest
from rmr.coord.events import Send
from rmr.coord.messages import Beacon, Entry, Job, Message, Phase, Sched, decode, encode
from rmr.coord.states import Role
from rmr.coord.term import NOBODY, Term
from rmr.coord.timing import Timing

pytestmark = pytest.mark.medium

PEERS = 49
PER_ANSWER = 5.0
"""Milliseconds."""
NOW = ms(10_000)
LEADER = 900
TERM = Term(7, LEADER)
OTHER = Term(6, 800)


def entry(robot: int, phase: Phase = Phase.WAITING, start: int | None = ms(30_000), direction: int = 0) -> Entry:
    return Entry(robot, ms(1000), start, ms(3000), direction, phase)


def sched(
    *entries: Entry, term: Term = TERM, issued: int = NOW, opens: int = 0, part: int = 0, parts: int = 1
) -> Sched:
    return Sched(EVENT, issued, term, False, NOBODY, opens, 0, part, parts, entries)


def question(asked: int = NOW, time: int = NOW) -> Job:
    return Job(EVENT, time, Term(0, NOBODY), asked, ms(900), 0, ms(3000), ms(60_000), ms(950), 0, None)


class Robot:
    """One core among `PEERS` others, and what it sends."""

    def __init__(self, seed: int = 0, robot: int = 1) -> None:
        self.core = Coordination(robot, Random(f"answers/{seed}"), PEERS)
        self.now = NOW
        self.sent: list[tuple[int, Message, int | None]] = []
        self.handles: list[int] = []

    def job(self, trigger: int = ms(1000)) -> "Robot":
        self.core.trigger(self.now, JobRequest(EVENT, trigger, trigger, ms(3000), ms(90_000), ms(950), 0))
        return self.run(self.now)

    def hear(self, message: Message, source: int = LEADER) -> "Robot":
        self.core.receive(self.now, encode(message), source)
        return self.run(self.now)

    def run(self, until: int) -> "Robot":
        while True:
            for item in self.core.drain():
                if isinstance(item, Send):
                    self.sent.append((item.at, decode(item.payload), item.destination))
                    self.handles.append(item.handle)
            if self.core.next_wake > until:
                self.now = until
                return self
            self.now = max(self.now, self.core.next_wake)
            self.core.wake(self.now)

    def first(self, kind: type, since: int) -> float:
        """Return how long after `since` the first frame of `kind` left, milliseconds."""
        return min(at - since for at, message, _ in self.sent if isinstance(message, kind) and at >= since) / ms(1)

    def follower(self, *, listed: bool = True) -> "Robot":
        """Make it a follower that the leader lists, or does not."""
        self.hear(sched(entry(2), issued=NOW - ms(10))).job()
        return self.hear(sched(entry(1) if listed else entry(2), issued=NOW - ms(5)))


def joins(robot: Robot) -> float:
    robot.job()
    return robot.hear(sched(entry(2, start=None), opens=ms(500))).run(NOW + ms(1000)).first(Job, NOW)


def joins_on_its_trigger(robot: Robot) -> float:
    robot.hear(sched(entry(2)))
    return robot.job().run(NOW + ms(1000)).first(Job, NOW)


def relays_while_jobs_are_gathered(robot: Robot) -> float:
    robot.hear(sched(entry(1, start=None), opens=ms(500), issued=NOW - ms(5))).job()
    return robot.hear(question(), source=5).run(NOW + ms(800)).first(Sched, NOW)


def contradicts_a_worse_leader(robot: Robot) -> float:
    robot.hear(sched(entry(1, start=None), opens=ms(500), issued=NOW - ms(5))).job()
    return robot.hear(sched(entry(3), term=OTHER), source=800).run(NOW + ms(800)).first(Sched, NOW)


def tells_an_earlier_asker(robot: Robot) -> float:
    robot.job().hear(question(asked=NOW - ms(1)), source=5).run(NOW + ms(1000))
    (told,) = [at for at, message, to in robot.sent if isinstance(message, Job) and to == 5]
    return (told - NOW) / ms(1)


def asks_after_yielding(robot: Robot) -> float:
    robot.job().hear(question(asked=NOW - ms(1)), source=5).run(NOW + ms(1000))
    return min(at - NOW for at, message, to in robot.sent if isinstance(message, Job) and to is None) / ms(1)


def repeats_a_listed_job(robot: Robot) -> float:
    robot.follower()
    core = robot.core
    for k in range(1, 30):
        robot.run(NOW + ms(100 * k))
        core.receive(robot.now, encode(sched(entry(1), issued=NOW + ms(100 * k))), LEADER)
    return robot.first(Job, NOW + ms(1000))


def witnesses(robot: Robot) -> float:
    inside = Beacon(EVENT, NOW - ms(1000), TERM, 3, ms(1000), Phase.IN, 1, NOW - ms(1000), NOW + ms(9000))
    claim = Beacon(EVENT, NOW, TERM, 4, ms(1000), Phase.CLAIM, 0, NOW + ms(500), NOW + ms(3500))
    robot.core.receive(NOW - ms(1000), encode(inside), 3)
    return robot.hear(claim, source=4).run(NOW + ms(800)).first(Beacon, NOW)


def asks_for_a_leader_that_never_listed_it(robot: Robot) -> float:
    robot.follower(listed=False)
    return min(
        (at - NOW) / ms(1)
        for at, message, _ in robot.run(NOW + ms(4000)).sent
        if isinstance(message, Job) and message.term.leader == NOBODY
    )


@pytest.mark.parametrize(
    "answer",
    [
        joins,
        joins_on_its_trigger,
        relays_while_jobs_are_gathered,
        contradicts_a_worse_leader,
        tells_an_earlier_asker,
        asks_after_yielding,
        repeats_a_listed_job,
        witnesses,
        asks_for_a_leader_that_never_listed_it,
    ],
)
def test_answers_are_spread_over_5_ms_per_member(answer: Callable[[Robot], float]) -> None:
    times = sorted(answer(Robot(seed)) for seed in range(100))
    tenth, ninety = times[10], times[90]
    assert ninety - tenth >= 0.7 * PER_ANSWER * PEERS
    assert times[-1] - times[0] <= 1.4 * PER_ANSWER * PEERS


def test_relay_jitter_grows_with_the_number_of_followers() -> None:
    def relays(seed: int) -> float:
        robot = Robot(seed).follower()
        return robot.hear(question(), source=5).run(NOW + ms(800)).first(Sched, NOW)

    assert max(map(relays, range(50))) <= 20 + 6 + 8


def test_finished_job_reminder_jitter_grows_with_the_listed_robots() -> None:
    def reminds(seed: int) -> float:
        robot = Robot(seed).follower()
        robot.core.withdraw(NOW, EVENT)
        later = NOW + ms(1000)
        robot.run(later).hear(sched(*(entry(r) for r in range(1, 11)), issued=later))
        return robot.run(later + ms(500)).first(Beacon, later)

    times = sorted(map(reminds, range(100)))
    assert times[90] - times[10] >= 0.7 * PER_ANSWER * 10


def test_relay_is_suppressed_when_another_member_relayed_the_same_schedule() -> None:
    robot = Robot().follower()
    robot.hear(question(), source=5)
    robot.hear(sched(entry(1), issued=NOW - ms(5)), source=6).run(NOW + ms(800))
    assert not [message for _, message, _ in robot.sent if isinstance(message, Sched)]


def test_relay_is_not_suppressed_by_an_older_schedule() -> None:
    robot = Robot().follower()
    robot.hear(question(), source=5)
    robot.hear(sched(entry(1), issued=NOW - ms(200)), source=6).run(NOW + ms(800))
    assert [message for _, message, _ in robot.sent if isinstance(message, Sched)]


def test_of_two_candidates_in_one_millisecond_one_continues_its_election() -> None:
    one, two = Robot(robot=1), Robot(robot=2)
    moment = NOW + ms(60)
    for robot in (one, two):
        robot.job()
    questions = {}
    for robot, offset in ((one, 300_000), (two, 700_000)):
        context = robot.core._groups[EVENT].context
        context.asked, context.asks = None, 0
        robot.now = moment
        context.set(2, moment + offset)
        robot.core._settle()
        robot.run(moment + ms(1))
        questions[robot.core.robot] = next(m for _, m, _ in reversed(robot.sent) if isinstance(m, Job))
    one.hear(questions[2], source=2)
    two.hear(questions[1], source=1)
    assert [robot.core._groups[EVENT].context.asks for robot in (one, two)] == [1, 0]


def leads_when_all_have_asked(*, earlier: int | None = None, silent: int | None = None) -> bool:
    """Return whether a robot that has asked leads as soon as the others have, but for one that is `silent`."""
    robot = Robot().job().run(NOW + ms(310))
    context = robot.core._groups[EVENT].context
    assert context.asks > 0
    assert context.role is Role.CANDIDATE
    for source in range(2, PEERS + 2):
        if source != silent:
            robot.hear(question(NOW - ms(1) if source == earlier else robot.now, robot.now), source)
    return context.role is Role.LEADING


def test_candidate_that_heard_all_others_leads_at_once() -> None:
    assert leads_when_all_have_asked()


def test_candidate_continues_its_election_while_one_member_is_unheard() -> None:
    assert not leads_when_all_have_asked(silent=17)


def test_candidate_that_defers_to_an_earlier_one_does_not_lead() -> None:
    assert not leads_when_all_have_asked(earlier=2)
    assert not leads_when_all_have_asked(earlier=PEERS + 1)


def told(robot: Robot, to: int) -> list[int]:
    """Return when `robot` told `to` its job."""
    return [at for at, message, destination in robot.sent if isinstance(message, Job) and destination == to]


def test_election_question_heard_before_the_own_job_is_not_answered_with_the_job() -> None:
    robot = Robot().hear(question(asked=NOW - ms(9)), source=5)
    robot.now = NOW + ms(100)
    robot.job().run(NOW + ms(500))
    assert told(robot, 5) == []
    assert [to for _, message, to in robot.sent if isinstance(message, Job)][:2] == [None, None]


def test_follower_that_received_part_of_a_schedule_sends_its_job_to_the_new_leader() -> None:
    robot = Robot().job()
    robot.hear(sched(*(entry(r) for r in range(10, 20)), part=2, parts=5)).run(NOW + ms(400))
    assert joined(robot) > 0


def outcome(robot: Robot, status: str) -> Robot:
    """Tell `robot` what became of its last unicast."""
    robot.core.confirmed(robot.now, robot.handles[-1], status)
    return robot


def joined(robot: Robot) -> int:
    """Return how many JOBs it has sent to the leader."""
    return sum(isinstance(message, Job) and to == LEADER for _, message, to in robot.sent)


def sent_first_join() -> Robot:
    robot = Robot().job().hear(sched(entry(2)))
    while not joined(robot):
        robot.run(robot.now + ms(1))
    return robot


def test_a_job_that_has_arrived_is_not_repeated_before_the_next_schedule_is_due() -> None:
    robot = outcome(sent_first_join(), "ok")
    sent = robot.now
    robot.run(sent + Timing().schedule.repetition - ms(1))
    assert joined(robot) == 1
    assert joined(robot.run(sent + 2 * Timing().schedule.repetition)) == 2, "it is still not listed"


@pytest.mark.parametrize("status", ["no_ack", "access_failure"])
def test_a_job_that_has_not_arrived_is_repeated_with_back_off(status: str) -> None:
    robot = sent_first_join()
    times = [robot.now]
    for _ in range(2):
        before = joined(outcome(robot, status))
        while joined(robot) == before:
            robot.run(robot.now + ms(1))
        times.append(robot.now)
    gaps = [(b - a) / ms(1) for a, b in pairwise(times)]
    assert 90 <= gaps[0] <= 160
    assert 90 <= gaps[1] <= 310


def test_unacknowledged_update_of_a_listed_job_is_repeated_with_back_off() -> None:
    robot = Robot().follower()
    robot.core.revise(robot.now, EVENT, release=ms(20_000))
    while not joined(robot):
        robot.run(robot.now + ms(1))
    lost = outcome(robot, "access_failure").now
    assert joined(robot.run(lost + ms(160))) == 2


def parts_sent(model: Model) -> dict[int, set[int]]:
    """Return, by issue, which parts of schedules with slots `model` will have sent."""
    issues: dict[int, set[int]] = {}

    def watch(source: int, target: int, payload: bytes, now: int) -> bool:
        message = decode(payload)
        if isinstance(message, Sched) and not message.opens:
            issues.setdefault(message.issued, set()).add(message.part)
        return True

    model.air.filter = watch
    return issues


def test_the_first_slots_of_many_are_sent_whole_and_then_in_turn() -> None:
    model = Model(3, 30)
    issues = parts_sent(model)
    for robot in model.ids:
        model.trigger(ms(robot % 20), robot, deadline=ms(60_000 + 4000 * robot), release=ms(30_000))
    model.run(ms(3000))
    parts = [issues[at] for at in sorted(issues)]
    news = max(index for index, some in enumerate(parts) if len(some) == 3)
    assert [len(some) for some in parts[news + 1 :]] == [1] * len(parts[news + 1 :])
    assert set().union(*parts[news + 1 :][:3]) == {0, 1, 2}


def test_schedule_traffic_grows_with_passing_robots_and_not_with_waiting_ones() -> None:
    model = Model(3, 60)
    issues = parts_sent(model)
    for robot in model.ids:
        model.trigger(ms(robot % 20), robot, deadline=ms(60_000 + 4000 * robot), release=ms(2000))
    model.run(ms(4000))
    before = set(issues)
    model.run(ms(14_000))
    sent = [len(parts) for at, parts in issues.items() if at not in before]
    assert len(model.entries) > 5
    assert sum(sent) / len(sent) < 4, "of seven parts"


def test_a_leader_that_takes_over_gives_slots_when_all_members_have_joined_again() -> None:
    model = Model(3, 8)
    for robot in model.ids:
        model.trigger(ms(robot), robot, deadline=ms(60_000 + 4000 * robot), release=ms(20_000))
    model.run(ms(3000))
    (leader,) = model.leaders()
    model.crash(model.now, leader)
    model.run(model.now + ms(100))
    assert model.run_until(lambda: model.leaders() != [], ms(9000))
    (heir,) = model.leaders()
    ledger = model.minds[heir].core._groups[EVENT].context.ledger
    assert ledger is not None
    assert not ledger.open
    assert model.run_until(lambda: ledger.open, ms(9000))
    assert [line.robot for line in ledger.bookings.values() if line.provisional] == [leader]
