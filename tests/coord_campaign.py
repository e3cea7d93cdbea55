"""Random runs: the seed draws the robots, the traffic and the faults, then the air is healed and all must be served.

Three draws: the plain one (uniform loss, short faults), the wide one (some of: loss of its own per link, one kind of
frame delayed, duplicates up to 30 s old, restart loops, stalls up to 60 s, forged frames), and the hard one (all of:
unequal links, old duplicates, a restart loop, stalls up to 60 s, most of them of a robot that is inside).

A fourth one, `places`, has a station of two to four places, by each of these draws.

Run as a program for a long campaign: ``python coord_campaign.py FIRST LAST [wide|hard|places]``; each failing seed is
printed, and at the end how many runs had which kind of fault and how many overlaps there were of which kind.
"""

import sys
from collections import Counter
from dataclasses import dataclass, field, replace
from random import Random

from coord_harness import EVENT, MS, Air, Model, ms

from rmr.coord.messages import Entry, FrameKind, Phase, Sched, encode
from rmr.coord.term import NOBODY, Term
from rmr.coord.timing import Timing


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
    kinds: tuple[str, ...] = ()
    """The kinds of fault that were drawn."""
    overlaps: Counter[str] = field(default_factory=Counter)
    """Overlaps of any kind, also those that nobody can prevent, by what the two robots knew."""

    @property
    def ok(self) -> bool:
        """Whether no checker objected."""
        return not self.violations and not self.unserved and len(self.leaders) <= 1


HEALED = ms(12_000)
FAULTS = ("crash", "restart", "stall", "partition", "withdraw", "overrun")


SHORT = Timing(payload_max=42)
"""Frames of two entries: the schedules of a few robots take as many of them as those of a crowd."""


def run(seed: int, timing: Timing | None = None, robots: tuple[int, int] = (2, 6), capacity: int = 1) -> Outcome:
    """Run one seed: faults for 12 s, then a healed air until all are served."""
    rng = Random(f"campaign/{seed}")
    count = rng.randint(*robots)
    air = Air(
        loss=rng.choice((0.0, 0.1, 0.2, 0.3, 0.5)),
        duplicate=rng.choice((0.0, 0.1)),
        late=rng.choice((0.0, 0.0, 0.05)),
    )
    model = Model(seed, count, air, timing, capacity)
    ways = rng.choice((1, 2))
    faults = rng.sample(FAULTS, rng.randint(0, 2))
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
    options = f"n={count} {air.loss=} ways={ways} {faults} spread={spread}".replace("air.", "")
    return _outcome(seed, model, served, options, faults)


def run_wide(seed: int, timing: Timing | None = None, robots: tuple[int, int] = (2, 6), capacity: int = 1) -> Outcome:
    """Run one seed of the wide draw: faults, the longest until some 75 s, then a healed air until all are served."""
    rng = Random(f"campaign/wide/{seed}")
    count = rng.randint(*robots)
    air = Air(
        loss=rng.choice((0.0, 0.1, 0.3)),
        duplicate=rng.choice((0.0, 0.1)),
        late=rng.choice((0.0, 0.05)),
    )
    model = Model(seed, count, air, timing, capacity)
    kinds = rng.sample(("links", "slow", "echo", "loop", "long stall", "forged", *FAULTS), rng.randint(1, 4))
    if "links" in kinds:
        air.links = {(a, b): rng.choice((0.0, 0.2, 0.5, 0.9, 1.0)) for a in model.ids for b in model.ids if a != b}
    if "slow" in kinds:
        air.slow = (rng.choice(tuple(FrameKind)), ms(rng.choice((300, 900, 3000))))
    if "echo" in kinds:
        air.echo = rng.choice((0.02, 0.1, 0.3))
    ways, spread = rng.choice((2, 2, 2, 1)), rng.choice((20, 300, 5000))
    longest = rng.choice((3000, 3000, 20_000, 60_000))
    for robot in model.ids:
        for when in (rng.uniform(0, spread), rng.uniform(6000, 12_000), rng.uniform(14_000, 20_000)):
            if when <= spread or rng.random() < 0.4:
                _trigger(model, rng, robot, when, ways, longest)
    for kind in kinds:
        _break_wide(model, rng, kind)
    healed = ms(80_000) if "long stall" in kinds else ms(22_000)
    model.run(healed)
    model.air, model.parted = Air(), {}
    served = model.run_until(model.all_served, healed + ms(200_000))
    model.run(max(model.now, healed) + ms(4000))  # two leaders have time to hear each other
    options = f"n={count} {air.loss=} {ways=} {kinds} {spread=} {longest=}".replace("air.", "")
    return _outcome(seed, model, served, options, kinds)


