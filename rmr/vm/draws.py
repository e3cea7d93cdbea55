"""The numbers that `random()` gives: a stream for each firing of each rule.

A machine evaluates a head when it finds the match. The rule may fire much later, or never. A number must therefore not
depend on numbers that are drawn in the meantime: the stream of a firing is a function of the robot's seed, the rule,
and the number of times that the rule has fired. Engines that evaluate at other times, or twice, draw the same numbers.
So does a replay.
"""

from typing import ClassVar

from rmr.base.streams import Choices, stable_hash


class Draws:
    """The numbers of one firing: SplitMix64, as `Choices`, but with 53 bits of each number."""

    __slots__ = ("_first", "_state")

    SCALE: ClassVar = 1 << 53

    def __init__(self, seed: int, rule: int, firing: int) -> None:
        """The stream of the firing number `firing`, from 0, of a rule on the robot with `seed`."""
        self._first = stable_hash(f"{seed}/{rule}/{firing}")
        self._state = self._first

    def restart(self) -> None:
        """Begin again with the first number."""
        self._state = self._first

    def draw(self) -> float:
        """Return the next number, from 0 up to below 1."""
        one, other = Choices.MULTIPLIERS
        self._state = mixed = (self._state + Choices.GAMMA) & Choices.MASK
        mixed = ((mixed ^ (mixed >> 30)) * one) & Choices.MASK
        mixed = ((mixed ^ (mixed >> 27)) * other) & Choices.MASK
        return ((mixed ^ (mixed >> 31)) >> 11) / self.SCALE
