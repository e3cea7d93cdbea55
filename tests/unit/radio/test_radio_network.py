"""Stations of mode network: everybody is heard, unicasts are known to have come, and all queues have a bound."""

from math import inf
from random import Random

from rmr.base.kernel import Kernel
from rmr.radio.air import Announcement, Confirmed, Received
from rmr.radio.links import Disturbance
from rmr.radio.mac import QUEUE_MAX
from rmr.radio.network import ACK_WAIT, LATENCY, TAKEN_MAX, Network, NetworkStation
from rmr.radio.phy import NETWORK, RadioConfig

PAN = 7
CONFIG = RadioConfig(mode=NETWORK)


class Fleet:
    """Robots 1, 2, ... , a kilometre from each other, with what each has taken."""

    def __init__(self, count=3):
        self.kernel = Kernel()
        self.network = Network(self.kernel, CONFIG, 5, PAN)
        self.taken = {robot: [] for robot in range(1, count + 1)}
        self.stations = {
            robot: self.network.add(robot, Random(robot), taken.append, 1000.0 * robot, 0.0)
            for robot, taken in self.taken.items()
        }

    def payloads(self, robot):
        return [each.payload for each in self.taken[robot] if isinstance(each, Received)]

    def outcomes(self, robot):
        return [tuple(each) for each in self.taken[robot] if isinstance(each, Confirmed)]


def test_a_broadcast_comes_to_all_however_far_and_takes_no_time_on_the_air():
    fleet = Fleet()
    heard = []
    fleet.network.on_air = heard.append
    fleet.stations[1].request(b"x" * 116, None, 1)
    fleet.kernel.run_until(LATENCY)
    assert fleet.payloads(2) == fleet.payloads(3) == [b"x" * 116]
    assert fleet.outcomes(1) == [(1, "ok")]
    assert [each.end - each.start for each in heard] == [0]
    assert Announcement.from_wire(tuple(heard[0])) == heard[0]


def test_a_unicast_is_confirmed_when_it_has_come_and_requests_do_not_wait_for_each_other():
    fleet = Fleet()
    fleet.stations[3].switch_off()
    fleet.stations[1].request(b"to nobody", 3, 1)
    fleet.stations[1].request(b"to two", 2, 2)
    fleet.kernel.run_until(2 * LATENCY)
    assert fleet.payloads(2) == [b"to two"]
    assert fleet.outcomes(1) == [(2, "ok")]
    fleet.kernel.run_until(5 * ACK_WAIT)
    assert fleet.outcomes(1) == [(2, "ok"), (1, "no_ack")]
    assert fleet.stations[1].counters.sent == 1 + 4


def test_a_frame_whose_acknowledgement_is_lost_is_handed_on_once():
    fleet = Fleet(2)
    back = Disturbance(until=ACK_WAIT // 2, groups=((2,), (1,)), one_way=True, attenuation_db=inf)
    fleet.network.links.replace([back])
    fleet.stations[1].request(b"once", 2, 1)
    fleet.kernel.run_until(3 * ACK_WAIT)
    assert fleet.payloads(2) == [b"once"]
    assert fleet.outcomes(1) == [(1, "ok")]
    assert fleet.stations[2].counters.duplicates == 1


def test_a_cut_link_and_a_loss_take_frames():
    fleet = Fleet(3)
    fleet.network.links.replace([Disturbance(groups=((1,), (2,)), attenuation_db=inf)])
    fleet.stations[1].request(b"x", None, 1)
    fleet.kernel.run_until(LATENCY)
    assert (fleet.payloads(2), fleet.payloads(3)) == ([], [b"x"])
    fleet.network.links.replace([Disturbance(loss=0.5)])
    for handle in range(60):
        fleet.stations[1].request(bytes((handle,)), None, handle)
        fleet.kernel.run_until(fleet.kernel.now + LATENCY)
    assert 15 < len(fleet.payloads(2)) < 45


def test_a_station_has_no_more_than_a_bounded_number_of_requests_and_of_frames_that_wait():
    fleet = Fleet(2)
    fleet.stations[2].switch_off()
    for handle in range(QUEUE_MAX + 3):
        fleet.stations[1].request(b"x", 2, handle)
    fleet.kernel.run_until(0)
    assert fleet.outcomes(1) == [(QUEUE_MAX + more, "access_failure") for more in range(3)]
    station = NetworkStation(9, PAN, 5, Random(1), CONFIG)
    sender = NetworkStation(8, PAN, 5, Random(2), CONFIG)
    for turn in range(TAKEN_MAX + 5):
        sender.request(turn, b"x", 9, turn)
        [sent] = [out for out in sender.advance(turn, 0.0, 0.0) if isinstance(out, Announcement)][-1:] or [None]
        sender._pending.clear()
        station.hear(sent, turn)
    out = station.advance(TAKEN_MAX + 5, 0.0, 0.0)
    assert sum(isinstance(each, Received) for each in out) == TAKEN_MAX
    assert station.counters.dropped == 5


def test_a_stopped_process_takes_what_has_come_when_it_goes_on():
    fleet = Fleet(2)
    fleet.stations[2].hold()
    fleet.stations[1].request(b"x", 2, 1)
    fleet.kernel.run_until(2 * ACK_WAIT)
    assert fleet.taken[2] == []
    fleet.stations[2].resume(fleet.kernel.now)
    fleet.kernel.run_until(4 * ACK_WAIT)
    assert fleet.payloads(2) == [b"x"]
    assert fleet.outcomes(1) == [(1, "ok")]
