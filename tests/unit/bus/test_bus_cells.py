"""Robots that listen by cells, over real sessions: what matters arrives, once, and nothing counts as lost.

The sessions are those of robots (clients of one router, in this process); announcements come from a station's medium
access and go to a station. Lab time is the test's own. A robot's mark follows its announcement, and what one session
publishes comes in order: who has the mark has all before it that he gets.
"""

import math
from itertools import count
from random import Random

import pytest
from bus_star import on_a_star, until

from rmr.base.time import NS_PER_MS
from rmr.bus import wire
from rmr.bus.keys import Keys
from rmr.radio.cells import Grid, grid_of, interference_range_m
from rmr.radio.phy import RadioConfig
from rmr.radio.station import Station
from rmr_agent.bus_ports import RADIO_GRACE, RadioLink
from rmr_agent.local_air import LocalAir

MS = NS_PER_MS
KEYS = Keys("x")
MARKS = KEYS.load(0)
"""Where a sender may say as much as these tests, whose time is faster than a robot's."""
CONFIG = RadioConfig(tx_power_dbm=-30.0, exponent=8.0)
"""A frame disturbs up to 2.3 m away."""
RANGE_M = interference_range_m(CONFIG)
GRID = grid_of(CONFIG, speed_mps=0.2)
W = GRID.width_m
STEP_M = 0.05
TALK_M = 1.0
"""So near that every frame is received: 6 dB above the noise."""

marks = count(1)


class Robot:
    """A robot's radio over its session."""

    def __init__(self, bus, address, place, grid=GRID):
        self.bus, self.address, self.now = bus, address, 0
        self.air = LocalAir(bus, KEYS, grid, self._hear, address)
        station = Station(address, 7, 1, Random(address), CONFIG, RADIO_GRACE)
        self.link = RadioLink(station, lambda: self.now, self.air.publish)
        self.sent, self.heard, self.received, self.mark = [], [], [], 0
        bus.subscribe(MARKS, self._on_mark)
        self.move(*place)

    def _hear(self, _key, message):
        announcement = message.body.announcement
        self.heard.append((announcement[0], announcement[1]))
        self.link.hear(announcement)
        self.advance(announcement[4] + 2 * RADIO_GRACE)
        self.received += [int(frame.payload) for frame in self.link.receive()]

    def _on_mark(self, _key, message):
        self.mark = max(self.mark, message.body.stamp)  # an older one of another robot may come later

    def advance(self, until_ns):
        while self.now < until_ns:
            self.now += MS
            self.link.advance(self.now, *self.place)

    def move(self, x, y):
        self.place = x, y
        self.link.station.move(x, y)
        self.air.move(x, y)

    def say(self):
        """Broadcast the number of the frame; return it."""
        number = len(self.sent)
        self.sent.append(self.place)
        self.link.transmit(str(number).encode(), None, number)
        self.advance(self.now + 20 * MS)
        return number

    async def tell(self, *others):
        """Wait until all `others` have what this robot has published until now, or will never have it."""
        mark = next(marks)
        self.bus.publish(MARKS, wire.Clock("running", 0, mark))
        await until(lambda: all(other.mark == mark for other in others))


async def met(*robots):
    """Wait until each robot hears the marks of all others."""
    for robot in robots:
        others = [other for other in robots if other is not robot]
        before = [other.mark for other in others]

        def heard(robot=robot, others=others, before=before):
            robot.bus.publish(MARKS, wire.Clock("running", 0, next(marks)))
            return all(other.mark > mark for other, mark in zip(others, before, strict=True))

        await until(heard)


def line(start, end):
    """Return places from start to end, `STEP_M` apart."""
    steps = math.ceil(math.dist(start, end) / STEP_M)
    return [tuple(a + (b - a) * step / steps for a, b in zip(start, end, strict=True)) for step in range(steps + 1)]


def test_sender_crossing_cell_borders_is_received_exactly_once_by_a_standing_receiver():
    async def scene(_router, one, two):
        walker = Robot(one, 1, (W - 0.3, W - 0.3))
        stander = Robot(two, 2, (W + 0.05, W + 0.05))
        await met(walker, stander)
        corners = [(W - 0.3, W - 0.3), (W + 0.3, W - 0.3), (W + 0.3, W + 0.3), (W, W + 0.3), (W, W - 0.3), (W - 0.3, W)]
        for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
            for place in line(start, end):
                walker.move(*place)
                walker.say()
        await walker.tell(stander)
        assert len({GRID.cell_of(*place) for place in walker.sent}) == 4
        assert max(math.dist(place, stander.place) for place in walker.sent) < TALK_M
        assert stander.received == list(range(len(walker.sent)))
        assert len(stander.heard) == len(set(stander.heard)) == len(walker.sent)
        assert (two.losses.lost, two.losses.repeated) == (0, 0)

    on_a_star(scene)


