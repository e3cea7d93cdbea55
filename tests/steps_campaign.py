"""Drawn chains of contended steps under one deadline, beside the best fixed order of the pure model.

Up to five robots start together. Each has two to four steps, one after the other by rules or by ``then``, and one
deadline for all. In the pure model robots go in one order at every step, without radio: a slot begins when the robot is
ready and a gap after the slot before it. Of all orders the one with most jobs on time counts.

Run: python tests/steps_campaign.py FIRST LAST
"""

import sys
from dataclasses import dataclass
from itertools import pairwise, permutations
from random import Random

import rmr
from rmr.base.time import in_seconds
from rmr.coord.timing import Timing

_TIMING = Timing()
GAP_S = in_seconds(_TIMING.schedule.window + 2 * _TIMING.clock_error + _TIMING.schedule.clear)
"""Between two slots that exclude each other."""
FIRST_S = in_seconds(_TIMING.schedule.lead) + 0.05
"""From the start of the jobs to the first slot."""


@dataclass(frozen=True)
class Chain:
    """Robots with the same steps, and a deadline of each."""

    then: bool
    takes_s: tuple[float, ...]
    """By step."""
    due_s: tuple[float, ...]
    """By robot."""

    @property
    def program(self) -> str:
        """The source."""
        steps = range(len(self.takes_s))
        acts = [f"type action step{step}(R: robot) -o done{step}(R)." for step in steps]
        if self.then:
            first = " then ".join(f"step{step}(R)" for step in steps)
            rules = []
        else:
            first = "step0(R)"
            rules = [f"done{one}(R) -o step{other}(R)." for one, other in pairwise(steps)]
        dues = [f"due(@{robot}, {due})." for robot, due in enumerate(self.due_s, 1)]
        return "\n".join(
            [
                "type !due(robot, float).",
                "go(R).",
                *acts,
                *dues,
                f"go(R), due(R, D) -o trip(R, D), {first}.",
                *rules,
                f"done{steps[-1]}(R) -o arrived(R).",
                'whole: assert(trip(R, D), arrived(R), D, say(R, "late")).',
                "type action say(robot, string).",
            ]
        )

    @property
    def best(self) -> int:
        """The most jobs on time of any fixed order in the pure model."""
        return max(self._met(order) for order in permutations(self.due_s))

    def _met(self, order: tuple[float, ...]) -> int:
        free = [FIRST_S] + [0.0] * (len(self.takes_s) - 1)
        met = 0
        for due in order:
            at = 0.0
            for step, takes in enumerate(self.takes_s):
                at = max(at, free[step]) + takes
                free[step] = at + GAP_S
            met += at <= due
        return met


def drawn(seed: int) -> Chain:
    """Return the chain that `seed` draws."""
    rng = Random(f"steps/{seed}")
    robots = rng.randint(1, 5)
    takes = [round(rng.uniform(1, 6), 1) for _ in range(rng.randint(2, 4))]
    dues = [round(1.1 * sum(takes) + rng.uniform(0.5, 1.2 * max(takes) * robots), 1) for _ in range(robots)]
    return Chain(rng.random() < 0.5, tuple(takes), tuple(dues))


def run(chain: Chain, seed: int, engine: str = "generated") -> tuple[int, list[str]]:
    """Run `chain`; return how many jobs met their deadline, and what was wrong."""
    times = {f"step{step}": takes for step, takes in enumerate(chain.takes_s)}
    robots = len(chain.due_s)
    done = rmr.evaluate(
        chain.program, robots=robots, action_times=times, until=300, seed=seed, trace=True, engine=engine
    )
    jobs = [job for each in done.report["robots"].values() for job in each["assertions"]]
    wrong = [] if done.quiescent and len(jobs) == robots else ["not all came to their end"]
    within: dict[str, int] = {}
    for entry in done.trace:
        step = str(entry.get("action", "")).partition("(")[0]
        if step not in times:
            continue
        if entry["what"] == "action":
            if step in within:
                wrong.append(f"{step}: robots {within[step]} and {entry['robot']} at {entry['t']} s")
            within[step] = entry["robot"]
        elif entry["what"] == "action_ended":
            within.pop(step, None)
    return sum(job["met"] is True for job in jobs), wrong


def main(first: int, last: int) -> int:
    """Print the jobs met beside the best; return the exit code."""
    met = best = robots = 0
    failed = False
    for seed in range(first, last + 1):
        chain = drawn(seed)
        found, wrong = run(chain, seed)
        for text in wrong:
            print(f"{seed}: {text}", flush=True)
        failed = failed or bool(wrong)
        met += found
        best += chain.best
        robots += len(chain.due_s)
        if found < chain.best:
            print(f"{seed}: {found} of {chain.best}: {chain}", flush=True)
    print(f"chains {first} to {last}: {robots} jobs, {met} met, {best} by the best order ({met / best:.3f})")
    return 1 if failed or met < 0.98 * best else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2])))
