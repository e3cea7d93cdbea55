"""`rmr export`: files by which systemd, compose or Kubernetes starts each host's share of a lab.

What they start is what a person would type on that host: a router, the world, a process for each robot. The same lab,
hosts and options give the same octets. In Kubernetes a host is a Pod: its containers share one network, as a machine's
processes do, and each is started again by itself.
"""
# ruff: noqa: PLC0415 - see rmr.entry: help loads neither lab nor YAML

import re
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rmr.entry import ExitCode, run
from rmr.entry.terminal import has_colour

if TYPE_CHECKING:
    from rmr.entry.command_line import Command, Parser
    from rmr_world.lab import Lab, LabHost

ABOUT = """\
Write what starts the processes of LAB on its hosts: units of systemd, or files for docker compose or Kubernetes.

DIR gets the folder lab, with the lab's files and its program as byte-code, and a folder for each host.
"""
USER = 10001
"""In containers: not root."""
PROBE = "import socket,sys; socket.create_connection((sys.argv[1], int(sys.argv[2])), 5).close()"
"""Health of a process in a container: its router can be reached."""
COPY = """\
import os, pathlib
os.umask(0o077)
for folder, inner, files in os.walk("/given", followlinks=True):
    inner[:] = [name for name in inner if not name.startswith("..")]
    target = pathlib.Path("/admission", os.path.relpath(folder, "/given"))
    target.mkdir(parents=True, exist_ok=True)
    for name in files:
        (target / name).write_bytes(pathlib.Path(folder, name).read_bytes())
"""
"""Copies secret or keys to where they are the process's own."""
CONFIG_MAP_OCTETS_MAX = 1 << 20
CONTAINED = {
    "allowPrivilegeEscalation": False,
    "readOnlyRootFilesystem": True,
    "capabilities": {"drop": ["ALL"]},
}
"""What a container of Kubernetes may do."""
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

    parser.positional("engine", "|".join(ENGINES), read=one_of(tuple(ENGINES)), help="what is to start them")
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
        octets = read_program(found, color=has_colour(sys.stderr)).octets
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
    if wrong := _unfit(found, shares, engine):
        print(f"rmr export: {wrong}", file=sys.stderr)
        return ExitCode.USAGE
    try:
        files = {"lab/program.rbc": octets, **_lab_files(found)}
        if engine == "k8s":
            files |= _kustomization(found, shares, files, opened)
        for share in shares:
            files |= ENGINES[engine](found, share, shares, opened)
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


def _unfit(lab: "Lab", hosts: Sequence["LabHost"], engine: str) -> str:
    """Return why `hosts` cannot be exported; nothing where they can."""
    from rmr.bus.endpoint import is_loopback
    from rmr_world.hosts import hub

    if any(host.name == "lab" for host in hosts):
        return "a host cannot have the name lab, which is that of the folder with the lab's files"
    first = hub(hosts)
    if engine == "k8s":
        longest = max((_k8s_name(lab, host.name) for host in hosts), key=len)
        too_long = f"{longest} is too long for a name in Kubernetes, of 63 characters: shorten the lab's or the host's"
        return too_long if len(longest) > 63 else ""
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


# --- Kubernetes


def _k8s_name(lab: "Lab", *parts: str) -> str:
    """Return the name of an object of `lab`: names there have no underscore."""
    return "-".join(("rmr", lab.name.replace("_", "-"), *parts))


def _kustomization(
    lab: "Lab", hosts: Sequence["LabHost"], files: Mapping[str, bytes], opened: bool
) -> dict[str, bytes]:
    """Return the file that `kubectl apply -k` reads: the Pods of `hosts`, and their volumes from files beside it.

    Raises ValueError.
    """
    import yaml

    if odd := next((name for name in files if "=" in name), None):
        raise ValueError(f"{odd}: kubectl takes no name of a file with = in it: rename the file")
    if (size := sum(map(len, files.values()))) > CONFIG_MAP_OCTETS_MAX:
        raise ValueError(
            f"the files of lab {lab.name} have {size} octets, and a ConfigMap of Kubernetes {CONFIG_MAP_OCTETS_MAX} "
            "at most: export it for another engine"
        )
    made: dict[str, Any] = {
        "apiVersion": "kustomize.config.k8s.io/v1beta1",
        "kind": "Kustomization",
        "resources": [f"{host.name}/kubernetes.yaml" for host in hosts],
        "images": [{"name": "rmr", "newName": "rmr", "newTag": "latest"}],
        "configMapGenerator": [
            {"name": _k8s_name(lab, "lab"), "files": [f"{key}={file}" for key, file in _lab_keys(list(files))]}
        ],
    }
    if lab.mtls:
        processes = [name for host in hosts for name in _processes(host)]
        made["secretGenerator"] = [
            {"name": _k8s_name(lab, "keys", name), "files": [f"keys/{name}/{file}" for file in _bundle_files(name)]}
            for name in dict.fromkeys(processes)
        ]
    elif not opened:
        made["secretGenerator"] = [{"name": _k8s_name(lab, "secret"), "files": ["secret"]}]
    return {"kustomization.yaml": yaml.safe_dump(made, sort_keys=False, width=1000).encode()}


