"""The search: rounds, each of which begins with a run without faults of another seed.

A round keeps a corpus of good runs. A candidate is a good run's fault list and the harms of one attack on what that run
rested on: so the first candidates have one attack, later ones two or more, each of which takes away what saved the
robots from those before. Runs in which robots came closest are extended first. Candidates are run in batches, and
outcomes are taken in the order of the candidates: a hunt depends on its seed, never on the number of processes.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from rmr.base.streams import stream
from rmr_sim.hunt.candidates import ALONE, attacked
from rmr_sim.hunt.harm import Harm, possible
from rmr_sim.hunt.hunt_trial import ERROR, Broken, Trial, TrialOutcome
from rmr_world.lab import Lab

# ---- reduction of a list of harms that breaks a property to the smallest one that still breaks it
#
# First fewer harms: delta debugging (Zeller and Hildebrandt, IEEE TSE 2002) by complements. Then shorter windows,
# by halving each from either end. Then rounder numbers. Each step asks for the first of some candidates that still
# breaks the property; each candidate is a run.

Harms = tuple[Harm, ...]
FirstBreaking = Callable[[Sequence[Harms]], int | None]
"""Returns the index of the first of some lists that still breaks the property; None if none does."""

SHARES = (0.5, 0.75, 0.9)
"""Parts of a window that are tried in place of the whole, the shortest first."""
SHORTEST_MS = 100
"""Length below which a window is not shortened."""


def shrunk(harms: Harms, first_breaking: FirstBreaking) -> Harms:
    """Return the smallest list found; `harms` itself breaks the property."""
    harms = _fewer(harms, first_breaking)
    harms = _accepted(harms, _shorter, first_breaking)
    return _accepted(_fewer(harms, first_breaking), _rounder, first_breaking)


def _fewer(harms: Harms, first_breaking: FirstBreaking) -> Harms:
    """Return a list from which no harm can be left out (ddmin)."""
    parts = 2
    while len(harms) > 1:
        ends = [round(len(harms) * part / parts) for part in range(parts + 1)]
        complements = [harms[:begin] + harms[end:] for begin, end in pairwise(ends)]
        found = first_breaking(complements)
        if found is not None:
            harms = complements[found]
            parts = max(2, parts - 1)
        elif parts >= len(harms):
            break
        else:
            parts = min(len(harms), 2 * parts)
    return harms


def _accepted(harms: Harms, simpler: Callable[[Harm], Iterator[Harm]], first_breaking: FirstBreaking) -> Harms:
    """Return `harms` with each replaced by simpler ones as long as the property stays broken."""
    for index in range(len(harms)):
        while candidates := [(*harms[:index], one, *harms[index + 1 :]) for one in simpler(harms[index])]:
            found = first_breaking(candidates)
            if found is None:
                break
            harms = candidates[found]
    return harms


def _shorter(harm: Harm) -> Iterator[Harm]:
    """Yield the harm with a shorter window, the shortest first."""
    for share in SHARES:
        length_ms = round(harm.length_ms * share / SHORTEST_MS) * SHORTEST_MS
        if SHORTEST_MS <= length_ms < harm.length_ms:
            yield harm._replace(until_ms=harm.since_ms + length_ms)
            yield harm._replace(since_ms=harm.until_ms - length_ms)


def _rounder(harm: Harm) -> Iterator[Harm]:
    """Yield the harm with rounder times, the roundest first, and nothing once they are as round as that."""
    for step_ms in (10_000, 5_000, 1_000, 500, 100):  # the roundest first
        if 2 * step_ms > harm.length_ms:  # so rounded, it would be longer than need be
            continue
        since_ms = round(harm.since_ms / step_ms) * step_ms
        until_ms = round(harm.until_ms / step_ms) * step_ms
        if since_ms == harm.since_ms and until_ms == harm.until_ms:
            return
        if since_ms != harm.since_ms:
            yield harm._replace(since_ms=since_ms, until_ms=max(until_ms, since_ms + step_ms))
        elif until_ms > since_ms:
            yield harm._replace(until_ms=until_ms)


ROUND_RUNS = 96
"""Candidates of one run seed: enough for a few pairs, few enough to see many seeds."""
BATCH = 16
"""Candidates that are drawn from one state of the corpus, and shared by the processes."""
HARMS_MAX = 6
"""Bound of the harms of one candidate."""
SEED_MAX = 1_000_000
"""Greatest run seed of the rounds after the first."""
SHRINK_RUNS_MAX = 300
"""Bound of the runs that one reduction takes."""

RunBatch = Callable[[Sequence[Trial]], Iterator[TrialOutcome]]
"""Runs trials and yields their outcomes in order; it may end early."""


@dataclass(frozen=True, slots=True)
class Quarry:
    """What a hunt looks for, and how."""

    seed: int
    properties: tuple[str, ...]
    methods: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class HuntFinding:
    """A fault list that breaks a property."""

    seed: int
    """Of the run."""
    harms: Harms
    """The smallest list found."""
    broken: Broken
    """What the run with `harms` broke."""
    runs: int
    """Runs of the hunt until the property was broken first."""
    shrink_runs: int
    """Runs that the reduction took."""
    at_first: Harms
    """The list that broke the property first."""


@dataclass(slots=True)
class _Round:
    """The good runs of one seed."""

    seed: int
    corpus: list[TrialOutcome]
    tried: set[Harms] = field(default_factory=set)
    left: int = ROUND_RUNS


class HuntSearch:
    """One hunt."""

    def __init__(self, lab: Lab, quarry: Quarry, run_batch: RunBatch, goes_on: Callable[[int], int]) -> None:
        """`goes_on` returns how many more runs there may be after so many; 0 ends the hunt."""
        self._lab = lab
        self._quarry = quarry
        self._run_batch = run_batch
        self._goes_on = goes_on
        self._chance = stream(f"{quarry.seed}/hunt")
        self._methods = [name for name in quarry.methods if len(lab.roster) > 1 or name in ALONE]
        self.runs = 0
        """Runs so far, without those of reductions."""
        self.shrink_runs = 0
        """Runs of the reduction under way."""
        self.closest_m = 1.0
        """Smallest gap of two robots in a good run, metres."""
        self.told: Callable[[], None] = lambda: None
        """Called after each run."""

    def findings(self) -> Iterator[HuntFinding]:
        """Yield what is found, at most one for each round."""
        seed = self._quarry.seed
        while self._goes_on(self.runs):
            found = self._round(seed)
            if found is not None:
                yield found
            seed = self._chance.randint(1, SEED_MAX)

    def _round(self, seed: int) -> HuntFinding | None:
        current = _Round(seed, [])
        trials = [self._trial(seed, ())]
        while trials:
            for outcome in self._run_batch(trials):
                self.runs += 1
                self.told()
                if outcome.broken is not None:
                    return self._finding(outcome)
                self._keep(current, outcome)
            if not current.corpus:  # interrupted
                return None
            count = min(BATCH, current.left, self._goes_on(self.runs))
            current.left -= count
            trials = [trial for _ in range(count) if (trial := self._candidate(current)) is not None]
        return None

    def _trial(self, seed: int, harms: Harms) -> Trial:
        return Trial(seed, harms, self._quarry.properties)

    def _keep(self, current: _Round, outcome: TrialOutcome) -> None:
        """Add a good run to the corpus; the one without faults stays first."""
        self.closest_m = min(self.closest_m, outcome.closest_m)
        base = current.corpus[:1]
        rest = [*current.corpus[1:], outcome] if base else []
        rest.sort(key=lambda one: one.closest_m)  # stable: of equal ones the first comes first
        # The next ones extend those in which robots came closest.
        current.corpus = [*(base or [outcome]), *rest[:15]]

    def _candidate(self, current: _Round) -> Trial | None:
        """Return a trial with a list of harms that is new and possible; None if none is found."""
        chance = self._chance
        for _ in range(100):  # until a list is new and possible
            parent = current.corpus[0]
            # Probability that a candidate extends a run with faults, not the one without.
            if len(current.corpus) > 1 and chance.random() < 0.6:
                parent = current.corpus[1 + int((len(current.corpus) - 1) * chance.random() ** 2)]
            added = attacked(parent.supports, self._lab.roster, self._methods, chance)
            harms = (*parent.trial.harms, *added)
            new = tuple(sorted(harms, key=_order)) not in current.tried
            if new and len(harms) <= HARMS_MAX and possible(harms, self._lab):
                current.tried.add(tuple(sorted(harms, key=_order)))
                return self._trial(current.seed, harms)
        return None

    def _finding(self, outcome: TrialOutcome) -> HuntFinding:
        """Return the smallest list that breaks the same property as `outcome`."""
        assert outcome.broken is not None
        runs = self.runs
        best = outcome
        self.shrink_runs = 0

        def first_breaking(candidates: Sequence[Harms]) -> int | None:
            nonlocal best
            allowed = [(i, harms) for i, harms in enumerate(candidates) if possible(harms, self._lab)]
            if not allowed or self.shrink_runs >= SHRINK_RUNS_MAX:
                return None
            trials = [self._trial(outcome.trial.seed, harms) for _, harms in allowed]
            for (index, _), one in zip(allowed, self._run_batch(trials), strict=False):
                self.shrink_runs += 1
                self.told()
                if _same(one.broken, outcome.broken):
                    best = one
                    return index
            return None

        if outcome.broken.name != ERROR:
            shrunk(outcome.trial.harms, first_breaking)
        assert best.broken is not None
        shrink_runs = self.shrink_runs
        self.shrink_runs = 0
        return HuntFinding(outcome.trial.seed, best.trial.harms, best.broken, runs, shrink_runs, outcome.trial.harms)


def _same(one: Broken | None, other: Broken | None) -> bool:
    return one is not None and other is not None and one.name == other.name


def _order(harm: Harm) -> tuple[str, tuple[int, ...], int, int, float]:
    return harm.kind.value, harm.robots, harm.since_ms, harm.until_ms, harm.amount
