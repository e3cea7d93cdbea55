"""Faults of a lab file as values: the schema's models become faults of robots and disturbances of the radio.

`radio.links` and `radio.partition` hold for the whole run; an entry of `faults` holds at an instant or for a span. All
that concerns the radio becomes `rmr.radio.links.Disturbance`. Each value comes with the path of the robots in the file.
"""

from collections.abc import Iterator, Sequence
from math import inf

from rmr.base.time import NEVER
from rmr.radio.links import Disturbance, deafened, muted, partition
from rmr_world.finding import FilePath
from rmr_world.lab import Fault, Kill, Outage, Restart, Slow, Stall
from rmr_world.schema import FaultSpec, LinkSpec, RadioSpec


def permanent_faults(radio: RadioSpec) -> Iterator[tuple[FilePath, Disturbance]]:
    """Yield the disturbances that hold for the whole run."""
    for i, spec in enumerate(radio.links):
        yield ("radio", "links", i, "link"), _disturbance(spec)
    if radio.partition is not None:
        yield ("radio", "partition"), partition(radio.partition)


def timed_faults(
    spec: FaultSpec, path: FilePath, roster: Sequence[int]
) -> Iterator[tuple[FilePath, Fault | Disturbance]]:
    """Yield the faults of the entry at `path`; an outage of all robots is one fault for each of `roster`."""
    start = spec.from_ or 0
    end = spec.to or NEVER
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
        yield (*path, "partition"), partition(spec.partition, start, end)._replace(one_way=spec.one_way)
    elif spec.mute is not None or spec.deaf is not None:
        yield from _mute_or_deaf(spec, path, roster)
    else:
        yield (*path, "link"), _disturbance(spec)._replace(since=start, until=end)


def _mute_or_deaf(spec: FaultSpec, path: FilePath, roster: Sequence[int]) -> Iterator[tuple[FilePath, Disturbance]]:
    """Yield the cut of all frames from or to one robot; none in a lab without other robots."""
    for key, robot, cut in (("mute", spec.mute, muted), ("deaf", spec.deaf, deafened)):
        if robot is not None and any(other != robot for other in roster):
            yield (*path, key), cut(robot, roster, spec.from_ or 0, spec.to or NEVER)


def _disturbance(spec: LinkSpec | FaultSpec) -> Disturbance:
    """Return the effect of `spec` on its link, or on all links if it names none, without an end."""
    groups = tuple((robot,) for robot in spec.link or ())
    attenuation_db = inf if spec.cut else spec.attenuation_db or 0.0
    return Disturbance(groups=groups, one_way=spec.one_way, loss=spec.loss or 0.0, attenuation_db=attenuation_db)
