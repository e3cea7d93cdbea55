"""Violations: breaches of a checked rule in a simulated run."""

from typing import Any, NamedTuple

from rmr.base.time import Instant, in_seconds

CONTACT = "contact"
"""The check that bodies do not touch: what `collisions` of the report counts too."""

VIOLATIONS_MAX = 1000
"""Bound of the violations of one run; more of them add no information."""


class Violation(NamedTuple):
    """One breach of one rule."""

    at: Instant
    check: str
    """Which rule, a name of `docs/simulation.md`."""
    robots: tuple[int, ...]
    """The robots concerned."""
    words: str
    """Description of the breach, for people."""

    def as_dict(self) -> dict[str, Any]:
        """Return the entry of the report."""
        return {"t_s": in_seconds(self.at), "check": self.check, "robots": list(self.robots), "words": self.words}
