"""The radio and the body of a robot process, over a bus that the test plays."""

from random import Random

import pytest

from rmr.base.geometry import STILL, Twist
from rmr.base.time import NS_PER_MS
from rmr.bus import wire
from rmr.node.actions.handle import ActionFailed
from rmr.node.ports import SeenBody
from rmr.radio.air import Announcement
from rmr.radio.frame import BROADCAST, DataFrame, encode_data
from rmr.radio.phy import airtime
from rmr.radio.station import Station
from rmr_agent.bus_ports import AHEAD_MAX, FRAMES_MAX, RADIO_GRACE, SAMPLES_MAX, BusBody, RadioLink, WorldActions

MS = NS_PER_MS


class Ether:
    """Two robots' links whose announcements reach the other `late` ns after they were made."""

    def __init__(self, late):
        self.now, self.late, self.under_way = 0, late, []
        self.links = {}
        for address in (1, 2):
            station = Station(address, 7, 1, Random(address), grace=RADIO_GRACE)
            self.links[address] = RadioLink(
                station, lambda: self.now, lambda out, who=address: self.send(who, wire.Air(out))
            )

    def send(self, who, body):
        self.under_way.append((self.now + self.late, who, body))

    def run(self, duration):
        end = self.now + duration
        while self.now < end:
            self.now += MS // 4
            for at, who, body in [item for item in self.under_way if item[0] <= self.now]:
                self.under_way.remove((at, who, body))
                self.links[3 - who].hear(wire.decode(wire.encode(who, 1, 1, body)).body.announcement)
            for address, link in self.links.items():
                link.advance(self.now, float(address), 0.0)


def test_a_unicast_whose_announcement_is_2_ms_late_arrives_and_is_confirmed():
    ether = Ether(late=2 * MS)
    ether.links[1].transmit(b"\x20hello", 2, 17)
    ether.run(60 * MS)
    received = ether.links[2].receive()
    assert [(frame.payload, frame.source, frame.unicast) for frame in received] == [(b"\x20hello", 1, True)]
    assert [tuple(done) for done in ether.links[1].confirmations()] == [(17, "ok")]
    assert not ether.links[1].waiting
    assert not ether.links[2].waiting


def test_overheard_frame_is_not_delayed_unless_an_earlier_frame_is():
    ether = Ether(late=0)
    link = ether.links[2]
    link.overhear = lambda _now, frame: frame.payload != b"call"
    for handle, payload in enumerate((b"first", b"call", b"after"), 1):
        ether.links[1].transmit(payload, None, handle)
        ether.run(20 * MS)
    assert [frame.payload for frame in link.receive()] == [b"call", b"after"]


def test_future_frame_of_another_run_is_never_received():
    for ahead, count in ((AHEAD_MAX, 1), (AHEAD_MAX + 1, 0)):
        ether = Ether(late=0)
        psdu = encode_data(DataFrame(7, BROADCAST, 9, 0, False, b"ghost"))
        ghost = Announcement(9, 0, 0, ahead, ahead + airtime(len(psdu)), 0.0, 3.0, 0.0, psdu)
        ether.links[1].hear(ghost)
        ether.run(AHEAD_MAX + 20 * MS)
        assert (len(ether.links[1].receive()), ether.links[1].malformed) == (count, 1 - count)


def test_queue_of_unfetched_frames_is_bounded():
    ether = Ether(late=0)
    ether.links[1]._received.extend([None] * (FRAMES_MAX + 5))
    assert len(ether.links[1].receive()) == FRAMES_MAX


def sample(stamp, bodies=()):
    return wire.Sense(stamp, 0.1, 0.2, 0.0, 1.0, ((0, 1.5),), bodies, False, (0.4, 0.6, 1.0))


def test_a_sample_reaches_the_node_as_it_was_sensed():
    body = BusBody(lambda message: None)
    assert body.place is None
    body.feed(sample(5, ((0.1, 0.2, 0.3, 0.4),)))
    (sensed,) = body.sense()
    assert (sensed.stamp, sensed.left_m, sensed.right_m, sensed.ranges) == (5, 0.1, 0.2, ((0, 1.5),))
    assert sensed.bodies == (SeenBody(0.1, 0.2, 0.3, 0.4),)
    assert sensed.bodies[0].vy == 0.4
    assert (body.place, body.waiting, body.sense()) == ((0.4, 0.6), False, [])


def test_before_the_start_only_the_newest_sample_is_kept_and_later_ones_are_bounded():
    body = BusBody(lambda message: None)
    for stamp in range(3):
        body.feed(sample(stamp))
        body.keep_newest()
    assert [sensed.stamp for sensed in body.sense()] == [2]
    for stamp in range(SAMPLES_MAX + 9):
        body.feed(sample(stamp))
    assert len(body.sense()) == SAMPLES_MAX


def test_a_wheel_command_leaves_with_its_instant():
    sent = []
    body = BusBody(sent.append)
    assert body.twist == STILL
    body.act(Twist(0.2, -1.0), 99)
    assert sent == [wire.Act(0.2, -1.0, 99)]
    assert body.twist == Twist(0.2, -1.0)


def test_an_action_of_the_world_is_asked_for_twice_a_second_until_its_end_is_told():
    now, said = [5], []
    actions = WorldActions(said.append, lambda: now[0])
    run = actions.handlers(["grip"])["grip"].run
    first, second = run(None, 0.5).__await__(), run(None, 0.7).__await__()
    pause, other = next(first), next(second)
    assert said == [wire.Perform(1, "grip", (0.5,), 5), wire.Perform(2, "grip", (0.7,), 5)]
    assert not pause.over(now[0])
    now[0] = 500 * MS + 5
    assert pause.over(now[0])
    pause = next(first)
    assert said[2:] == [wire.Perform(1, "grip", (0.5,), 5)], "it says when it began"
    actions.heard(wire.Performed(1, ""))
    assert pause.over(now[0])
    actions.heard(wire.Performed(2, "jammed"))
    assert other.over(now[0])
    with pytest.raises(StopIteration):
        next(first)
    with pytest.raises(ActionFailed, match="jammed"):
        next(second)
    actions.heard(wire.Performed(1, "late"))
    assert len(said) == 3


def test_an_action_of_the_world_that_is_broken_off_is_taken_back():
    said = []
    actions = WorldActions(said.append, lambda: 5)
    begun = actions.handlers(["grip"])["grip"].run(None).__await__()
    next(begun)
    begun.close()
    assert said == [wire.Perform(1, "grip", (), 5), wire.Perform(1, None, (), 5)]
