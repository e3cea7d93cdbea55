"""`rmr export`: files by which systemd or compose starts each host's share of a lab.

What they start is what a person would type on that host: a router, the world, a process for each robot. The same lab,
hosts and options give the same octets.
"""
# ruff: noqa: PLC0415 - see rmr.entry: help loads neither lab nor YAML

import shlex
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rmr.entry import ExitCode, run

if TYPE_CHECKING:
    from rmr.entry.command_line import Command, Parser
    from rmr_world.lab import Lab, LabHost

ABOUT = """\
Write what starts the processes of LAB on each of its hosts: units of systemd, or a file for docker compose.

DIR gets the folder lab, with the lab's files and its program as byte-code, and a folder for each host.
"""
USER = 10001
"""In containers: not root."""
PROBE = "import socket,sys; socket.create_connection((sys.argv[1], int(sys.argv[2])), 5).close()"
"""Health of a process in a container: its router can be reached."""
HARDENED = """\
User=rmr
UMask=0077
Restart=on-failure
RestartSec=1
NoNewPrivileges=yes
CapabilityBoundingSet=
ProtectSystem=strict
ProtectHome=yes
PrivateTmp=yes
PrivateDevices=yes
ProtectClock=yes
ProtectKernelTunables=yes
ProtectKernelModules=yes
ProtectControlGroups=yes
RestrictAddressFamilies=AF_INET AF_INET6 AF_UNIX AF_NETLINK
RestrictNamespaces=yes
RestrictSUIDSGID=yes
LockPersonality=yes
"""


@dataclass(frozen=True, slots=True)
class Places:
    """Where a process finds things."""

    programs: str
    """Before the name of a program: empty, or a folder with a / at its end."""
    lab: str
    """The folder with the lab."""
    credentials: str
    """The file with the secret, or the folder with a folder of keys for each process."""
    records: str
    """The folder of recordings."""
    contained: bool = False
    """Whether a router has a network of its own."""


def _declare(parser: "Parser") -> None:
    from rmr.entry.command_line import one_of
    from rmr_world.provided_labs import existing_lab

    parser.positional("engine", "systemd|compose", read=one_of(("systemd", "compose")), help="what is to start them")
    parser.positional("lab", "LAB", read=existing_lab, help="the lab file, its folder or a provided lab")
    parser.option("--hosts", metavar="FILE", read=Path, help="which host has what (default: `hosts` of the lab file)")
    parser.option("-o", "--output", metavar="DIR", read=Path, required=True, help="a folder that is new or empty")
    parser.flag("--open", dest="opened", help="without a secret: whoever reaches the router can drive the robots")


def command() -> "Command":
    """Return the command."""
    from rmr.entry.command_line import Command

    return Command(ABOUT, _declare, _export)


def main(words: Sequence[str] | None = None, name: str = "rmr export") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: command().main(words, name))


def _export(engine: str, lab: Path, hosts: Path | None, output: Path, opened: bool) -> int:
    """Write the files; return the exit code."""
    from rmr_deploy.preparation import RunRefusedError, read_lab, read_program
    from rmr_world.finding import LabError
    from rmr_world.hosts import read_hosts
    from rmr_world.lab import Outage

    try:
        found = read_lab(lab, None)
        shares = found.hosts if hosts is None else read_hosts(hosts, found)
        octets = read_program(found, color=sys.stderr.isatty()).octets
    except (LabError, RunRefusedError) as error:
        print(str(error).rstrip("\n"), file=sys.stderr)
        return ExitCode.INVALID
    if not shares:
        print(f"rmr export: {found.path} has no hosts: name a file that has with --hosts FILE", file=sys.stderr)
        return ExitCode.USAGE
    if found.key_file is not None:
        print(f"rmr export: lab {found.name} has a key of its radio, which is not exported", file=sys.stderr)
        return ExitCode.USAGE
    if opened and found.mtls:
        print("rmr export: --open goes without `security: mtls` of the lab", file=sys.stderr)
        return ExitCode.USAGE
    if wrong := _unfit(shares):
        print(f"rmr export: {wrong}", file=sys.stderr)
        return ExitCode.USAGE
    try:
        files = {"lab/program.rbc": octets, **_lab_files(found)}
        for share in shares:
            files |= (_systemd if engine == "systemd" else _compose)(found, share, shares, opened)
        if output.exists() and (not output.is_dir() or any(output.iterdir())):
            print(f"rmr export: {output} is there already and not empty: name another folder", file=sys.stderr)
            return ExitCode.USAGE
        for name, content in files.items():
            path = output / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
    except (OSError, ValueError) as error:
        where = f"{error.filename}: {error.strerror}" if isinstance(error, OSError) else error
        print(f"rmr export: {where}", file=sys.stderr)
        return ExitCode.USAGE
    print(f"{len(files)} files in {output}, for {', '.join(share.name for share in shares)}")
    if found.loads or any(not isinstance(fault, Outage) for fault in found.faults):
        print("loads of programs and faults of processes are left out: rmr load and rmr fault carry them out")
    return ExitCode.OK


