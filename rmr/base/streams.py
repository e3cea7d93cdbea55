"""Named random streams: every source of chance has a name of its own.

`stream("7/robot3/csma")` gives the same numbers on every machine and under every PYTHONHASHSEED (the name is
hashed with SHA-512 by `random.Random`), and drawing from one stream never disturbs another.
"""

import hashlib
import math
from random import Random
from typing import ClassVar, Final

SEED_MAX: Final = 10**18 - 1
"""Largest seed of a lab, sent to the robots in 64 bits; the smallest is 0."""


def stream(name: str) -> Random:
    """Return the random stream called `name`, for example ``"7/robot3/vm"``."""
    return Random(name)


class Normals:
    """Standard normal numbers, equal to those of `rng.gauss(0.0, 1.0)`, in half of its time.

    Other numbers may be drawn from `rng` in between, but not by `gauss`, which has a buffer of its own.
    """

    __slots__ = ("_another", "_random", "_second")

    def __init__(self, rng: Random) -> None:
        self._random = rng.random
        self._second = 0.0
        self._another = False

    def draw(self) -> float:
        """Return the next number. They are made in pairs (Box and Muller, 1958)."""
        if self._another:
            self._another = False
            return self._second
        angle = self._random() * math.tau
        away = math.sqrt(-2.0 * math.log(1.0 - self._random()))
        self._second = math.sin(angle) * away
        self._another = True
        return math.cos(angle) * away


class Choices:
    """A random stream with 8 octets of state, for a robot's choice among satisfied rules.

    SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014). A million
    robots in columns of numpy draw the same numbers as a million machines.
    """

    __slots__ = ("state",)

    GAMMA: ClassVar = 0x9E3779B97F4A7C15
    MULTIPLIERS: ClassVar = (0xBF58476D1CE4E5B9, 0x94D049BB133111EB)
    MASK: ClassVar = (1 << 64) - 1

    def __init__(self, name: str) -> None:
        """The stream called `name`, for example ``"7/robot3/vm"``."""
        self.state = stable_hash(name)

    def below(self, bound: int) -> int:
        """Return a number of 0 .. `bound` - 1, uniform up to a bias of `bound` in 2**32."""
        one, other = self.MULTIPLIERS
        self.state = mixed = (self.state + self.GAMMA) & self.MASK
        mixed = ((mixed ^ (mixed >> 30)) * one) & self.MASK
        mixed = ((mixed ^ (mixed >> 27)) * other) & self.MASK
        return ((mixed ^ (mixed >> 31)) >> 32) * bound >> 32


def stable_hash(text: str, octets: int = 8) -> int:
    """Return an unsigned hash of `text` that is the same in every process (BLAKE2b, `octets` long)."""
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=octets).digest(), "big")


def uniform(*parts: int | str) -> float:
    """Return a number in [0, 1) that is a function of `parts` alone, equal in all processes."""
    return stable_hash("/".join(map(str, parts)), 7) / (1 << 56)
