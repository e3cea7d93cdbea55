"""What those who pass say is taken in without a call by whoever has nothing to do with it, and only by those."""

from collections.abc import Callable
from random import Random

import pytest
from coord_harness import EVENT, ms

from rmr.coord.coordination import Coordination, JobRequest
from rmr.coord.messages import Beacon, Job, Message, Phase, encode
from rmr.coord.states import Passage
from rmr.coord.term import Term

LED = Term(1, 2)


def beacon(phase: Phase, who: int = 3) -> Beacon:
    """Return what robot 3, or `who`, says at 5 s."""
    return Beacon(EVENT, ms(5000), LED, who, 0, phase, 0, ms(4500), ms(7500))


def core() -> Coordination:
    """Return a core that knows the event, as one does that has heard somebody pass."""
    made = Coordination(1, Random(1), 5)
    made.receive(ms(4900), encode(beacon(Phase.IN)._replace(time=ms(4900))), 3)
    return made


def waits(made: Coordination) -> None:
    made.trigger(ms(4950), JobRequest(EVENT, ms(4950), ms(9000), ms(3000), ms(60_000), ms(1000), 0))


def leads(made: Coordination) -> None:
    waits(made)
    now = ms(4950)
    while not any("Leadership" in type(news).__name__ for news in made.drain()):
        now = max(now + 1, made.next_wake)
        made.wake(now)


@pytest.mark.parametrize("phase", [Phase.IN, Phase.OUT, Phase.YIELD])
@pytest.mark.parametrize("state", [lambda _: None, waits])
def test_overheard_beacon_updates_the_fence_and_leaves_the_next_wake(
    phase: Phase, state: Callable[[Coordination], None]
) -> None:
    overhears, is_called = core(), core()
    for made in (overhears, is_called):
        state(made)
        made.drain()
    wake = overhears.next_wake
    assert overhears.overhear(ms(5000), encode(beacon(phase)))
    is_called.receive(ms(5000), encode(beacon(phase)), 3)
    known = [made._groups[EVENT].context.fence.records for made in (overhears, is_called)]
    assert {who: record.beacon for who, record in known[0].items()} == {
        who: record.beacon for who, record in known[1].items()
    }
    assert not overhears.has_news
    assert overhears.next_wake == wake == is_called.next_wake


def test_leader_overhears_no_beacon_and_is_called_instead() -> None:
    made = core()
    leads(made)
    assert not made.overhear(ms(9000), encode(beacon(Phase.OUT)))


def test_robot_in_passage_overhears_no_beacon_and_is_called_instead() -> None:
    made = core()
    waits(made)
    made._groups[EVENT].context.passage = Passage.CLAIMING
    assert not made.overhear(ms(5000), encode(beacon(Phase.IN)))


@pytest.mark.parametrize(
    "message",
    [
        beacon(Phase.CLAIM),
        Job(EVENT, ms(5000), LED, 0, 0, ms(9000), ms(3000), ms(60_000), ms(1000), 0, None),
        beacon(Phase.IN)._replace(group_id=b"other!"),
        beacon(Phase.IN)._replace(time=ms(6000)),
    ],
)
def test_claims_jobs_and_unknown_frames_are_not_overheard(message: Message) -> None:
    assert not core().overhear(ms(5000), encode(message))


def test_octets_that_are_no_frame_are_not_overheard() -> None:
    frame = encode(beacon(Phase.IN))
    assert not any(core().overhear(ms(5000), octets) for octets in (b"", frame[:-1], frame[:1], b"\x00"))
