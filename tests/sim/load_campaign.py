"""Programs loaded under loss 30 % while a robot dies at a drawn instant: all switch or none does, over many seeds.

    PYTHONPATH=tests nice python tests/sim/load_campaign.py --seeds 1-500

In each run a robot begins to distribute a program at 1 s over a radio that loses 30 %, and robot 5 is killed for good
at a drawn instant between 0.3 s and 9 s: before the load, while fragments are sent, between readiness and the switch,
or after it. Three tokens go round in four robots meanwhile. At the end all living robots run one program, those that
have switched did so at one instant, and each token is there once. It prints a line for each run that is wrong, and the
counts at the end; exit code 1 if any was.
"""

import argparse
import re
import sys
import tempfile
from collections import Counter
from pathlib import Path
from random import Random

from test_program_loads import check_all_or_none, lab_in


def campaign(seeds: range) -> Counter[str]:
    """Run all seeds; return the counts."""
    counts: Counter[str] = Counter()
    for seed in seeds:
        killed_s = Random(seed).uniform(0.3, 9.0)
        with tempfile.TemporaryDirectory() as folder:
            lab = lab_in(Path(folder), faults=f"[{{at: {killed_s:.3f}s, kill: 5}}]", loss=0.3, duration="28s")
            try:
                counts["all switched" if check_all_or_none(lab, seed) else "none switched"] += 1
            except AssertionError as error:
                counts["wrong"] += 1
                print(f"wrong: seed {seed}: {error}", flush=True)
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
    return 1 if counts["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main())
