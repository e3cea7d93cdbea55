"""The share of one host in a lab over several: `rmr up LAB --hosts FILE --here HOST`.

The host with the world has the router to which the processes of all others connect; no other one is needed. What all
hosts have to agree on is put into words here, so that their launchers can compare it before any robot starts.
"""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rmr import __version__
from rmr.bus.endpoint import is_loopback
from rmr.entry import ExitCode
from rmr_deploy.resolved_lab import resolved_lab
from rmr_deploy.run_options import RunOptions
from rmr_world.finding import LabError
from rmr_world.hosts import hub, read_hosts
from rmr_world.lab import Lab, LabHost

WAIT_S: Final = 300.0
"""How long hosts wait for each other by default: a person goes from machine to machine."""

OWN_FIELDS: Final = ("file", "program", "actions", "seed", "hosts")
"""Fields of a resolved lab that may differ between hosts, or are compared otherwise."""

WORLD_OPTIONS: Final = {
    "seed": "--seed",
    "as_json": "--json",
    "strict": "--strict",
    "record": "--record",
    "view": "--view",
    "port": "--port",
    "control": "--control",
    "watch": "--watch",
    "keep_going": "--keep-going",
}
"""Options about the whole run, by their field: the launcher of the world's host alone has it in its hands."""


class ShareError(Exception):
    """The options do not give this host a share: why, for people, and the exit code."""

    def __init__(self, message: str, exit_code: int = ExitCode.USAGE) -> None:
        super().__init__(message)
        self.exit_code = exit_code


@dataclass(frozen=True, slots=True)
class HostShare:
    """What one host does for a lab over several."""

    here: LabHost
    hosts: tuple[LabHost, ...]
    wait_s: float
    """How long it waits for the others."""
    protocol: str
    """`tcp`, or `tls` with keys."""
    opened: bool
    """Whether everybody is let in who reaches the world's host."""

    @property
    def hub(self) -> LabHost:
        """The host with the world."""
        return hub(self.hosts)

    @property
    def has_world(self) -> bool:
        """Whether this is it."""
        return self.here.has_world

    @property
    def listen(self) -> str:
        """Where the router listens: at all addresses of its host, unless others reach it by loopback."""
        if is_loopback(self.hub.endpoint(self.protocol)):
            return self.hub.endpoint(self.protocol)
        anywhere = "[::]" if ":" in self.hub.address else "0.0.0.0"
        return f"{self.protocol}/{anywhere}:{self.hub.port}"

    @property
    def connect(self) -> str:
        """Where the processes of this host find the router."""
        if not self.has_world:
            return self.hub.endpoint(self.protocol)
        return self.listen.replace("[::]", "[::1]").replace("0.0.0.0", "127.0.0.1")

    def host_of(self, robot: int) -> str:
        """Return the name of the host of a robot."""
        return next(host.name for host in self.hosts if robot in host.robots)


def share_of(lab: Lab, options: RunOptions) -> HostShare | None:
    """Return the share of the host that `options` name in `lab`; None for a run on one machine. Raises ShareError."""
    if options.here is None:
        _check_no_share(lab, options)
        return None
    if options.robots is not None:
        raise ShareError("rmr up: --robots goes without --here: the hosts have all robots of the lab")
    try:
        hosts = lab.hosts if options.hosts is None else read_hosts(options.hosts, lab)
    except LabError as error:
        raise ShareError(str(error), ExitCode.INVALID) from None
    if not hosts:
        raise ShareError(f"rmr up: {lab.path} has no hosts: name a file that has with --hosts FILE")
    named = [host for host in hosts if host.name == options.here]
    where = options.hosts or lab.path
    if not named:
        names = ", ".join(host.name for host in hosts)
        raise ShareError(f"rmr up: {where} has no host {options.here}: its hosts are {names}")
    here = named[0]
    if not here.has_world and not here.robots:
        raise ShareError(
            f"rmr up: host {here.name} has neither the world nor robots, so there is nothing to start; "
            "rmr router starts a router there"
        )
    first = hub(hosts)
    if not here.has_world and (told := [word for field, word in WORLD_OPTIONS.items() if getattr(options, field)]):
        raise ShareError(f"rmr up: {told[0]} goes with the host of the world, {first.name}, not with {here.name}")
    protocol = "tls" if lab.mtls else "tcp"
    _check_admission(lab, options, first, here)
    wait_s = WAIT_S if options.wait_s is None else options.wait_s
    return HostShare(here, hosts, wait_s, protocol, options.opened)


