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
    """The group for which robots contend: the name and the finish fact's arguments without its owner,
    ``crossing(exit)``."""
    text: str
    """The finish fact in program syntax, ``at(@1, exit)``."""
    start: Instant
    deadline: Instant
    bindings: tuple[Value | None, ...]
    """The slots of the assertion: 0 the robot, the others as the start fact bound them."""
    finisher: Robot
    """Owner of the finish fact; if that is another robot, it reports the fact."""
    finish: Instant | None = None
    """When the finish fact was inserted; None if it has not been. A missed job may have one."""
    missed: bool = False
    """Whether the deadline passed before the finish fact, or a report of it, came."""

    @property
    def remote(self) -> bool:
        """Whether another robot reports the finish fact."""
        return self.finisher != self.bindings[SELF_SLOT]

    @property
    def cause(self) -> str | None:
        """Why it was missed: ``network`` if the finish fact was in time and only its report late, else ``local``."""
        if not self.missed:
            return None
        in_time = self.remote and self.finish is not None and self.finish <= self.deadline
        return "network" if in_time else "local"
