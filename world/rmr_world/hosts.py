"""Which host has the world of a lab, routers and robots: `hosts` of a lab file, or of a file of its own (`hosts.yaml`).

The router of the host with the world joins those of all others: its address alone has to be reachable. A file of its
own is read for a certain lab, since what has to be shared out are that lab's robots.
"""

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

from rmr.base.ids import spelled
from rmr.bus.endpoint import DEFAULT_PORT
from rmr_world.document import Document, read
from rmr_world.finding import FilePath, Finding, LabError
from rmr_world.lab import Lab, LabHost
from rmr_world.schema import HostSpec
from rmr_world.validate.schema_conformance import check_hosts_schema


def hosts_of(specs: Mapping[str, HostSpec]) -> tuple[LabHost, ...]:
    """Return the hosts of a file without errors, in its order."""
    return tuple(
        LabHost(
            name,
            spec.address or name,
            DEFAULT_PORT if spec.port is None else spec.port,
            spec.world,
            spec.router is not False,
            tuple(sorted(spec.robots or ())),
        )
        for name, spec in specs.items()
    )


def hub(hosts: Collection[LabHost]) -> LabHost:
    """Return the host with the world, whose router joins those of the others."""
    return next(host for host in hosts if host.has_world)


def read_hosts(path: Path, lab: Lab) -> tuple[LabHost, ...]:
    """Return the hosts in the file `path`, which share out the robots of `lab`. Raises LabError with all errors."""
    document = read(path)
    specs = check_hosts_schema(document).hosts
    errors = [*document.errors, *host_errors(document, specs, lab.roster, lab.name)]
    if errors:
        raise LabError(errors)
    return hosts_of(specs)


def host_errors(
    document: Document, specs: Mapping[str, HostSpec], roster: Collection[int] | None, lab: str
) -> Iterator[Finding]:
    """Yield what is wrong with the `hosts` of a document; `roster` None: the lab's robots are not known."""
    yield from _world_errors(document, specs)
    yield from _work_errors(document, specs)
    yield from _robot_errors(document, specs, roster, lab)


def _world_errors(document: Document, specs: Mapping[str, HostSpec]) -> Iterator[Finding]:
    """One host has the world, and a router."""
    worlds = [name for name, spec in specs.items() if spec.world]
    if not worlds:
        yield document.finding(("hosts",), "no host has the world: give one of them world: true", key=True)
    for name in worlds[1:]:
        line = _line(document, ("hosts", worlds[0], "world"))
        message = f"host {worlds[0]} has the world already (line {line}): a lab has one"
        yield document.finding(("hosts", name, "world"), message)
    for name in worlds:
        if specs[name].router is False:
            message = "the host with the world has the router that joins the others: leave router out"
            yield document.finding(("hosts", name, "router"), message)


def _work_errors(document: Document, specs: Mapping[str, HostSpec]) -> Iterator[Finding]:
    """Each host has something to do, and a router that no other host has."""
    listening: dict[tuple[str, int], str] = {}
    for name, host in zip(specs, hosts_of(specs), strict=True):
        if not host.has_world and not host.robots and specs[name].router is not True:
            yield document.finding(
                ("hosts", name), "has nothing to do: give it robots: 1-3, world: true or router: true"
            )
        if specs[name].router is False and specs[name].port is not None:
            yield document.finding(("hosts", name, "port"), "is that of the router, which this host does not have")
        if not host.has_router:
            continue
        other = listening.setdefault((host.address.lower(), host.port), name)
        if other != name:
            part = "port" if specs[name].port is not None else "address"
            message = f"the router of host {other} is at {host.address}:{host.port} already: give them other ports"
            yield document.finding(("hosts", name, part), message)


def _robot_errors(
    document: Document, specs: Mapping[str, HostSpec], roster: Collection[int] | None, lab: str
) -> Iterator[Finding]:
    """Each robot of the lab is on one host, and no host has any other."""
    homes: dict[int, str] = {}
    for name, spec in specs.items():
        path = ("hosts", name, "robots")
        robots = spec.robots or []
        for robot in dict.fromkeys(robots):
            home = homes.setdefault(robot, name)
            if robots.count(robot) > 1:
                yield document.finding(path, f"robot {robot} is listed twice")
            if home != name:
                line = _line(document, ("hosts", home, "robots"))
                yield document.finding(path, f"robot {robot} is on host {home} already (line {line})")
        unknown = sorted(set(robots).difference(robots if roster is None else roster))
        if unknown:
            message = f"{_robots(unknown)} not in lab {lab}, which has {spelled(sorted(roster or ()))}"
            yield document.finding(path, message)
    nowhere = sorted(set(roster or ()).difference(homes))
    if nowhere:
        yield document.finding(("hosts",), f"{_robots(nowhere)} on no host: add robots to one of them", key=True)


def _robots(robots: list[int]) -> str:
    return f"robot {robots[0]} is" if len(robots) == 1 else f"robots {spelled(robots)} are"


def _line(document: Document, path: FilePath) -> int:
    return document.places.get(path, (0, 0))[0]
