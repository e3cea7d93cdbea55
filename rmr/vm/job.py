"""A job: one robot's timed work, from the start fact of a time assertion to its finish fact (paper III.E)."""

from dataclasses import dataclass

from rmr.base.time import Duration, Instant
from rmr.base.values import Robot, Value
from rmr.bytecode.program import SELF_SLOT


@dataclass(slots=True, eq=False)
class TimedJob:
    """One job; it changes while it runs and stands in the report afterwards."""

    serial: int
    """From 1, in the order of the starts."""
    assertion: int
    """Index into the program's assertions; -1: the present program has none for it."""
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
    queued: Duration = 0
    """Time for which deliveries of its robot that serve it have waited for others to leave; the host keeps it."""
    ended: bool = False
    """Whether a new program without its assertion has ended it: it is neither met nor missed."""
    stuck: bool = False
    """Whether such a delivery still waited when the deadline passed."""

    @property
    def remote(self) -> bool:
        """Whether another robot reports the finish fact."""
        return self.finisher != self.bindings[SELF_SLOT]

    @property
    def cause(self) -> str | None:
        """Why it was missed: ``network``, ``queue`` or ``local``; None if it was not.

        ``network``: the finish fact was in time and only its report late. ``queue``: a delivery that serves the job
        waited behind others when the deadline passed, or such deliveries had waited for longer than the finish fact was
        late.
        """
        if not self.missed:
            return None
        late = None if self.finish is None else self.finish - self.deadline
        if self.remote and late is not None and late <= 0:
            return "network"
        return "queue" if self.stuck or (late is not None and late < self.queued) else "local"