def listen_on_the_way(grid):
    """Return the frames that mattered and those heard of one who walks to and fro over borders.

    The sender is always as far ahead as a frame may matter. The listener's declarations are under way for a step.
    """
    found = []

    async def scene(_router, one, two):
        ahead = RANGE_M - 0.01
        listener = Robot(two, 2, (W - 0.5, 0.1), grid)
        sender = Robot(one, 1, (W - 0.5 + ahead, 0.1), grid)
        await met(sender, listener)
        for (x, y), sign in [(place, 1) for place in line((W - 0.5, 0.1), (2 * W + 0.5, W))] + [
            (place, -1) for place in line((2 * W + 0.5, W), (W - 0.5, 0.1))
        ]:
            listener.move(x, y)
            sender.move(x + sign * ahead, y)
            sender.say()
            await sender.tell(listener)
            await listener.tell(sender)
        found.extend((len(sender.sent), len(listener.heard), len(set(listener.heard)), two.losses.lost))

    on_a_star(scene)
    return found


def test_receiver_crossing_cell_borders_receives_each_relevant_frame_once():
    sent, heard, different, lost = listen_on_the_way(GRID)
    assert sent > 100
    assert (heard, different, lost) == (sent, sent, 0)


def test_cells_narrower_than_the_radio_range_lose_frames():
    sent, heard, _, _ = listen_on_the_way(Grid(0.8 * RANGE_M))
    assert 0 < heard < sent


def test_robot_outside_the_cell_ring_receives_nothing_and_moving_in_and_out_loses_nothing():
    async def scene(_router, one, two, three):
        sender, listener = Robot(one, 1, (0.5 * W, 0.5 * W)), Robot(two, 2, (0.5 * W, 0.5 * W))
        outsider = Robot(three, 3, (-2.5 * W, 0.5 * W))
        await met(sender, listener, outsider)

        async def say(times):
            for _ in range(times):
                sender.say()
            await sender.tell(listener, outsider)

        await say(5)
        assert (len(listener.heard), len(outsider.heard)) == (5, 0)
        listener.move(0.5 * W, 9.5 * W)  # leaves, while the sender goes on in the cell that it has left
        await listener.tell(sender)
        await say(5)
        listener.move(0.5 * W, 0.5 * W)
        await listener.tell(sender)
        await say(5)
        sender.move(9.5 * W, 0.5 * W)  # the sender leaves, too, and returns
        await say(5)
        sender.move(0.5 * W, 0.5 * W)
        await say(5)
        first = listener.heard[0][1]
        assert [number - first for _, number in listener.heard] == [*range(5), *range(10, 15), *range(20, 25)]
        assert (two.losses.lost, two.losses.repeated, outsider.heard) == (0, 0, [])

    on_a_star(scene, clients=3)


def test_unicast_with_acknowledgement_is_delivered_at_once_to_its_destination_only():
    async def scene(_router, one, two, three):
        sender, receiver, other = (Robot(bus, n + 1, (0.1 * n, 0.0)) for n, bus in enumerate((one, two, three)))
        called = []
        for robot in (receiver, other):
            robot.bus.subscribe(KEYS.call(robot.address), lambda key, message: called.append((key, message.body)))
        await met(sender, receiver, other)
        sender.say()
        sender.link.transmit(b"7", receiver.address, 1)
        sender.advance(sender.now + 20 * MS)
        await sender.tell(receiver, other)
        assert {(key, type(body)) for key, body in called} == {(KEYS.call(2), wire.Handshake)}
        transmissions = [body.announcement for _, body in called]
        assert [frame.attempt for frame in transmissions] == list(range(len(called))), "it is repeated: nobody answers"
        told = [(1, transmissions[0].sequence - 1), *[(1, frame.sequence) for frame in transmissions]]
        assert receiver.heard == [frame for frame in other.heard if frame[0] == 1] == told, "all hear it, once"
        assert receiver.received == [0, 7]
        assert (two.losses.lost, two.losses.repeated) == (0, 0)

    on_a_star(scene, clients=3)


def test_robot_crossing_many_cells_subscribes_to_one_ring_only():
    async def scene(_router, one):
        before = len(one._line._topics)
        crosser = Robot(one, 1, (0.0, 0.0))
        for column in range(-20, 20):
            crosser.move(column * W, -0.5 * column * W)
            crosser.say()
        air = [key for key in one._publishers if "/radio/" in key]
        assert 0 < len(air) <= 9
        assert len(one._line._topics) - before == 9 + 1  # and the marks
        crosser.air.leave()
        assert len(one._line._topics) - before == 1
        assert [key for key in one._publishers if "/radio/" in key] == []

    on_a_star(scene, clients=1)


@pytest.mark.parametrize("config", [RadioConfig(), RadioConfig(exponent=2.0)])
def test_lab_smaller_than_the_radio_range_delivers_all_frames_to_all(config):
    grid = grid_of(config, 0.2)
    cells = {grid.cell_of(x, y) for x in (0.0, 1.5, 3.0) for y in (0.0, 1.5)}
    assert len(cells) == 1
