"""Of two robots, one of which may drive and presumes the other dead, the other stands: under any pattern of losses.

Robots say hellos at random times. Links are cut and healed one by one, by partitions, and for single robots in one
direction, for any time, and in some runs half of the frames is lost beside that. Robots die, and begin anew without
memory. Nothing of a robot but its links takes part. Each part of the rule is then left out in turn: the same search
must find runs in which the statement is false.
"""

from collections.abc import Callable, Collection
from itertools import permutations
from random import Random

import pytest

from rmr.base.time import Instant, milliseconds, seconds
from rmr.node.motion.hearing import DEAD
from rmr.node.peers.link_sensing import CUT_OFF_MAX, NEVER_HEARD, LinkSensing

STEP = milliseconds(100)
STEPS = 900
CHANGE = 0.03
"""Probability of a change of the radio in one step: about one in 3 s."""
DEATH = 0.01
"""Probability that a robot dies in one step: about once in 10 s."""
DEAD_STEPS = 2, 250
"""Range of the steps for which it is dead."""
NEVER_HEARD_FOR = DEAD - seconds(10)
"""A robot that was never heard is presumed dead after 10 s of listening (`LISTEN_FOR_ALL`)."""
Link = tuple[int, int]
"""From a robot to another one."""


def cut_links(rng: Random, up: dict[Link, bool], roster: Collection[int]) -> None:
    """Change which links there are."""
    one = rng.choice(list(roster))
    side = {robot: rng.random() < 0.5 for robot in roster}
    change = rng.randrange(5)
    for (a, b), works in up.items():
        if change == 0:
            up[a, b] = side[a] == side[b]
        elif change == 1:
            up[a, b] = True
        elif (change == 2 and a == one) or (change == 3 and b == one):
            up[a, b] = False
        elif change == 4 and rng.random() < 0.4:
            up[a, b] = not works


def both_drive(seed: int) -> tuple[int, int, Instant] | None:
    """Return two robots that may drive although the first one presumes the second dead, and when; None in a good run.

    Robots that drive by sight since they had no majority for a minute are left out: that is not promised of them.
    """
    air = Air(Random(seed))
    stood = dict.fromkeys(air.roster, 0)
    for now in range(0, STEPS * STEP, STEP):
        air.step(now)
        for robot, links in air.links.items():
            stood[robot] = stood[robot] + STEP if links.cut_off(now) else 0
        for robot, other in permutations(
            [robot for robot in air.roster if not stood[robot] and robot not in air.down], 2
        ):
            heard = air.heard[robot].get(other, air.born[robot] - NEVER_HEARD_FOR)
            if dead(air.links[robot], heard, other, now):
                return robot, other, now
        if max(stood.values()) > CUT_OFF_MAX - seconds(1):
            return None
    return None


class Air:
    """Robots that say hellos, and the links between them."""

    def __init__(self, rng: Random) -> None:
        self.rng = rng
        self.roster = range(1, rng.randint(2, 7) + 1)
        self.loss = rng.choice((0.0, 0.5))
        self.links = {robot: LinkSensing(robot, self.roster) for robot in self.roster}
        self.heard: dict[int, dict[int, Instant]] = {robot: {} for robot in self.roster}
        self.up = {(a, b): True for a in self.roster for b in self.roster if a != b}
        self.due = {robot: milliseconds(rng.randrange(500)) for robot in self.roster}
        self.born = dict.fromkeys(self.roster, 0)
        self.down: dict[int, Instant] = {}
        """The dead, and when they begin anew."""

    def step(self, now: Instant) -> None:
        """Let those say a hello whose turn it is."""
        if self.rng.random() < CHANGE:
            cut_links(self.rng, self.up, self.roster)
        if self.rng.random() < DEATH:
            self.down[self.rng.choice(list(self.roster))] = now + STEP * self.rng.randint(*DEAD_STEPS)
        for robot in [one for one, until in self.down.items() if until <= now]:
            del self.down[robot]
            self.links[robot] = LinkSensing(robot, self.roster, begins_late=True)
            self.heard[robot] = {}
            self.born[robot] = now
        for robot in self.roster:
            if now < self.due[robot] or robot in self.down:
                continue
            self.due[robot] = now + milliseconds(self.rng.randint(180, 550))
            listed = self.links[robot].list_of(self.heard[robot], now)
            for other in self.roster:
                if (
                    other != robot
                    and other not in self.down
                    and self.up[robot, other]
                    and self.rng.random() >= self.loss
                ):
                    self.heard[other][robot] = now
                    self.links[other].note(now, robot, listed)


def dead(links: LinkSensing, heard: Instant, other: int, now: Instant) -> bool:
    """Return whether a robot with these `links` presumes `other` dead (`Peers.dead_from`), which lists may prevent."""
    return now - max(heard, links.listed(other) - links.lasts) > DEAD and now - heard < CUT_OFF_MAX - NEVER_HEARD_FOR


@pytest.mark.medium
@pytest.mark.parametrize("seed", range(4))
def test_no_two_robots_drive_of_which_one_presumes_the_other_dead(seed):
    found = [(drawn, both) for drawn in range(20 * seed, 20 * seed + 20) if (both := both_drive(drawn)) is not None]
    assert found == []


majority_until = LinkSensing._majority_until


def half_is_enough(self: LinkSensing, now: Instant, *, settled: bool) -> Instant:
    return self._held_until(now, settled=settled, needed=(len(self._roster) - 1) // 2)


def unsettled_is_enough(self: LinkSensing, now: Instant, *, settled: bool) -> Instant:
    return majority_until(self, now, settled=False)


def never_cut_off(self: LinkSensing, now: Instant) -> bool:
    return False


def never_listed(self: LinkSensing, robot: int) -> Instant:
    return NEVER_HEARD


@pytest.mark.medium
@pytest.mark.parametrize(
    ("method", "broken"),
    [
        ("_majority_until", half_is_enough),
        ("_majority_until", unsettled_is_enough),
        ("cut_off", never_cut_off),
        ("listed", never_listed),
    ],
)
def test_each_part_of_the_rule_is_needed(monkeypatch, method: str, broken: Callable[..., object]):
    monkeypatch.setattr(LinkSensing, method, broken)
    assert any(both_drive(seed) is not None for seed in range(400))
