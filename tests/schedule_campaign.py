"""Compares the scheduler with the brute-force optimum in many random instances.

Run: python tests/schedule_campaign.py FIRST LAST
"""

import sys
from collections import Counter
from random import Random

from schedule_bruteforce import instance, optimum

from rmr.coord.schedule import by_deadline, on_time, order_jobs, place


def differences(seed: int) -> list[str]:
    """Return in what the order of one instance differs from the best one, and from what the rules of ties ask."""
    rng = Random(f"schedule/{seed}")
    tasks, standing, rules = instance(rng)
    best = optimum(tasks, standing, rules)
    order = order_jobs(tasks, standing, rules)
    met = on_time(order, place(order, standing, rules))
    found = []
    if met != best.met:
        found.append("count")
    plain = sorted(tasks, key=by_deadline)
    whole = on_time(plain, place(plain, standing, rules)) == len(tasks)
    wanted = [task.robot for task in plain] if whole else list(best.order)
    starts = place(order, standing, rules)
    if [task.robot for task, at in zip(order, starts, strict=True) if at + task.duration <= task.deadline] != wanted:
        found.append("order")
    robots = sorted(task.robot for task in tasks)
    steady = order_jobs(tasks, standing, rules, rng.sample(robots, rng.randint(0, len(robots))))
    if on_time(steady, place(steady, standing, rules)) != best.met:
        found.append("count with an old order")
    if sorted(task.robot for task in steady) != robots:
        found.append("jobs")
    return found


def main(first: int, last: int) -> int:
    """Print how often what differed; return the exit code."""
    counts: Counter[str] = Counter()
    for seed in range(first, last + 1):
        for what in differences(seed):
            counts[what] += 1
            print(f"{seed}: {what}", flush=True)
    print(f"instances {first} to {last}: {dict(counts) or 'no difference'}")
    return 1 if counts else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2])))