def _unfit(hosts: Sequence["LabHost"]) -> str:
    """Return why `hosts` cannot be exported; nothing where they can."""
    from rmr.bus.endpoint import is_loopback
    from rmr_world.hosts import hub

    if any(host.name == "lab" for host in hosts):
        return "a host cannot have the name lab, which is that of the folder with the lab's files"
    first = hub(hosts)
    if len(hosts) > 1 and is_loopback(first.endpoint("tcp")):
        return f"no other host reaches {first.name} at {first.address}: give it an address of its network under hosts"
    return ""


def _lab_files(lab: "Lab") -> dict[str, bytes]:
    """Return the lab file and the files that it names, by their names in the output. Raises OSError, ValueError."""
    from rmr_world.lab_file import files_of

    folder = lab.path.parent.resolve()
    files = {"lab/lab.yaml": lab.path.read_bytes()}
    for place, path in files_of(lab):
        if place == ("program",):  # exported as byte-code
            continue
        if not path.resolve().is_relative_to(folder):
            raise ValueError(f"{path} is outside of the lab's folder: put it beside {lab.path.name}")
        files[f"lab/{path.resolve().relative_to(folder).as_posix()}"] = path.read_bytes()
    return files


# --- the commands of one host


def _commands(
    lab: "Lab", host: "LabHost", hosts: Sequence["LabHost"], places: Places, *, opened: bool
) -> Iterator[tuple[str, list[str]]]:
    """Yield the name and the command of each process of `host`."""
    from rmr.bus.endpoint import is_loopback
    from rmr_world.hosts import hub

    protocol = "tls" if lab.mtls else "tcp"
    first = hub(hosts)

    def admission(process: str) -> list[str]:
        if lab.mtls:
            return ["--keys", f"{places.credentials}/{process}"]
        return [] if opened else ["--secret", places.credentials]

    if host.has_router:
        # A container's loopback is its own: what listens for other processes of the machine listens at all addresses.
        beyond = host is first and (places.contained or not is_loopback(host.endpoint(protocol)))
        listen = f"{protocol}/{('[::]' if ':' in host.address else '0.0.0.0') if beyond else '127.0.0.1'}:{host.port}"
        joins = [] if host is first else ["--connect", first.endpoint(protocol)]
        open_ = ["--open"] if opened and beyond else []
        yield "router", [f"{places.programs}rmr", "router", "--listen", listen, *joins, *admission("router"), *open_]
    connect = ["--connect", f"{protocol}/127.0.0.1:{host.port}" if host.has_router else first.endpoint(protocol)]
    if host.has_world:
        record = ["--record", f"{places.records}/world.mcap"]
        config = ["--config", f"{places.lab}/lab.yaml", "--when-ready"]
        yield "world", [f"{places.programs}rmr-world", *config, *connect, *admission("world"), *record]
    for robot in host.robots:
        name = f"robot-{robot}"
        actions: list[str] = []
        if lab.actions is not None:
            inner = lab.actions.resolve().relative_to(lab.path.parent.resolve()).as_posix()
            actions = ["--actions", f"{places.lab}/{inner}"]
        record = ["--record", f"{places.records}/{name}.mcap"]
        words = [*connect, "--lab", lab.name, *actions, *admission(name), *record]
        yield name, [f"{places.programs}rmr-agent", "--id", str(robot), *words, f"{places.lab}/program.rbc"]