def _lab_keys(files: Sequence[str]) -> list[tuple[str, str]]:
    """Return a key for each of the lab's `files` in a ConfigMap, whose keys are no paths."""
    names = [(file, file.removeprefix("lab/")) for file in files if file.startswith("lab/")]
    plain = re.compile(r"[A-Za-z0-9_][-._A-Za-z0-9]{0,200}")
    return [(name if plain.fullmatch(name) else f".file-{i}", file) for i, (file, name) in enumerate(names)]


def _processes(host: "LabHost") -> list[str]:
    """Return the names of the processes of `host`."""
    own = [name for name, there in (("router", host.has_router), ("world", host.has_world)) if there]
    return [*own, *(f"robot-{robot}" for robot in host.robots)]


def _bundle_files(process: str) -> list[str]:
    """Return the names of the keys of a process, as `rmr keys bundle` writes them."""
    from rmr.bus.certificates import CA_FILE, CERTIFICATE_FILE, KEY_FILE, MEMBERS_FILE, REVOKED_FILE

    lists = [REVOKED_FILE] if process.startswith("robot-") else [REVOKED_FILE, MEMBERS_FILE]
    return [CA_FILE, CERTIFICATE_FILE, KEY_FILE, *lists]


def _kubernetes(lab: "Lab", host: "LabHost", hosts: Sequence["LabHost"], opened: bool) -> dict[str, bytes]:
    """Return the objects of `host`: its Pod, the volume of its recordings, and the name by which others reach it."""
    import yaml

    from rmr_world.hosts import hub

    own = _k8s_name(lab, host.name)
    labels = {"app.kubernetes.io/part-of": _k8s_name(lab), "app.kubernetes.io/component": host.name}
    about = {"name": own, "labels": labels}
    claim = {"accessModes": ["ReadWriteOnce"], "resources": {"requests": {"storage": "1Gi"}}}
    objects: list[dict[str, Any]] = [
        {"apiVersion": "v1", "kind": "PersistentVolumeClaim", "metadata": about, "spec": claim},
        {
            "apiVersion": "apps/v1",
            "kind": "Deployment",
            "metadata": about,
            "spec": {
                "replicas": 1,
                "strategy": {"type": "Recreate"},  # no robot is there twice
                "selector": {"matchLabels": labels},
                "template": {"metadata": {"labels": labels}, "spec": _pod(lab, host, hosts, opened)},
            },
        },
    ]
    if host == hub(hosts):
        # Others connect before it is ready: their robots are part of that.
        service = {"selector": labels, "ports": [{"port": host.port}], "publishNotReadyAddresses": True}
        objects.append({"apiVersion": "v1", "kind": "Service", "metadata": about, "spec": service})
    dumper = type("Plain", (yaml.SafeDumper,), {"ignore_aliases": lambda *_: True})
    text = yaml.dump_all(objects, Dumper=dumper, sort_keys=False, width=1000)
    return {f"{host.name}/kubernetes.yaml": text.encode()}


