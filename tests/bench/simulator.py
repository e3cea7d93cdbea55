"""How fast the simulator is: lab time over processor time of one core, and the memory of a robot.

    python tests/bench/simulator.py [--rounds N] [--output FILE] [--write FOLDER] [--page FILE]

Six robots in the corridor and on the test-bed, with all checkers, a hundred that queue for a door, a hundred that all
drive across each other's ways, and a thousand without bodies (`crowds`). Each run has a process of its own; the labs
take turns, so that a machine that is busy for a while is so for all of them. The median of the rounds counts. What
`make fast` makes is measured, and the sources as they are beside it. Reading the lab is not part of a run; it is told
beside it. A robot's memory is what reading the lab and running it add to the process, by its greatest resident set,
divided by the robots.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict
from pathlib import Path

from crowds import crossing, flood, hall
from hosts import machine
from page import add_options, figure_rows, keep, table
from run import LABS, Figure

from rmr.compiled import FOLDER, modules_in

ROUNDS = 3
HUNDRED, THOUSAND = 100, 1000
FORMS = {"compiled": str(FOLDER), "interpreted": ""}
"""What RMR_COMPILED says of each."""
COMPILED_ALONE = ("hall",)
"""Interpreted it takes minutes."""
TARGETS = {"corridor": 40.0, "testbed": 40.0, "hall": 3.0, "crossing": 3.0, "flood": 10.0}
"""Lab time over processor time, at least."""
NAMES = {
    "corridor": "six robots in the corridor",
    "testbed": "six robots on the test-bed",
    "hall": f"{HUNDRED} robots that queue for a door",
    "crossing": f"{HUNDRED} robots that cross each other's ways",
    "flood": f"{THOUSAND:,} robots without bodies",
}


def taken_here(lab: Path, seed: int) -> dict[str, float]:
    """Run `lab` once in this process and return what it took."""
    from rmr_sim.run_setup import prepare

    before, began = _resident_kb(), time.process_time()
    simulation = prepare(lab, seed=seed)
    ready = time.process_time()
    simulation.run()
    ended = time.process_time()
    return {
        "speed": simulation.time_s / (ended - ready),
        "load_s": ready - began,
        "robot_kb": (_resident_kb() - before) / len(simulation.robots),
    }


def _resident_kb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def taken(labs: dict[str, Path], rounds: int) -> list[Figure]:
    """Return the figures of all labs: each runs `rounds` times, in turn with the others, compiled and interpreted."""
    results: dict[tuple[str, str], list[dict[str, float]]] = {}
    for seed in range(1, rounds + 1):
        for name, lab in labs.items():
            for form in FORMS if name not in COMPILED_ALONE else ["compiled"]:
                words = [sys.executable, __file__, "--lab", str(lab), "--seed", str(seed)]
                environment = {**os.environ, "RMR_COMPILED": FORMS[form]}
                answer = subprocess.run(words, capture_output=True, text=True, check=True, env=environment)
                results.setdefault((name, form), []).append(json.loads(answer.stdout))
    figures = []
    for (name, form), runs in results.items():
        speed, load, memory = (statistics.median(run[key] for run in runs) for key in ("speed", "load_s", "robot_kb"))
        if form == "interpreted":
            figures.append(Figure(f"{NAMES[name]}: the same, interpreted", speed, "x"))
            continue
        figures += [
            Figure(f"{NAMES[name]}: reading the lab", load, "s"),
            Figure(f"{NAMES[name]}: memory of a robot", memory, "kB"),
            Figure(f"{NAMES[name]}: lab time over processor time", speed, "x", TARGETS[name], at_least=True),
        ]
    return figures


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "simulator")
    parser.add_argument("--rounds", type=int, default=ROUNDS, metavar="N")
    parser.add_argument("--lab", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--seed", type=int, default=1, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.lab is not None:
        print(json.dumps(taken_here(options.lab, options.seed)))
        return 0
    if not modules_in(FOLDER):
        parser.error("nothing is compiled, or sources have changed since: make fast")
    with tempfile.TemporaryDirectory() as folder:
        labs = {
            "corridor": LABS / "corridor",
            "testbed": LABS / "testbed",
            "hall": hall(Path(folder), HUNDRED),
            "crossing": crossing(Path(folder), HUNDRED),
            "flood": flood(Path(folder), THOUSAND),
        }
        figures = taken(labs, options.rounds)
    told = [{**asdict(figure), "met": figure.met} for figure in figures]
    header = ("the simulator on one core", "taken", "target")
    lines = table(header, figure_rows(told))
    aimed = table(header, figure_rows([each for each in told if each["target"] is not None]))
    print("\n".join(lines))
    record = {"machine": machine(), "rounds": options.rounds, "figures": told}
    keep(options, "simulator.json", record, "simulator", aimed)
    return 0 if all(figure.met for figure in figures) else 1


if __name__ == "__main__":
    sys.exit(main())
