"""Coordination over the radio model: what discovery reaches in one round, and what a scheduling round costs.

The robots are the real cores with the ideal motion of `coord_harness`; every frame goes through real medium access
and real receptions in virtual time, so it collides, waits and is repeated as it would be. Robots stand in a disc in
which all hear each other. As robot processes do, they are woken at the very instant that they ask for.

* `discovery`: one announcement of a leader, and the answers of all members. The leader is kept from repeating it, so
  that what it knows at the end of the round are answers to that one frame, a member's own repeats included.
* `rounds`: from the first of triggers within 20 ms until all hold slots of one leader; then the steady state per
  second, with nobody passing and with robots passing. Each frame is counted as it is transmitted: repeats by the
  medium access and acknowledgements too.

Rows are plain values for JSON; a scalar is {mean, ci95, n_reps}, the interval normal, as in the reference files.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from math import cos, pi, sin, sqrt
from random import Random
from typing import Any

from coord_harness import EVENT, MS, Mind, Model, ms

from rmr.base.grid_path import GridPath
from rmr.base.kernel import ROBOT, Kernel
from rmr.base.time import Duration, Instant, in_seconds
from rmr.coord.events import LeadershipBegan, Send
from rmr.coord.messages import FrameKind, Sched, decode
from rmr.coord.timing import Timing
from rmr.radio.air import Announcement, Confirmed, Received
from rmr.radio.ether import Ether
from rmr.radio.frame import ACK_OCTETS, HEADER_OCTETS
from rmr.radio.phy import HEADER_OCTETS as PHY_OCTETS
from rmr.radio.phy import RadioConfig, airtime
from rmr.radio.trials.statistics import over_few, percentile

MEMBERS = (2, 3, 5, 8, 10, 15, 20, 30, 40, 50)
"""Sizes of groups, leader included, that the report shows."""
DISCOVERY = (5, 10, 50)
"""Members that answer one announcement."""
LOSSES = (0.0, 0.1, 0.3)
RADIUS_M = 8.0
"""Of the disc: the farthest two are 16 m apart, and frames carry 18.9 m."""
SPREAD = ms(20)
"""All triggers come within this."""
LIMIT = ms(10_000)
"""A round that takes longer has failed."""
STEADY = ms(5_000)
"""How long the steady state is measured."""
SETTLED = ms(500)
"""The repeats of a new schedule are over."""
LATER = ms(60_000)
"""Nobody passes before this."""
PATH_STEPS = 60
"""Of the leader's path, on a grid of 5 cm through a corridor of 3 m: one frame."""
KINDS = ("JOB", "SCHED", "PATH", "BEACON", "ACK")

Row = dict[str, Any]


@dataclass
class Tally:
    """What has been on the air, by kind."""

    frames: dict[str, int] = field(default_factory=lambda: dict.fromkeys(KINDS, 0))
    octets: dict[str, int] = field(default_factory=lambda: dict.fromkeys(KINDS, 0))

    def count(self, announcement: Announcement) -> None:
        """Count one transmission."""
        psdu = announcement.psdu
        kind = "ACK" if len(psdu) == ACK_OCTETS else FrameKind(psdu[HEADER_OCTETS]).name
        self.frames[kind] += 1
        self.octets[kind] += len(psdu)

    def take(self) -> "Tally":
        """Return what has been counted, and begin anew."""
        taken = Tally(dict(self.frames), dict(self.octets))
        for kind in KINDS:
            self.frames[kind] = self.octets[kind] = 0
        return taken