def run_hard(seed: int, timing: Timing | None = None, robots: tuple[int, int] = (2, 6), capacity: int = 1) -> Outcome:
    """Run one seed of the hard draw: unequal links, old duplicates, a restart loop and stalls in every run."""
    rng = Random(f"campaign/hard/{seed}")
    count = rng.randint(*robots)
    air = Air(duplicate=rng.choice((0.0, 0.1)), late=rng.choice((0.0, 0.05)), echo=rng.choice((0.02, 0.1, 0.3)))
    losses = rng.choice(((0.0, 0.0, 0.2), (0.0, 0.2, 0.5), (0.0, 0.2, 0.5, 0.9, 1.0)))
    model = Model(seed, count, air, timing, capacity)
    air.links = {(a, b): rng.choice(losses) for a in model.ids for b in model.ids if a != b}
    ways, spread = rng.choice((2, 2, 2, 1)), rng.choice((20, 300, 5000))
    longest = rng.choice((3000, 20_000, 60_000))
    for robot in model.ids:
        for when in (rng.uniform(0, spread), rng.uniform(6000, 12_000), rng.uniform(14_000, 20_000)):
            if when <= spread or rng.random() < 0.4:
                _trigger(model, rng, robot, when, ways, longest)
    kinds = ["links", "echo", "loop", "long stall", *rng.sample(("partition", "crash", "withdraw"), rng.randint(0, 1))]
    for kind in kinds:
        _break_wide(model, rng, kind)
    for _ in range(rng.randint(1, 2)):
        _stall_inside(model, rng, rng.uniform(0, 15_000))
    healed = ms(100_000)
    model.run(healed)
    model.air, model.parted = Air(), {}
    served = model.run_until(model.all_served, healed + ms(250_000))
    model.run(max(model.now, healed) + ms(4000))
    options = f"n={count} {losses=} {ways=} {kinds} {spread=} {longest=} {air.echo=}".replace("air.", "")
    return _outcome(seed, model, served, options, kinds)


def _stall_inside(model: Model, rng: Random, after: float) -> None:
    """Stall the robot that is inside first from `after` ms on, at some time before it leaves."""
    duration, share = ms(rng.choice((5000, 12_000, 20_000, 60_000))), rng.random()

    def look() -> None:
        inside = [mind for mind in model.minds.values() if mind.inside is not None]
        if inside:
            left = inside[0].leaves - model.now
            model.stall(model.now + max(0, int(share * left)), inside[0].robot, duration)
        elif model.now < ms(35_000):
            model.at(model.now + ms(50), look)

    model.at(ms(after), look)


def _outcome(seed: int, model: Model, served: bool, options: str, kinds: list[str]) -> Outcome:
    """Return what the run of `model` showed, which has ended."""
    unserved = [] if served else [m.robot for m in model.minds.values() if m.alive and m.job is not None]
    return Outcome(
        seed,
        len(model.entries),
        len(model.senders),
        model.violations,
        unserved,
        model.leaders(),
        options,
        model.excused,
        tuple(kinds),
        model.overlaps,
    )