def _systemd(lab: "Lab", host: "LabHost", hosts: Sequence["LabHost"], opened: bool) -> dict[str, bytes]:
    base = f"rmr-{lab.name}"
    credentials = f"/etc/{base}/{'keys' if lab.mtls else 'secret'}"
    places = Places("/opt/rmr/bin/", f"/etc/{base}/lab", credentials, f"/var/lib/{base}")
    units = dict(_commands(lab, host, hosts, places, opened=opened))
    files = {}
    for name, words in units.items():
        after = f" {base}-router.service" if "router" in units and name != "router" else ""
        text = (
            f"[Unit]\nDescription=RMR lab {lab.name}, {name}\nPartOf={base}.target\n"
            "StartLimitIntervalSec=0\nWants=network-online.target\n"
            f"After=network-online.target{after}\n\n[Service]\nType=exec\n"
            f"ExecStart={exec_start(words)}\n"
            f"StateDirectory={base}\nWorkingDirectory=/var/lib/{base}\n{HARDENED}"
        )
        files[f"{host.name}/{base}-{name}.service"] = text.encode()
    wants = "".join(f"Wants={base}-{name}.service\n" for name in units)
    target = (
        f"[Unit]\nDescription=RMR lab {lab.name}, host {host.name}\n{wants}\n[Install]\nWantedBy=multi-user.target\n"
    )
    return {f"{host.name}/{base}.target": target.encode(), **files}


def exec_start(words: Sequence[str]) -> str:
    """Return a command as `ExecStart=` reads it, where \\, $ and % have meanings of their own."""
    return shlex.join(words).replace("\\", "\\\\").replace("$", "$$").replace("%", "%%")


def _compose(lab: "Lab", host: "LabHost", hosts: Sequence["LabHost"], opened: bool) -> dict[str, bytes]:
    import yaml

    from rmr.bus.endpoint import host_and_port, is_loopback

    places = Places("", "/lab", "/keys" if lab.mtls else "/secret", "/record", contained=True)
    services: dict[str, Any] = {}
    for name, words in _commands(lab, host, hosts, places, opened=opened):
        # Inside a container $ is compose's own, so that it is doubled.
        command = [word.replace("$", "$$") for word in words]
        flag = "--listen" if name == "router" else "--connect"
        address, port = host_and_port(words[words.index(flag) + 1])
        reached = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(address, address)
        volumes = ["../lab:/lab:ro", "./record:/record"]
        if lab.mtls:
            volumes.append(f"./keys/{name}:/keys/{name}:ro")
        elif not opened:
            volumes.append("./secret:/secret:ro")
        service: dict[str, Any] = {
            "image": "${RMR_IMAGE:-rmr}",
            "command": command,
            "user": f"{USER}:{USER}",
            "read_only": True,
            "tmpfs": ["/tmp"],
            "cap_drop": ["ALL"],
            "security_opt": ["no-new-privileges:true"],
            "restart": "on-failure",
            "volumes": volumes,
            "healthcheck": {
                "test": ["CMD", "python", "-c", PROBE, reached, str(port)],
                "interval": "10s",
                "timeout": "6s",
                "start_period": "20s",
            },
        }
        if name == "router" and address != "127.0.0.1":
            own = "127.0.0.1:" if is_loopback(host.endpoint("tcp")) else ""
            service["ports"] = [f"{own}{port}:{port}"]
        elif name != "router" and host.has_router:
            service |= {"network_mode": "service:router", "depends_on": {"router": {"condition": "service_healthy"}}}
        services[name] = service
    text = yaml.safe_dump({"name": f"rmr-{lab.name}-{host.name}", "services": services}, sort_keys=False, width=1000)
    return {f"{host.name}/compose.yaml": text.encode()}


if __name__ == "__main__":
    sys.exit(main())