class OnAir(Model):
    """The harness's model, its frames carried by the radio model."""

    def __init__(self, seed: int, count: int, config: RadioConfig, timing: Timing | None = None) -> None:
        self.kernel = Kernel()
        super().__init__(seed, count, timing=timing)
        self.tally = Tally()
        self.first: Sched | None = None
        """The first announcement of a leader."""
        self.hushed = False
        """Only the first announcement is sent."""
        self.jobs: dict[int, int] = {}
        """JOBs that each robot has handed to its radio for the leader."""
        self.answers: dict[int, tuple[int, Instant]] = {}
        """By member: how many JOBs it had sent when the first one came to the leader, and when that was."""
        rng = Random(f"places/{seed}")
        ether = Ether(self.kernel, config, seed, pan=1)
        ether.on_air = self.tally.count
        self.stations = {}
        for robot in self.ids:
            angle, radius = rng.uniform(0, 2 * pi), RADIUS_M * sqrt(rng.random())
            take = self._taker(robot)
            self.stations[robot] = ether.add(
                robot, Random(f"{seed}/{robot}/csma"), take, radius * cos(angle), radius * sin(angle)
            )

    # -- the model's clock is the kernel's ---------------------------------------------------------------

    def at(self, when: Instant, action: Callable[[], None]) -> None:
        def act(now: Instant) -> None:
            self.now = now
            action()

        self.kernel.at(when, ROBOT, act)

    def run(self, until: Instant) -> None:
        self.kernel.run_until(until)
        self.now = until

    def run_until(self, done: Callable[[], bool], limit: Instant) -> bool:
        while not done():
            if self.kernel.due > limit:
                return False
            self.kernel.step()
        return True

    def wake_at(self, mind: Mind, when: Instant) -> None:
        when = max(when, self.now, mind.stalled_until)
        if when < mind.woken or mind.woken <= self.now:
            mind.woken = when
            self.at(when, lambda: self.tick(mind) if mind.woken == when else None)

    # -- the air -----------------------------------------------------------------------------------------

    def _transmit(self, mind: Mind, item: Send) -> None:
        if not mind.alive:
            return
        self._check_frame(mind, item.payload)
        if item.payload[0] == FrameKind.SCHED:
            if self.hushed and self.first is not None:
                return
            if self.first is None:
                self.first = decode(item.payload)  # type: ignore[assignment]
        elif item.destination is not None:
            self.jobs[mind.robot] = self.jobs.get(mind.robot, 0) + 1
        self.stations[mind.robot].request(item.payload, item.destination, item.handle)

    def _taker(self, robot: int) -> Callable[[Received | Confirmed], None]:
        def take(out: Received | Confirmed) -> None:
            self.now = self.kernel.now
            if isinstance(out, Confirmed):
                self._outcome(self.minds[robot], out.handle, out.status)
                return
            if out.unicast:
                self.answers.setdefault(out.source, (self.jobs[out.source], self.now))
            self._arrive(robot, out.payload, out.source)

        return take

    def _happened(self, mind: Mind, event: Any) -> None:
        super()._happened(mind, event)
        if isinstance(event, LeadershipBegan):
            self.at(self.now, lambda: self._offer_path(mind))

    def _offer_path(self, mind: Mind) -> None:
        mind.core.offer_path(self.now, EVENT, 0, GridPath((10, 10), (0,) * PATH_STEPS))
        self.settle(mind)


def group(seed: int, count: int, config: RadioConfig, release: Instant = 0, timing: Timing | None = None) -> OnAir:
    """Return `count` robots that all get a job of one event within `SPREAD`, with deadlines 4 s apart."""
    model = OnAir(seed, count, config, timing)
    rng = Random(f"jobs/{seed}")
    places = list(range(count))
    rng.shuffle(places)
    for robot, place in zip(model.ids, places, strict=True):
        model.trigger(rng.randrange(SPREAD), robot, deadline=ms(60_000 + 4000 * place), release=release)
    return model


# -- discovery ---------------------------------------------------------------------------------------------------


def round_time(members: int, timing: Timing) -> Duration:
    """Return how long a round of discovery is: the spread of the answers, and the time to the next repetition."""
    return timing.election.reply_spread * members + timing.election.answer_time + timing.schedule.repetition


def discovery(
    members: int, seeds: Iterable[int], interference: str, loss: float = 0.0, timing: Timing | None = None
) -> Row:
    """Return what one announcement to `members` robots with jobs that its leader does not know brings in."""
    config = RadioConfig(interference=interference, loss=loss)
    runs = [_discover(seed, members, config, timing or Timing()) for seed in seeds]
    scalars = {name: over_few([run[name] for run in runs]) for name in runs[0]}
    return {
        "members": members,
        "interference": interference,
        "loss": loss,
        "seeds": len(runs),
        "round_ms": round_time(members, timing or Timing()) / MS,
        **scalars,
        "worst": min(run["answered"] for run in runs),
    }


