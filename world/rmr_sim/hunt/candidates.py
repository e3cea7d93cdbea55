"""Fault lists from the lineage of a run: each removes something that the run's safety rested on.

A method makes the harms that attack one support. Its window covers the instant at which the support was needed, or at
which the last frame that it rested on was sent, and is 0.1 to 30 s long. Methods are drawn with equal probability, then
a ground, then a support of that ground; the closest calls are the likeliest.
"""

from collections.abc import Callable, Mapping, Sequence
from math import exp, log
from random import Random

from rmr_sim.hunt.harm import Harm, HarmKind
from rmr_sim.hunt.lineage import Support

WINDOW_MS = 100, 30_000
"""Range of the length of a fault; log-uniform."""
GRID_MS = 100
"""Times are drawn in multiples of this: a frame is hit all the same, as hellos are further apart."""
LOSSES = 0.3, 0.6, 0.8, 1.0
"""Shares of frames lost."""
LOOP_DEAD_MS = 200, 3000
LOOP_ALIVE_MS = 200, 5000
"""Ranges of the times for which a robot is dead and alive in a restart loop."""

Method = Callable[["Attack"], list[Harm]]


class Attack:
    """The random draws for one support."""

    def __init__(self, support: Support, roster: Sequence[int], chance: Random) -> None:
        self.support = support
        self.roster = roster
        self.chance = chance

    @property
    def either(self) -> int:
        """One of the two robots of the support."""
        return self.chance.choice((self.support.robot, self.support.other))

    def length_ms(self, shortest_ms: int = WINDOW_MS[0], longest_ms: int = WINDOW_MS[1]) -> int:
        """Return the length of a fault."""
        return grid(exp(self.chance.uniform(log(shortest_ms), log(longest_ms))))

    def window(self, shortest_ms: int = WINDOW_MS[0], longest_ms: int = WINDOW_MS[1]) -> tuple[int, int]:
        """Return the beginning and the end of a fault that is there when the support is needed."""
        anchor_ms = self.chance.choice((self.support.at_ms, self.support.heard_ms))
        length_ms = self.length_ms(shortest_ms, longest_ms)
        # A fault begins five seconds before the support is needed at most.
        lead_ms = self.chance.randint(0, min(length_ms - GRID_MS, 5_000))
        since_ms = max(0, (anchor_ms - lead_ms) // GRID_MS * GRID_MS)
        return since_ms, since_ms + length_ms

    def harm(self, kind: HarmKind, *robots: int, amount: float = 0.0) -> Harm:
        """Return one fault with a window of its own."""
        return Harm(kind, robots, *self.window(), amount)


def grid(time_ms: float) -> int:
    """Return a time on the grid, the first step at least."""
    return max(GRID_MS, round(time_ms / GRID_MS) * GRID_MS)


def _link(attack: Attack) -> list[Harm]:
    """Cut the link by which the robot heard the other."""
    return [attack.harm(HarmKind.LINK, attack.support.other, attack.support.robot)]


def _links(attack: Attack) -> list[Harm]:
    """Cut links one way, those to or from the robot."""
    robot = attack.support.robot
    others = [other for other in attack.roster if other != robot]
    chosen = attack.chance.sample(others, attack.chance.randint(1, len(others)))
    window = attack.window()
    return [Harm(HarmKind.LINK, attack.chance.choice(((other, robot), (robot, other))), *window) for other in chosen]


def _partition(attack: Attack) -> list[Harm]:
    """Part the robot from the other, and divide the rest by chance."""
    rest = [robot for robot in attack.roster if robot not in (attack.support.robot, attack.support.other)]
    side = {attack.support.robot, *(robot for robot in rest if attack.chance.random() < 0.5)}
    return [attack.harm(HarmKind.PARTITION, *sorted(side))]


def _mute(attack: Attack) -> list[Harm]:
    return [attack.harm(HarmKind.MUTE, attack.support.other)]


def _deaf(attack: Attack) -> list[Harm]:
    return [attack.harm(HarmKind.DEAF, attack.support.robot)]


def _loss(attack: Attack) -> list[Harm]:
    return [attack.harm(HarmKind.LOSS, amount=attack.chance.choice(LOSSES))]


def _stall(attack: Attack) -> list[Harm]:
    return [attack.harm(HarmKind.STALL, attack.either)]


def _slow(attack: Attack) -> list[Harm]:
    between_calls_ms = attack.chance.choice((100, 200, 400, 1000))
    return [attack.harm(HarmKind.SLOW, attack.either, amount=between_calls_ms)]


def _crash(attack: Attack) -> list[Harm]:
    return [attack.harm(HarmKind.CRASH, attack.either)]


def _crashes(attack: Attack) -> list[Harm]:
    """Kill both robots."""
    return [attack.harm(HarmKind.CRASH, robot) for robot in (attack.support.robot, attack.support.other)]


def _loop(attack: Attack) -> list[Harm]:
    """Restart one of the robots again and again, from when the support is needed on."""
    robot = attack.either
    harms = [Harm(HarmKind.CRASH, (robot,), *attack.window(*LOOP_DEAD_MS))]
    while len(harms) < 3:  # crashes of a restart loop
        since_ms = harms[-1].until_ms + attack.length_ms(*LOOP_ALIVE_MS)
        harms.append(Harm(HarmKind.CRASH, (robot,), since_ms, since_ms + attack.length_ms(*LOOP_DEAD_MS)))
    return harms


def _outage(attack: Attack) -> list[Harm]:
    return [attack.harm(HarmKind.OUTAGE, attack.either)]


def _lost(attack: Attack) -> list[Harm]:
    """Restart a robot within an outage of its localisation."""
    robot = attack.either
    crash = attack.harm(HarmKind.CRASH, robot)
    longer_ms = attack.length_ms(1000)
    return [crash, Harm(HarmKind.OUTAGE, (robot,), max(0, crash.since_ms - 1000), crash.until_ms + longer_ms)]


METHODS: Mapping[str, Method] = {
    "link": _link,
    "links": _links,
    "partition": _partition,
    "mute": _mute,
    "deaf": _deaf,
    "loss": _loss,
    "stall": _stall,
    "slow": _slow,
    "crash": _crash,
    "crashes": _crashes,
    "loop": _loop,
    "outage": _outage,
    "lost": _lost,
}
"""Ways to attack a support, by the name that `--methods` takes."""
ALONE = frozenset({"loss", "stall", "slow", "crash", "loop", "outage", "lost"})
"""Methods that a single robot suffices for."""


def attacked(supports: Sequence[Support], roster: Sequence[int], methods: Sequence[str], chance: Random) -> list[Harm]:
    """Return the harms of one method on one of `supports`, which are ordered by how close the call was."""
    supports = supports or [_anywhere(roster, chance)]
    grounds = list(dict.fromkeys(support.ground for support in supports))
    ground = chance.choice(grounds)
    of_ground = [support for support in supports if support.ground == ground]
    support = of_ground[int(len(of_ground) * chance.random() ** 2)]
    others = [robot for robot in roster if robot != support.robot]
    if support.robot == support.other and others:  # a leader rests on the frames of all
        support = support._replace(other=chance.choice(others))
    return METHODS[chance.choice(methods)](Attack(support, roster, chance))


def _anywhere(roster: Sequence[int], chance: Random) -> Support:
    """Return a support at random, for a run whose robots have nothing to do with each other."""
    at_ms = chance.randint(0, 30_000)
    return Support(at_ms, chance.choice(roster), chance.choice(roster), "none", 0.0, at_ms)
