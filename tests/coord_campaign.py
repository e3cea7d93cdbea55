"""Random runs: the seed draws the robots, the traffic and the faults, then the air is healed and all must be served.

Run as a program for a long campaign: ``python campaign.py FIRST LAST``; each failing seed is printed.
"""

import sys
from dataclasses import dataclass, field
from random import Random

from coord_harness import Air, Model, ms

from rmr.coord.values import Values


@dataclass
class Outcome:
    """What one run showed."""

    seed: int
    entries: int
    terms: int
    violations: list[str]
    unserved: list[int]
    leaders: list[int]
    options: str
    excused: list[str] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """Whether no checker objected."""
        return not self.violations and not self.unserved and len(self.leaders) <= 1


HEALED = ms(12_000)


SHORT = Values(payload_max=42)
"""Frames of two entries: the schedules of a few robots take as many of them as those of a crowd."""


def run(seed: int, values: Values | None = None, robots: tuple[int, int] = (2, 6)) -> Outcome:
    """Run one seed: faults for 12 s, then a healed air until all are served."""
    rng = Random(f"campaign/{seed}")
    count = rng.randint(*robots)
    air = Air(
        loss=rng.choice((0.0, 0.1, 0.2, 0.3, 0.5)),
        duplicate=rng.choice((0.0, 0.1)),
        late=rng.choice((0.0, 0.0, 0.05)),
    )
    model = Model(seed, count, air, values)
    ways = rng.choice((1, 2))
    faults = rng.sample(("crash", "restart", "stall", "partition", "withdraw", "overrun"), rng.randint(0, 2))
    spread = rng.choice((20, 300, 5000))
    for robot in model.ids:
        _trigger(model, rng, robot, rng.uniform(0, spread), ways)
        if rng.random() < 0.3:
            _trigger(model, rng, robot, rng.uniform(14_000, 20_000), ways)
    for fault in faults:
        _break(model, rng, fault)
    model.run(HEALED)
    model.air = Air()
    model.parted = {}
    served = model.run_until(lambda: model.now > ms(21_000) and model.all_served(), ms(90_000))
    unserved = [] if served else [m.robot for m in model.minds.values() if m.alive and m.job is not None]
    options = f"n={count} {air.loss=} ways={ways} {faults} spread={spread}".replace("air.", "")
    return Outcome(
        seed,
        len(model.entries),
        len(model.senders),
        model.violations,
        unserved,
        model.leaders(),
        options,
        model.excused,
    )


def _trigger(model: Model, rng: Random, robot: int, when: float, ways: int) -> None:
    model.trigger(
        ms(when),
        robot,
        deadline=ms(when + rng.uniform(4000, 20_000)),
        release=ms(when + rng.choice((0, rng.uniform(0, 3000)))),
        duration=ms(rng.uniform(500, 3000)),
        headway=ms(950),
        way=rng.randrange(ways),
    )


def _break(model: Model, rng: Random, fault: str) -> None:
    robot = rng.choice(model.ids)
    when = ms(rng.uniform(0, 9000))
    if fault == "crash":
        model.crash(when, robot)
    elif fault == "restart":
        model.crash(when, robot)
        model.restart(when + ms(rng.uniform(50, 2000)), robot)
    elif fault == "stall":
        model.stall(when, robot, ms(rng.choice((200, 700, 3000))))
    elif fault == "withdraw":
        model.withdraw(when, robot)
    elif fault == "overrun":
        model.minds[robot].overrun = ms(rng.uniform(100, 3000))
    else:
        model.partition(when, {r: rng.randrange(2) for r in model.ids})
        model.partition(when + ms(rng.uniform(300, 4000)), {})


def main() -> None:
    """Run the seeds FIRST..LAST and print what failed."""
    first, last = int(sys.argv[1]), int(sys.argv[2])
    entries = terms = failed = excused = 0
    for seed in range(first, last + 1):
        outcome = run(seed)
        entries += outcome.entries
        terms += outcome.terms > 1
        excused += len(outcome.excused)
        if not outcome.ok:
            failed += 1
            print(seed, outcome.options, outcome.violations[:3], outcome.unserved, outcome.leaders)
    print(f"{last - first + 1} runs, {entries} entries, {terms} with several terms, {failed} failed, {excused} excused")


if __name__ == "__main__":
    main()
