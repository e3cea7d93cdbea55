"""Explained delays of many runs: the intervals of each job must sum exactly to its time.

A little of it is `test_delay_sums.py`. Run as a program for a long campaign: ``python delay_campaign.py FIRST LAST``
for the rush, with the name of a provided lab behind for that lab under drawn faults; each failing seed is printed.
"""

import sys
import tempfile
from collections import Counter
from pathlib import Path

from delay_runs import LABS, RUSH, check_run, recorded

from rmr.why.delay import TimeOwner

KINDS = ((), ("--loss", "0.6"), ("--chaos",))
"""Of three seeds one runs as the lab file says, one loses most frames, one has drawn faults: so more are missed."""


def checked(folder: Path, seed: int, *words: str) -> Counter[TimeOwner]:
    """Check a run of the rush; return the nanoseconds of each owner."""
    return check_run(folder / str(seed), recorded(RUSH, folder / str(seed), "--seed", str(seed), *words))


def check_drawn(folder: Path, seed: int) -> None:
    """Check the run of the campaign with this seed."""
    checked(folder, seed, *KINDS[seed % 3])


def check_lab(folder: Path, lab: str, seed: int, *words: str) -> None:
    """Check a run of a provided lab under drawn faults."""
    run = recorded(LABS / lab, folder / str(seed), "--seed", str(seed), "--chaos", *words)
    check_run(folder / str(seed), run)


def main(first: int, last: int, *lab: str) -> int:
    """Check the runs of seeds `first` to `last`, of the rush or of a lab; return 1 if one fails."""
    failed = False
    for seed in range(first, last + 1):
        with tempfile.TemporaryDirectory() as folder:
            try:
                if lab:
                    check_lab(Path(folder), *lab, seed)
                else:
                    check_drawn(Path(folder), seed)
            except AssertionError as error:
                failed = True
                print(f"seed {seed}: {error}", flush=True)
    print(f"runs: {last - first + 1}")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:4]))
