"""Random numbers in a lab's facts: ``due(@1, 20..60)`` is another deadline under each seed.

Each fact has a stream of its own, named by the run's seed, the fact's place in the lab file and the robot that holds
it: a lab with fewer robots, or with one more fact at its end, leaves the numbers of the others as they were.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from random import Random

from rmr.base.streams import stream
from rmr.base.values import Value

STEPS_PER_UNIT = 10
"""A range of floats gives numbers with one decimal: what people read, and fine enough for deadlines in seconds."""


@dataclass(frozen=True, slots=True)
class Range:
    """A number that each run draws anew, both ends included: an int between ints, else a float with one decimal."""

    low: int | float
    high: int | float

    def __post_init__(self) -> None:
        """Refuse a range that holds no number. Raises ValueError."""
        if self.low > self.high:
            raise ValueError(f"the range {self} is the wrong way round: its smaller end comes first")
        if any(math.isinf(end * STEPS_PER_UNIT) for end in (self.low, self.high)):
            raise ValueError(f"the range {self} is too large")
        if self.first > self.last:
            raise ValueError(f"the range {self} holds no number with one decimal")

    def __str__(self) -> str:
        return f"{self.low}..{self.high}"

    @property
    def whole(self) -> bool:
        """Whether it gives ints."""
        return isinstance(self.low, int) and isinstance(self.high, int)

    @property
    def first(self) -> int:
        """The least number, counted in the steps between two numbers."""
        return math.ceil(self.low if self.whole else self.low * STEPS_PER_UNIT)

    @property
    def last(self) -> int:
        """The greatest number, likewise."""
        return math.floor(self.high if self.whole else self.high * STEPS_PER_UNIT)

    def draw(self, chance: Random) -> int | float:
        """Return one of its numbers, each as likely as the others."""
        step = chance.randint(self.first, self.last)
        return step if self.whole else step / STEPS_PER_UNIT


@dataclass(frozen=True, slots=True)
class StatedFact:
    """An initial fact as the lab file states it."""

    name: str
    owner: int | None
    """None: every robot."""
    args: tuple[Value | Range, ...]
    """Without the owner."""


@dataclass(frozen=True, slots=True)
class LabFact:
    """An initial fact of a run: nothing in it is left to chance any more."""

    name: str
    owner: int | None
    """None: every robot."""
    args: tuple[Value, ...]
    """Without the owner."""


def drawn(fact: StatedFact, index: int, seed: int, roster: Iterable[int]) -> Iterator[LabFact]:
    """Yield what `fact`, number `index` of the lab file, becomes in a run; every robot draws for itself."""
    random = any(isinstance(arg, Range) for arg in fact.args)
    for owner in roster if random and fact.owner is None else (fact.owner,):
        chance = stream(f"{seed}/fact{index}/robot{owner}/number")
        args = tuple(arg.draw(chance) if isinstance(arg, Range) else arg for arg in fact.args)
        yield LabFact(fact.name, owner, args)
