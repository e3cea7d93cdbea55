"""From the lab file's words to what goes wrong: faults of robots, disturbances of the radio.

`radio.links` and `radio.partition` hold for the whole run, those `faults` that concern the radio from one instant
to another; all become `rmr.radio.links.Disturbance`. What befalls robots are values of their own.
"""

from collections.abc import Iterable, Iterator, Sequence
from math import inf

from rmr.base.time import NEVER, in_seconds
from rmr.radio.links import Disturbance, partition
from rmr_world.document import Path_
from rmr_world.lab import Fault, Kill, Outage, Restart, Slow, Stall
from rmr_world.schema import FaultSpec, LinkSpec, RadioSpec


def standing(radio: RadioSpec) -> Iterator[tuple[Path_, Disturbance]]:
    """Yield the disturbances that hold for the whole run, each with where its robots stand in the file."""
    for i, spec in enumerate(radio.links):
        yield ("radio", "links", i, "link"), _harm(spec)
    if radio.partition is not None:
        yield ("radio", "partition"), partition(radio.partition)


def passing(spec: FaultSpec, path: Path_, roster: Sequence[int]) -> Iterator[tuple[Path_, Fault | Disturbance]]:
    """Yield what the fault at `path` is, each with where its robots stand in the file."""
    start, end = spec.from_ or 0, spec.to or NEVER
    if spec.kill is not None:
        yield path, Kill(spec.at or 0, spec.kill)
    elif spec.restart is not None:
        yield path, Restart(spec.at or 0, spec.restart)
    elif spec.stall is not None:
        yield path, Stall(start, end, spec.stall)
    elif spec.slow is not None:
        yield path, Slow(start, end, spec.slow, spec.every or 0)
    elif spec.outage is not None:
        yield from (((*path, "outage"), Outage(start, end, robot)) for robot in spec.outage or roster)
    elif spec.partition is not None:
        yield (*path, "partition"), partition(spec.partition, start, end)
    else:
        yield (*path, "link"), _harm(spec)._replace(since=start, until=end)


def deaths(found: Iterable[tuple[Path_, Fault]]) -> Iterator[tuple[Path_, str]]:
    """Yield where a robot is killed that is dead, or started again while it lives, and a complaint about it."""
    dead: set[int] = set()
    turns = [(path, fault) for path, fault in found if isinstance(fault, Kill | Restart)]
    for path, fault in sorted(turns, key=lambda turn: turn[1].at):
        robot, at = fault.robot, f"at {in_seconds(fault.at):g} s"
        if isinstance(fault, Restart):
            if robot not in dead:
                yield path, f"robot {robot} lives {at}: kill it before it is started again"
            dead.discard(robot)
        elif robot in dead:
            yield path, f"robot {robot} is dead {at}: start it again before it is killed once more"
        else:
            dead.add(robot)


def _harm(spec: LinkSpec | FaultSpec) -> Disturbance:
    """Return what `spec` does to its link, or to all links, for ever."""
    groups = tuple((robot,) for robot in spec.link or ())
    attenuation_db = inf if spec.cut else spec.attenuation_db or 0.0
    return Disturbance(groups=groups, one_way=spec.one_way, loss=spec.loss or 0.0, attenuation_db=attenuation_db)