def _pod(lab: "Lab", host: "LabHost", hosts: Sequence["LabHost"], opened: bool) -> dict[str, Any]:
    """Return the Pod of `host`."""
    containers = _containers(lab, host, hosts, opened)
    given = [] if opened else _given(lab, [each["name"] for each in containers])
    own = {"runAsNonRoot": True, "runAsUser": USER, "runAsGroup": USER, "fsGroup": USER}
    others = {"matchLabels": {"app.kubernetes.io/part-of": _k8s_name(lab)}}
    spread = {"maxSkew": 1, "topologyKey": "kubernetes.io/hostname", "whenUnsatisfiable": "ScheduleAnyway"}
    pod: dict[str, Any] = {
        "automountServiceAccountToken": False,
        "enableServiceLinks": False,
        "terminationGracePeriodSeconds": 10,
        "securityContext": {**own, "seccompProfile": {"type": "RuntimeDefault"}},
        "topologySpreadConstraints": [{**spread, "labelSelector": others}],
    }
    if given:
        # A volume of Kubernetes is readable by the group of its Pod, which no process here takes for secret.
        copied = {"name": "admission", "image": "rmr", "command": ["python", "-c", COPY], "securityContext": CONTAINED}
        mounts = [_mount("given", "/given", readOnly=True), _mount("admission", "/admission")]
        pod["initContainers"] = [{**copied, "volumeMounts": mounts}]
    keys = _lab_keys(["lab/program.rbc", *_lab_files(lab)])
    items = [{"key": key, "path": file.removeprefix("lab/")} for key, file in keys]
    pod["containers"] = containers
    pod["volumes"] = [
        {"name": "lab", "configMap": {"name": _k8s_name(lab, "lab"), "items": items}},
        {"name": "record", "persistentVolumeClaim": {"claimName": _k8s_name(lab, host.name)}},
        {"name": "tmp", "emptyDir": {}},
    ]
    if given:
        pod["volumes"] += [
            {"name": "given", "projected": {"sources": given}},
            {"name": "admission", "emptyDir": {"medium": "Memory"}},
        ]
    return pod


def _containers(lab: "Lab", host: "LabHost", hosts: Sequence["LabHost"], opened: bool) -> list[dict[str, Any]]:
    """Return the containers of `host`, one for each process."""
    from rmr.bus.endpoint import host_and_port

    # Within the cluster a host is reached by the name of its Service, whatever its address is elsewhere.
    reached = [replace(one, address=_k8s_name(lab, one.name)) for one in hosts]
    places = Places("", "/lab", "/keys" if lab.mtls else "/secret", "/record", contained=True)
    containers: list[dict[str, Any]] = []
    for name, words in _commands(lab, reached[hosts.index(host)], reached, places, opened=opened):
        flag = "--listen" if name == "router" else "--connect"
        address, port = host_and_port(words[words.index(flag) + 1])
        reach = [address.replace("0.0.0.0", "127.0.0.1"), str(port)]
        test = {"exec": {"command": ["python", "-c", PROBE, *reach]}}
        probe: dict[str, Any] = {**test, "periodSeconds": 10, "timeoutSeconds": 6}
        mounts = [_mount("lab", "/lab", readOnly=True), _mount("record", "/record"), _mount("tmp", "/tmp")]
        if lab.mtls:
            mounts.append(_mount("admission", f"/keys/{name}", subPath=f"keys/{name}", readOnly=True))
        elif not opened:
            mounts.append(_mount("admission", "/secret", subPath="secret", readOnly=True))
        container: dict[str, Any] = {
            "name": name,
            "image": "rmr",
            "command": [word.replace("$(", "$$(") for word in words],
            "readinessProbe": probe,
            # No limit of the processor: a process that is held back misses its ticks.
            "resources": {"requests": {"cpu": "100m", "memory": "128Mi"}},
            "securityContext": CONTAINED,
            "volumeMounts": mounts,
        }
        if name == "router":  # what cannot reach a router is not started again for that: it waits
            container["livenessProbe"] = {**probe, "initialDelaySeconds": 20}
        containers.append(container)
    return containers


def _mount(name: str, path: str, **more: Any) -> dict[str, Any]:
    return {"name": name, "mountPath": path, **more}


def _given(lab: "Lab", processes: Sequence[str]) -> list[dict[str, Any]]:
    """Return what lets `processes` in, as sources of one volume."""
    if not lab.mtls:
        return [{"secret": {"name": _k8s_name(lab, "secret")}}]
    return [
        {
            "secret": {
                "name": _k8s_name(lab, "keys", name),
                "items": [{"key": file, "path": f"keys/{name}/{file}"} for file in _bundle_files(name)],
            }
        }
        for name in processes
    ]


ENGINES = {"systemd": _systemd, "compose": _compose, "k8s": _kubernetes}
"""What starts the processes, and what writes the files of a host for it."""


if __name__ == "__main__":
    sys.exit(main())
