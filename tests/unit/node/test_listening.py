"""A robot that begins listens for longer than 10 s if another robot hears one that it has never heard itself."""

from pathlib import Path

import pytest

from rmr.base.geometry import Twist
from rmr.base.time import Instant, seconds
from rmr.node.config import LISTEN_FOR_ALL, NodeConfig
from rmr.node.driver import Driver
from rmr.node.motion.hearing import DEAD
from rmr.node.payloads import Hello
from rmr.node.peers.link_sensing import CUT_OFF_MAX, LinkSensing
from rmr.node.peers.perception import Peers
from rmr.node.ports import Sensed
from rmr_world.lab_file import load_lab

LAB = Path(__file__).parents[3] / "deploy" / "labs" / "testbed"
ROSTER = (1, 2, 3)
FOR_EVER = seconds(90)


class NoBody:
    def sense(self) -> list[Sensed]:
        return []

    def act(self, twist: Twist, stamp: Instant) -> None:
        raise AssertionError("it does not know where it is")


def listens_until(listed_until: Instant) -> Instant:
    """Return until when robot 1 listens, to the second; it hears robot 2, which lists robot 3 up to an instant."""
    driver = Driver(NodeConfig(1, ROSTER, load_lab(LAB).arena, 7), NoBody())
    peers = Peers(LinkSensing(1, ROSTER))
    for now in range(0, FOR_EVER, seconds(1)):
        driver.step(now, lambda: 0, peers)
        peers.heard(now, 2, -50.0)
        listed = LinkSensing(2, ROSTER).list_of({1: now, 3: now} if now <= listed_until else {1: now}, now)
        peers.hello(now, 2, Hello(0.5, 0.5, 0.0, 0.0, True, 0, None, listed=listed))
        if not driver.listens(now, peers):
            return now
    return FOR_EVER


@pytest.mark.parametrize(
    ("listed_until", "until"),
    [(-1, LISTEN_FOR_ALL), (seconds(8), seconds(8) + DEAD + seconds(1)), (FOR_EVER, CUT_OFF_MAX + seconds(1))],
    ids=["nobody hears it", "another robot heard it for 8 s", "another robot hears it for ever"],
)
def test_a_robot_listens_while_others_hear_one_that_it_misses(listed_until: Instant, until: Instant) -> None:
    assert listens_until(listed_until) == until
