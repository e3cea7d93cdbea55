"""The crossings of one robot by group, and the names of groups.

A group is named by six octets that all robots of a program work out alike: those of an event, of a station, or of a
passage that all events share. A crossing begins in the group of its event, or in one of its own if it is that of a
drive; it moves on to the passages on its way, and is found by its event wherever it is.
"""

from collections.abc import Iterator

from rmr.base.streams import stable_hash
from rmr.base.time import Instant
from rmr.node.actions.dispatcher import RunningAction
from rmr.node.crossing.crossing import Crossing
from rmr.node.crossing.shared_path import GROUPS_KEPT
from rmr.vm.job import TimedJob


class CrossingTable:
    """The crossings of one robot, the newest last."""

    def __init__(self, digest: int) -> None:
        """`digest`: of the program."""
        self._digest = digest
        self._by_group: dict[bytes, Crossing] = {}
        self._drives = 0
        """Crossings of drives that were named so far."""

    def __iter__(self) -> Iterator[Crossing]:
        """Iterate over the crossings as they are now, oldest first."""
        return iter(list(self._by_group.values()))

    def __reversed__(self) -> Iterator[Crossing]:
        return reversed(list(self._by_group.values()))

    # -- names ----------------------------------------------------------------------------------------------

    def _id(self, name: str) -> bytes:
        return stable_hash(f"{self._digest}/{name}", 6).to_bytes(6, "big")

    def event_id(self, job: TimedJob, step: str = "") -> bytes:
        """Return the name of the group of `job`, or of a `step` of it: program, assertion and finish arguments.

        An action may have the name of the assertion, and the same arguments.
        """
        return self._id(f"{job.assertion}/{f'step {step}' if step else job.event}")

    def station_id(self, area: str) -> bytes:
        """Return the name of the group of those that drive into a station, whatever their events."""
        return self._id(f"station/{area}")

    def passage_id(self, passage: str) -> bytes:
        """Return the name of the group of those that drive through a passage, whatever their events."""
        return self._id(f"passage/{passage}")

    def drive_id(self) -> bytes:
        """Return a new name for the group of one drive, which asks in none until it passes something."""
        self._drives += 1
        return self._id(f"drive/{self._drives}")

    # -- entries --------------------------------------------------------------------------------------------

    def at(self, group_id: bytes) -> Crossing | None:
        """Return the crossing that is in a group."""
        return self._by_group.get(group_id)

    def of_event(self, event_id: bytes) -> Crossing | None:
        """Return the crossing of an event, in whatever group it is."""
        found = self._by_group.get(event_id)
        if found is not None and found.event_id == event_id:
            return found
        return next((each for each in self._by_group.values() if each.event_id == event_id), None)

    def of_job(self, job: TimedJob) -> Crossing | None:
        """Return the crossing of the event of `job`, if that is the one of this very job."""
        crossing = self.of_event(self.event_id(job))
        return None if crossing is None or crossing.job is not job else crossing

    def add(self, crossing: Crossing) -> list[bytes]:
        """Take in a crossing as the newest of its group; return the groups that are forgotten.

        The oldest crossings that are over are dropped, so that memory is bounded.
        """
        self._by_group.pop(crossing.group_id, None)
        self._by_group[crossing.group_id] = crossing
        over = [group_id for group_id, each in self._by_group.items() if each.over]
        dropped = over[: max(0, len(self._by_group) - GROUPS_KEPT)]
        for group_id in dropped:
            del self._by_group[group_id]
        return dropped

    def remove(self, crossing: Crossing) -> None:
        """Take a crossing out."""
        if self._by_group.get(crossing.group_id) is crossing:
            del self._by_group[crossing.group_id]

    def move(self, crossing: Crossing, group_id: bytes, trigger: Instant = 0) -> list[bytes]:
        """Take a crossing to another group, where its next trigger is at `trigger` or later; return as `add` does."""
        self.remove(crossing)
        crossing.move(group_id, trigger)
        return self.add(crossing)


def crossing_of(running: RunningAction | None) -> Crossing | None:
    """Return the crossing by which an action goes."""
    permit = None if running is None else running.permit
    return permit if isinstance(permit, Crossing) else None


def gate_of(running: RunningAction | None) -> Crossing | None:
    """Return the crossing by which a drive goes through the passages on its way."""
    gate = None if running is None else running.gate
    return gate if isinstance(gate, Crossing) else crossing_of(running)
