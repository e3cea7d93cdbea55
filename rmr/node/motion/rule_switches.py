"""Which rules of motion are in force, and how often each has had an effect: for ablation experiments.

All rules are in force by default. An experiment leaves some out by name, and reads afterwards which ones fired: a run
in which a rule never had an effect is the same, to the octet, as the run without that rule.
"""

from typing import Final, final


@final
class RuleSwitches:
    """The rules that are left out, and the counts of all others."""

    __slots__ = ("firings", "without")

    def __init__(self, without: frozenset[str] = frozenset(), firings: dict[str, int] | None = None) -> None:
        """`firings` is counted into; robots of one simulation share it."""
        self.without: Final = without
        self.firings: Final[dict[str, int]] = {} if firings is None else firings

    def off(self, name: str) -> bool:
        """Return whether the rule called `name` is left out."""
        return name in self.without

    def count(self, name: str) -> None:
        """Note that the rule called `name` has had an effect."""
        self.firings[name] = self.firings.get(name, 0) + 1
