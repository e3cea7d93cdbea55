"""A job: one robot's timed work, from the start fact of a time assertion to its finish fact (paper III.E)."""

from dataclasses import dataclass

from rmr.base.time import Instant
from rmr.base.values import Robot, Value
from rmr.bytecode.program import SELF_SLOT


@dataclass(slots=True, eq=False)
class TimedJob:
    """One job; it changes while it runs and stands in the report afterwards."""

    serial: int
    """From 1, in the order of the starts."""
    assertion: int
    """Index into the program's assertions."""
    name: str
    """The assertion's name, else the predicate of its finish fact."""
    event: str
    """What robots contend for: the name and the finish fact's arguments but for the owner, ``crossing(exit)``."""
    text: str
    """The finish fact in program syntax, ``at(@1, exit)``."""
    start: Instant
    deadline: Instant
    bindings: tuple[Value | None, ...]
    """The slots of the assertion: 0 the robot, the others as the start fact bound them."""
    finisher: Robot
    """The finish fact's robot; if it is another one, that robot reports."""
    finish: Instant | None = None
    """When the finish fact was inserted; of a missed job that is late."""
    missed: bool = False
    """The deadline passed before the finish fact."""

    @property
    def remote(self) -> bool:
        """Whether another robot reports the finish fact."""
        return self.finisher != self.bindings[SELF_SLOT]

    @property
    def cause(self) -> str | None:
        """Why it was missed: ``network`` if the finish fact was in time and only the news late, else ``local``."""
        if not self.missed:
            return None
        in_time = self.remote and self.finish is not None and self.finish <= self.deadline
        return "network" if in_time else "local"
