"""Ring, coins and bank of durable robots under random kills, loss 20 % and snapshots: counts over many seeds.

    nice python tests/sim/durable_campaign.py --seeds 1-1000

Each seed is three runs. In each, robots are killed and restarted at drawn instants, segments of their journals are
closed at a drawn size, and some snapshots are torn or not taken (`rmr_sim.disk`). At quiescence the tokens, coins and
money are counted. It prints a line for each run that is wrong, and the counts at the end; exit code 1 if any was.
"""

import argparse
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from random import Random

from lab_maker import small_lab
from test_sim_durable import BANK, COINS, RING, facts, with_kills

from rmr_sim.event import Event
from rmr_sim.simulation import Simulation

UNTIL_S = 8
"""Kills and wishes come before this."""


class WantsEvent(Event):
    """Asks a robot for a coin, and counts it if the robot lives."""

    def __init__(self, at: int, robot: int, number: int, heard: list[int]) -> None:
        super().__init__(at)
        self.robot = robot
        self.number = number
        self.heard = heard

    def happen(self, simulation: Simulation) -> None:
        """Insert the wish."""
        simulation.insert(self.robot, "wants", self.number)
        if not simulation.is_dead(self.robot):
            self.heard.append(self.number)


def begun(folder: Path, program: str, given: str, seed: int) -> Simulation:
    """Return a lab of three durable robots that are killed at drawn instants."""
    simulation = small_lab(folder, program, robots=3, facts=given, loss=0.2, seed=seed, duration="20s", durable=True)
    octets = Random(f"{seed}/segments").randrange(1200, 1800)
    for robot in simulation.robots:
        robot._disk.segment_octets = robot.node._journal._segment_octets = octets
    return with_kills(simulation, seed, [1, 2, 3], UNTIL_S)


def ring(folder: Path, seed: int) -> tuple[Simulation, bool]:
    """Return a run of the ring, and whether its token has passed each place once and is there."""
    simulation = begun(folder, RING, '["token(@1, 0)"]', seed)
    simulation.run()
    passed = sorted(int(number) for _, number in facts(simulation, "passed"))
    held = [int(number) for _, number in facts(simulation, "holds")]
    return simulation, passed == list(range(30)) and held == [30] and not facts(simulation, "token")


def coins(folder: Path, seed: int) -> tuple[Simulation, bool]:
    """Return a run of the keeper of coins, and whether each coin is there once and each wish was granted once."""
    given = ", ".join(f'"coin(@1, {number})"' for number in range(20))
    simulation = begun(folder, COINS, f"[{given}]", seed)
    chance = Random(-seed)
    heard: list[int] = []
    for number in range(16):
        robot = chance.choice([2, 3])
        simulation.schedule(WantsEvent(chance.randrange(UNTIL_S * 10**9), robot, number, heard))
    simulation.run()
    has = [int(coin) for _, coin in facts(simulation, "has")]
    kept = [int(coin) for _, coin in facts(simulation, "coin")]
    return simulation, sorted(has + kept) == list(range(20)) and len(has) == len(heard)


def bank(folder: Path, seed: int) -> tuple[Simulation, bool]:
    """Return a run of the bank, and whether all has been paid and the sum is what it was."""
    pays = ", ".join(f'"pay(@{1 + n % 3}, @{1 + (n + 1) % 3}, {1 + n})"' for n in range(12))
    accounts = '"account(@1, 100)", "account(@2, 100)", "account(@3, 100)"'
    simulation = begun(folder, BANK, f"[{accounts}, {pays}]", seed)
    simulation.run()
    balances = [int(balance) for _, balance in facts(simulation, "account")]
    under_way = facts(simulation, "pay") + facts(simulation, "paid")
    return simulation, not under_way and len(balances) == 3 and sum(balances) == 300


CASES: dict[str, Callable[[Path, int], tuple[Simulation, bool]]] = {"ring": ring, "coins": coins, "bank": bank}


def campaign(seeds: range) -> Counter[str]:
    """Run all cases with all seeds; return the counts."""
    counts: Counter[str] = Counter()
    for seed in seeds:
        for name, case in CASES.items():
            with tempfile.TemporaryDirectory() as folder:
                simulation, right = case(Path(folder), seed)
            right = right and not simulation.violations
            counts[f"{name}: right" if right else f"{name}: wrong"] += 1
            counts["restarts"] += sum(robot.restarts for robot in simulation.robots)
            disks = [robot._disk for robot in simulation.robots]
            counts["segments closed"] += sum(disk.number for disk in disks)
            counts["restarts from a snapshot"] += sum(disk.from_snapshots for disk in disks)
            counts["snapshots passed over"] += sum(disk.passed_over for disk in disks)
            if not right:
                print(f"wrong: {name}, seed {seed}", flush=True)
        if seed % 50 == 0:
            print(f"seed {seed}: {dict(counts)}", flush=True)
    return counts


def main() -> int:
    """Run the campaign; return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", default="1-20", metavar="A-B")
    match = re.fullmatch(r"(\d+)-(\d+)", parser.parse_args().seeds)
    if match is None:
        parser.error("--seeds takes A-B")
    counts = campaign(range(int(match[1]), int(match[2]) + 1))
    for name in sorted(counts):
        print(f"{name}: {counts[name]}")
    return 1 if any(name.endswith("wrong") for name in counts) else 0


if __name__ == "__main__":
    sys.exit(main())