def _check_no_share(lab: Lab, options: RunOptions) -> None:
    """Raise ShareError for options that mean a host, which is not named."""
    if options.hosts is not None:
        try:
            names = ", ".join(host.name for host in read_hosts(options.hosts, lab))
        except LabError as error:
            raise ShareError(str(error), ExitCode.INVALID) from None
        raise ShareError(f"rmr up: which host is this machine? Name one of {names} with --here")
    told = {"--secret": options.secret, "--open": options.opened, "--wait-hosts": options.wait_s}
    for word, value in told.items():
        if value:
            raise ShareError(f"rmr up: {word} goes with --here HOST, which names this machine's share of the lab")


def _check_admission(lab: Lab, options: RunOptions, first: LabHost, here: LabHost) -> None:
    """Raise ShareError unless it is said who is let in, in one way alone."""
    if lab.mtls:
        for word, value in (("--secret", options.secret), ("--open", options.opened)):
            if value:
                raise ShareError(f"rmr up: {word} goes without `security: mtls` of the lab, whose hosts have keys")
        return
    where = first.endpoint("tcp")
    if options.secret is not None and options.opened:
        raise ShareError("rmr up: --open goes without --secret: name one of them")
    if options.secret is None and not options.opened:
        raise ShareError(
            f"rmr up: whoever reaches {where}, from other machines, too, could drive the robots: name a secret that "
            "all hosts share with --secret FILE, which the world's host makes if it does not exist, or allow that "
            "with --open; or give the lab keys (bus: {security: mtls})"
        )
    if options.secret is not None and not here.has_world and not options.secret.exists():
        raise ShareError(
            f"rmr up: {options.secret}: no such file: copy the secret of host {first.name} there, which makes it with "
            "--secret FILE"
        )


def made_of(lab: Lab, digest: int, actions: Path | None) -> tuple[tuple[str, str], ...]:
    """Return what all hosts of a lab must have alike, by names for people: program (by its `digest`), lab, actions."""
    plain = {key: value for key, value in resolved_lab(lab).items() if key not in OWN_FIELDS}
    lab_file = hashlib.blake2s(json.dumps(plain, sort_keys=True).encode(), digest_size=4).hexdigest()
    handlers = "none" if actions is None else hashlib.blake2s(actions.read_bytes(), digest_size=4).hexdigest()
    return (("rmr", __version__), ("program", f"{digest:08x}"), ("lab file", lab_file), ("actions", handlers))


def difference(
    own: tuple[tuple[str, str], ...],
    others: tuple[tuple[str, str], ...],
    own_shares: dict[str, tuple[int, ...]],
    other_shares: dict[str, tuple[int, ...]],
    here: str,
    there: str,
) -> str:
    """Return in what the host `here` differs from the host `there`; empty if both have the same."""
    told = dict(others)
    unlike = [f"{what} {value} here, {told.get(what, 'none')} there" for what, value in own if told.get(what) != value]
    if unlike:
        return (
            f"host {here} has another lab than host {there}: {'; '.join(unlike)}; give both the same files and the "
            "same rmr"
        )
    homes = {robot: host for host, robots in other_shares.items() for robot in robots}
    for host, robots in own_shares.items():
        for robot in robots:
            if homes.get(robot) != host:
                return (
                    f"robot {robot} is on host {host} by the hosts of host {here}, and on host {homes.get(robot)} by "
                    f"those of host {there}: give both the same file of hosts"
                )
    if own_shares.keys() != other_shares.keys():
        names = [", ".join(sorted(shares)) for shares in (own_shares, other_shares)]
        return (
            f"the hosts are {names[0]} by the file of host {here}, and {names[1]} by that of host {there}: "
            "give both the same one"
        )
    return ""
