"""From the lab file's words to what goes wrong: faults of robots' processes, disturbances of the radio.

`radio.links` and `radio.partition` hold for the whole run, those `faults` that concern the radio from one instant
to another; all become `rmr.radio.links.Disturbance`. What befalls processes are values of their own.
"""

from collections.abc import Iterator
from math import inf

from rmr.base.time import NEVER
from rmr.radio.links import Disturbance, partition
from rmr_world.document import Path_
from rmr_world.lab import Fault, Kill, Restart, Stall
from rmr_world.schema import FaultSpec, LinkSpec, RadioSpec


def standing(radio: RadioSpec) -> Iterator[tuple[Path_, Disturbance]]:
    """Yield the disturbances that hold for the whole run, each with where its robots stand in the file."""
    for i, spec in enumerate(radio.links):
        yield ("radio", "links", i, "link"), _harm(spec)
    if radio.partition is not None:
        yield ("radio", "partition"), partition(radio.partition)


def passing(spec: FaultSpec, path: Path_) -> tuple[Path_, Fault | Disturbance]:
    """Return what the fault at `path` is, and where its robots stand in the file."""
    if spec.kill is not None:
        return path, Kill(spec.at or 0, spec.kill)
    if spec.restart is not None:
        return path, Restart(spec.at or 0, spec.restart)
    start, end = spec.from_ or 0, spec.to or NEVER
    if spec.stall is not None:
        return path, Stall(start, end, spec.stall)
    if spec.partition is not None:
        return (*path, "partition"), partition(spec.partition, start, end)
    return (*path, "link"), _harm(spec)._replace(since=start, until=end)


def _harm(spec: LinkSpec | FaultSpec) -> Disturbance:
    """Return what `spec` does to its link, or to all links, for ever."""
    groups = tuple((robot,) for robot in spec.link or ())
    attenuation_db = inf if spec.cut else spec.attenuation_db or 0.0
    return Disturbance(groups=groups, one_way=spec.one_way, loss=spec.loss or 0.0, attenuation_db=attenuation_db)
