"""Facts of a lab with random numbers: ``due(@1, 20..60)`` is another deadline for each seed.

Each fact has a random stream of its own, named by the run's seed, the fact's index in the lab file and the robot that
holds it. With fewer robots, or with another fact at the end of the file, the other numbers stay the same.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from random import Random

from rmr.base.record import record
from rmr.base.streams import stream
from rmr.base.values import Value

STEPS_PER_UNIT = 10
"""Resolution of a range of floats: numbers with one decimal, which read well and suffice for deadlines in seconds."""


@dataclass(frozen=True, slots=True)
class Range:
    """A random number of each run, both ends included: an int between ints, else a float with one decimal."""

    low: int | float
    high: int | float

    def __post_init__(self) -> None:
        """Raise ValueError for a range without a number."""
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
        """Whether the number is an int."""
        return isinstance(self.low, int) and isinstance(self.high, int)

    @property
    def first(self) -> int:
        """The least number, in steps of the resolution."""
        return math.ceil(self.low if self.whole else self.low * STEPS_PER_UNIT)

    @property
    def last(self) -> int:
        """The greatest number, in steps of the resolution."""
        return math.floor(self.high if self.whole else self.high * STEPS_PER_UNIT)

    def draw(self, chance: Random) -> int | float:
        """Return a number of the range, uniformly distributed."""
        step = chance.randint(self.first, self.last)
        return step if self.whole else step / STEPS_PER_UNIT


@record
class StatedFact:
    """An initial fact as the lab file states it."""

    name: str
    owner: int | None
    """None: every robot."""
    args: tuple[Value | Range, ...]
    """Without the owner."""


@record
class LabFact:
    """An initial fact of a run, with its random numbers drawn."""

    name: str
    owner: int | None
    """None: every robot."""
    args: tuple[Value, ...]
    """Without the owner."""


def drawn(fact: StatedFact, index: int, seed: int, roster: Iterable[int]) -> Iterator[LabFact]:
    """Yield the facts of a run for `fact`, of index `index` in the lab file; each robot draws numbers of its own."""
    random = any(isinstance(arg, Range) for arg in fact.args)
    for owner in roster if random and fact.owner is None else (fact.owner,):
        chance = stream(f"{seed}/fact{index}/robot{owner}/number")
        args = tuple(arg.draw(chance) if isinstance(arg, Range) else arg for arg in fact.args)
        yield LabFact(fact.name, owner, args)
