"""The newest schedule that a robot has heard, part by part.

Schedules of many robots come in many frames, and every robot receives every frame. So the properties of a part are
computed once when it is received: queries cost time in proportion to the parts, not to their entries.
"""

from functools import lru_cache
from itertools import chain
from typing import NamedTuple

from rmr.base.direction import leads_together
from rmr.base.time import NEVER, Instant
from rmr.coord.messages import OVER, Entry, Phase, Sched, encode
from rmr.coord.term import NO_TERM, NOBODY
from rmr.coord.timing import RECORDS_MAX


class Extract(NamedTuple):
    """What is asked of the entries of one part."""

    at: dict[tuple[int, Instant], int]
    """The first position of each job, by robot and trigger."""
    coming: tuple[int, ...]
    """The robots of the entries that are not over."""
    over: tuple[tuple[int, Instant], ...]
    """The jobs that have said so; not those that are presumed to be."""
    dated: tuple[int, ...]
    """The robots that have a slot."""
    listed: int
    """How many entries hold a job that the leader knows."""


@lru_cache(maxsize=256)
def extract(entries: tuple[Entry, ...]) -> Extract:
    """Return what is asked of `entries`."""
    at: dict[tuple[int, Instant], int] = {}
    for position, entry in enumerate(entries):
        at.setdefault((entry.robot, entry.trigger), position)
    named = [entry for entry in entries if entry.robot != NOBODY]
    return Extract(
        at,
        tuple([entry.robot for entry in entries if entry.phase not in OVER]),
        tuple([(entry.robot, entry.trigger) for entry in named if entry.phase is Phase.OUT]),
        tuple([entry.robot for entry in named if entry.start is not None]),
        sum(entry.phase is not Phase.PROVISIONAL for entry in named),
    )


class KnownSchedule:
    """The newest schedule known: per part the newest frame of one term."""

    __slots__ = ("_directions", "_extracts", "_full", "formed", "issued", "order", "parts", "term")

    def __init__(self, full: int) -> None:
        """`full` is how many entries all parts but the last have."""
        self._full = full
        self.term = NO_TERM
        self.parts: dict[int, Sched] = {}
        self._extracts: dict[int, Extract] = {}
        """Of the parts, in their order."""
        self.issued: Instant = -NEVER
        """The newest instant of issue; far in the past when nothing is held."""
        self.order: tuple[int, ...] = ()
        self.formed: Instant = 0
        self._directions: dict[int, int] = {}
        """Ways by rank, also of jobs that are listed no more."""

    @property
    def resigned(self) -> bool:
        """Whether the newest frame is a resignation."""
        return any(part.resign for part in self.parts.values())

    @property
    def opening(self) -> bool:
        """Whether the leader still gathers jobs before it gives slots."""
        return any(part.opens for part in self.parts.values())

    def take(self, sched: Sched) -> None:
        """Hold `sched` in place of what it supersedes."""
        if sched.term != self.term:
            self.term = sched.term
            self.parts = {}
            self._extracts = {}
        known = sched.part in self.parts
        self.parts[sched.part] = sched
        self._extracts[sched.part] = extract(sched.entries)
        for part in [p for p in self.parts if p >= sched.parts]:
            del self.parts[part], self._extracts[part]
        if not known:
            self._extracts = dict(sorted(self._extracts.items()))
        self.issued = max([part.issued for part in self.parts.values()], default=-NEVER)
        first = self._first_rank(sched)
        for rank, entry in enumerate(sched.entries, first):
            if entry.robot != NOBODY:
                self._directions[rank] = entry.direction
        if first > RECORDS_MAX:
            for rank in [rank for rank in self._directions if rank <= first - RECORDS_MAX]:
                del self._directions[rank]

    def _first_rank(self, part: Sched) -> int:
        return part.passed + self._full * part.part + 1

    def place(self, rank: int, direction: int) -> int:
        """Return the place of `rank` among the robots that leave by the end of its direction, from 1.

        Ranks never seen count as such.
        """
        others = [each for each in dict.fromkeys(self._directions.values()) if not leads_together(direction, each)]
        return rank - sum([earlier < rank and other in others for earlier, other in self._directions.items()])

    def find(self, robot: int, trigger: Instant) -> tuple[Sched, int, Entry] | None:
        """Return the part, the rank and the entry of a job; None when no part lists it.

        A job that has moved is listed by the part that it left until that is heard anew: the newer one is right.
        """
        found: tuple[Sched, int, Entry] | None = None
        job = robot, trigger
        for number, part in self.parts.items():
            position = self._extracts[number].at.get(job)
            if position is not None and (found is None or part.issued > found[0].issued):
                found = part, self._first_rank(part) + position, part.entries[position]
        return found

    def has(self, part: Sched) -> bool:
        """Return whether the same ranks of the same schedule are held, be it with other jobs."""
        known = self.parts.get(part.part)
        return known is not None and (known.passed, known.parts, known.opens == 0) == (
            part.passed,
            part.parts,
            part.opens == 0,
        )

    def complete(self) -> bool:
        """Return whether all parts of one issue are held."""
        parts = list(self.parts.values())
        return bool(parts) and len(parts) == parts[0].parts and len({part.issued for part in parts}) == 1

    def entries(self) -> list[Entry]:
        """Return all entries by rank."""
        return [entry for part in sorted(self.parts) for entry in self.parts[part].entries]

    def coming(self) -> list[int]:
        """Return the robots of the entries that are not over, by rank."""
        return list(chain.from_iterable([one.coming for one in self._extracts.values()]))

    def dated(self) -> tuple[int, ...]:
        """Return the robots that have a slot, by rank."""
        return tuple(chain.from_iterable([one.dated for one in self._extracts.values()]))

    @property
    def listed(self) -> int:
        """How many entries hold a job that the leader knows."""
        return sum([one.listed for one in self._extracts.values()])

    def raw(self) -> list[bytes]:
        """Return the frames, to be relayed unchanged."""
        return [encode(self.parts[part]) for part in sorted(self.parts)]