def _break_wide(model: Model, rng: Random, kind: str) -> None:
    robot, when = rng.choice(model.ids), rng.uniform(0, 9000)
    if kind == "loop":
        for _ in range(rng.randint(2, 10)):
            model.crash(ms(when), robot)
            when += rng.uniform(50, 800)
            model.restart(ms(when), robot)
            _trigger(model, rng, robot, when + rng.uniform(0, 100), 2, 3000)
            when += rng.uniform(100, 2000)
    elif kind == "long stall":
        for _ in range(rng.randint(1, 3)):
            model.stall(
                ms(rng.uniform(0, 15_000)), rng.choice(model.ids), ms(rng.choice((5000, 12_000, 20_000, 60_000)))
            )
    elif kind == "forged":
        for _ in range(rng.randint(1, 3)):
            model.forge(ms(rng.uniform(500, 15_000)), rng.choice((robot, 0x1234)), lambda now: forged(rng, model, now))
    elif kind in FAULTS:
        _break(model, rng, kind)


def forged(rng: Random, model: Model, now: int) -> bytes:
    """Return a damaged schedule: any term, no jobs or one that nobody has."""
    term = Term(rng.choice((rng.randrange(65536), 65535, 32768, 1)), rng.choice((*model.ids, 0x1234)))
    entries = (Entry(0x1234, now - now % ms(10), None, ms(1000), 0, Phase.WAITING),) if rng.random() < 0.5 else ()
    return encode(Sched(EVENT, now - now % MS, term, False, NOBODY, 0, 0, 0, 1, entries))


def _trigger(model: Model, rng: Random, robot: int, when: float, ways: int, longest: float = 3000) -> None:
    """Trigger a job; with two ways in each fourth run one where three corridors meet."""
    meets = ways > 1 and model.seed % 4 == 3
    model.trigger(
        ms(when),
        robot,
        deadline=ms(when + rng.uniform(4000, 20_000)),
        release=ms(when + rng.choice((0, rng.uniform(0, 3000)))),
        duration=ms(rng.uniform(500, longest)),
        headway=ms(950),
        direction=(2, 3, 5, 6, 8, 9)[rng.randrange(6)] if meets else rng.randrange(ways),
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


def run_places(seed: int) -> Outcome:
    """Run one seed with two to four places and more robots than that: of the plain, the wide and the hard draw in turn.

    At most as many as there are places may be inside; who counts is as in those draws.
    """
    capacity = Random(f"campaign/places/{seed}").randint(2, 4)
    draw = (run, run_wide, run_hard)[seed % 3]
    outcome = draw(seed, robots=(capacity + 1, capacity + 5), capacity=capacity)
    return replace(outcome, options=f"{capacity=} {outcome.options}")


DRAWS = {"plain": run, "wide": run_wide, "hard": run_hard, "places": run_places}


def main() -> None:
    """Run the seeds FIRST..LAST and print what failed."""
    first, last = int(sys.argv[1]), int(sys.argv[2])
    draw = DRAWS[sys.argv[3] if sys.argv[3:] else "plain"]
    entries = terms = failed = excused = 0
    kinds: Counter[str] = Counter()
    overlaps: Counter[str] = Counter()
    for seed in range(first, last + 1):
        outcome = draw(seed)
        entries += outcome.entries
        terms += outcome.terms > 1
        excused += len(outcome.excused)
        kinds.update(outcome.kinds)
        overlaps.update(outcome.overlaps)
        if not outcome.ok:
            failed += 1
            print(seed, outcome.options, outcome.violations[:3], outcome.unserved, outcome.leaders, flush=True)
    print(f"{last - first + 1} runs, {entries} entries, {terms} with several terms, {failed} failed, {excused} excused")
    print("faults:", ", ".join(f"{kind} {number}" for kind, number in sorted(kinds.items())) or "none")
    print("overlaps:", ", ".join(f"{kind} {number}" for kind, number in sorted(overlaps.items())) or "none")


if __name__ == "__main__":
    main()