def _discover(seed: int, members: int, config: RadioConfig, timing: Timing) -> dict[str, float]:
    model = OnAir(seed, members + 1, config, timing)
    leader, *others = model.ids
    model.trigger(0, leader, deadline=ms(60_000))
    model.hushed = True
    assert model.run_until(lambda: model.tally.frames["SCHED"] > 0, LIMIT), "nobody has led"
    for place, robot in enumerate(others, start=1):  # while the announcement is on the air: who asks before is known
        model.trigger(model.now, robot, deadline=ms(60_000 + 4000 * place))
    first, begun = model.first, model.now
    assert first is not None
    model.tally.take()
    model.run(begun + round_time(members, timing))
    known = {entry.robot for entry in first.entries}
    expected = [robot for robot in model.ids if robot not in known]
    came = [model.answers[robot] for robot in expected if robot in model.answers]
    heard = [model.minds[robot].core._groups[EVENT].context.held.term == first.term for robot in expected]
    tally = model.tally
    return {
        "heard": sum(heard) / len(expected),
        "first": sum(count == 1 for count, _ in came) / len(expected),
        "answered": len(came) / len(expected),
        "last_ms": max((at - begun) / MS for _, at in came) if came else 0.0,
        "frames": float(sum(tally.frames.values())),
        "airtime_ms": _airtime_ms(sum(tally.frames.values()), sum(tally.octets.values())),
    }


# -- scheduling rounds -------------------------------------------------------------------------------------------


def rounds(
    members: int, seeds: Iterable[int], interference: str, loss: float = 0.0, timing: Timing | None = None
) -> Row:
    """Return what a scheduling round of `members` robots costs, and what the group costs per second after it."""
    config = RadioConfig(interference=interference, loss=loss)
    times: list[float] = []
    costs: dict[str, list[tuple[Tally, float]]] = {"round": [], "waiting": [], "passing": []}
    count = 0
    for seed in seeds:
        count += 1
        model = group(seed, members, config)
        if not _slotted(model):
            continue
        times.append(model.now / MS)
        costs["round"].append((model.tally.take(), 1.0))
        costs["passing"].append(_passing(model))
        costs["waiting"].append(_waiting(seed, members, config))
    return {
        "members": members,
        "interference": interference,
        "loss": loss,
        "seeds": count,
        "slotted": len(times),
        "round_ms": {**over_few(times), "median": percentile(times, 0.5), "p95": percentile(times, 0.95)},
        **{name: _cost(tallies) for name, tallies in costs.items()},
    }


def _slotted(model: OnAir) -> bool:
    """Run until all hold slots of one leader; return whether that comes to pass."""
    model.run(SPREAD)
    return model.run_until(model.all_slotted, LIMIT)


def _passing(model: OnAir) -> tuple[Tally, float]:
    begun = model.now
    model.run_until(model.all_served, begun + STEADY)
    return model.tally.take(), in_seconds(model.now - begun)


def _waiting(seed: int, members: int, config: RadioConfig) -> tuple[Tally, float]:
    model = group(seed, members, config, release=LATER)
    _slotted(model)
    model.run(model.now + SETTLED)
    model.tally.take()
    model.run(model.now + STEADY)
    return model.tally.take(), in_seconds(STEADY)


def _airtime_ms(frames: int, octets: int) -> float:
    return airtime(0) / MS * frames + (airtime(1) - airtime(0)) / MS * octets


def _cost(tallies: list[tuple[Tally, float]]) -> Row:
    """Return the means of what was on the air, each tally divided by its number of seconds (or rounds)."""

    def of(kinds: tuple[str, ...]) -> Row:
        frames = [sum(tally.frames[kind] for kind in kinds) for tally, _ in tallies]
        octets = [sum(tally.octets[kind] for kind in kinds) for tally, _ in tallies]
        parts = [part for _, part in tallies]

        def mean_of(values: Iterable[float]) -> Row:
            return over_few([value / part for value, part in zip(values, parts, strict=True)])

        return {
            "frames": mean_of(frames),
            "octets": mean_of(octets),
            "octets_on_air": mean_of(o + PHY_OCTETS * f for f, o in zip(frames, octets, strict=True)),
            "airtime_ms": mean_of(map(_airtime_ms, frames, octets)),
        }

    return {**of(KINDS), "by_kind": {kind: of((kind,)) for kind in KINDS}}
