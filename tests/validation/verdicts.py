"""Verdicts: what a check is, when it is met, and what a comparison adds up to.

A check sets one quantity of our model beside the same quantity of the reference. It is *met* if the two differ by at
most the tolerance, *missed* if they differ by more, and only *shown* if it is not judged, for a stated reason. Both
sides may have a 95 % interval. A full comparison runs until our interval is narrow beside the tolerance and then
judges means alone. A short one cannot: it adds its `slack`, what chance allows two means to differ in one of
about 10,000 comparisons, so that with fixed seeds it fails for a broken rule and not for bad luck.

Where a quantity is no number (a set of values, a formula's text), the two sides have to be equal.
Pure data: nothing here knows the radio.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import hypot, isfinite, nan, sqrt
from typing import Any, NamedTuple

Data = dict[str, Any]

MET, MISSED, SHOWN = "met", "missed", "shown"
SLACK_INTERVALS = 2.0
"""Half-widths of the joint 95 % interval that a short comparison allows besides the tolerance: 4 deviations."""
NARROW = 0.5
"""A full comparison's half-width is at most this part of the tolerance."""


class Estimate(NamedTuple):
    """A mean and half the width of its 95 % interval; 0 for what is exact."""

    mean: float
    half: float = 0.0


Value = float | int | str | bool | list[Any]


@dataclass(frozen=True, slots=True)
class Check:
    """One quantity, ours and the reference's."""

    file: str
    """Name of the reference file, without ending."""
    row: str
    """Which of its scenarios, in words."""
    quantity: str
    ours: Value
    theirs: Value
    ours_half: float = 0.0
    theirs_half: float = 0.0
    tolerance: float | None = None
    """Greatest difference that is met; 0 for equality. None: not judged."""
    unjudged: str = ""
    """Why it is not judged."""
    slack: float = 0.0

    @property
    def difference(self) -> float | None:
        """Return ours less the reference's, None if they are no numbers."""
        if isinstance(self.ours, int | float) and isinstance(self.theirs, int | float):
            return self.ours - self.theirs
        return None

    @property
    def verdict(self) -> str:
        """Return ``met``, ``missed`` or ``shown``."""
        if self.tolerance is None:
            return SHOWN
        difference = self.difference
        if difference is None:
            return MET if self.ours == self.theirs else MISSED
        # Without a number of ours (nothing was delivered at all) the comparison has failed. The last digit is rounding.
        bound = (self.tolerance + self.slack) * (1 + 1e-9)
        return MET if isfinite(difference) and abs(difference) <= bound else MISSED

    @property
    def narrow(self) -> bool:
        """Whether our interval is narrow enough for the tolerance to mean something."""
        return not self.tolerance or self.ours_half <= NARROW * self.tolerance

    @property
    def name(self) -> str:
        """Return what identifies the check."""
        return f"{self.file}: {self.row}: {self.quantity}"

    def as_data(self) -> Data:
        """Return the check as it stands in the JSON."""
        data: Data = {"file": self.file, "row": self.row, "quantity": self.quantity}
        data |= {"ours": _short(self.ours), "theirs": _short(self.theirs)}
        if self.ours_half or self.theirs_half:
            data |= {"ours_half": _short(self.ours_half), "theirs_half": _short(self.theirs_half)}
        if self.difference is not None:
            data["difference"] = _short(self.difference)
        data["tolerance"] = _short(self.tolerance)
        if self.unjudged:
            data["unjudged"] = self.unjudged
        return data | {"verdict": self.verdict}


def _short(value: Any) -> Any:
    """Return a number with six digits and without what JSON has no word for."""
    if isinstance(value, float):
        return float(f"{value:.6g}") if isfinite(value) else None
    return value


def compared(
    where: tuple[str, str, str],
    ours: Estimate,
    theirs: Estimate,
    tolerance: float | None,
    unjudged: str = "",
    slack: bool = False,
) -> Check:
    """Return the check of two estimates; `where` is its file, row and quantity."""
    allowed = SLACK_INTERVALS * hypot(ours.half, theirs.half) if slack else 0.0
    return Check(*where, ours.mean, theirs.mean, ours.half, theirs.half, tolerance, unjudged, allowed)


def equal(where: tuple[str, str, str], ours: Value, theirs: Value) -> Check:
    """Return the check that two values are the same."""
    return Check(*where, ours, theirs, tolerance=0.0)


def estimate(field: Data) -> Estimate:
    """Return a field of the reference's form, ``{mean, ci95, ...}`` or ``{p, ci95, ...}``; NaN without an interval."""
    if field["ci95"] is None:
        return Estimate(nan)
    low, high = field["ci95"]
    return Estimate(float(field["mean"] if "mean" in field else field["p"]), (high - low) / 2.0)


def proportion(successes: int, trials: int) -> Estimate:
    """Return a proportion with half the width of its 95 % interval after Wilson (1927)."""
    z, p = 1.96, successes / trials
    return Estimate(p, z / (1.0 + z * z / trials) * sqrt(p * (1.0 - p) / trials + z * z / (4.0 * trials * trials)))


def missed(checks: Iterable[Check]) -> list[Check]:
    """Return the checks that are missed."""
    return [check for check in checks if check.verdict == MISSED]


def tally(checks: Sequence[Check]) -> list[tuple[str, int, int, int]]:
    """Return for each file, in order of appearance, how many checks are met, missed and shown."""
    files = dict.fromkeys(check.file for check in checks)
    counts = {file: [0, 0, 0] for file in files}
    for check in checks:
        counts[check.file][(MET, MISSED, SHOWN).index(check.verdict)] += 1
    return [(file, *counts[file]) for file in files]
