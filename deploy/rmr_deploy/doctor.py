"""`rmr doctor`: what this machine holds for RMR, what it lacks, which commands want it, and what mends it.

Libraries and extras are those that the installed distribution declares. Nothing is started or installed: a program is
looked for on the path, a port is tried on the loopback address.
"""
# ruff: noqa: PLC0415 - see rmr.entry

import os
import re
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from rmr import __version__
from rmr.entry import ExitCode, print_json, run
from rmr.entry.command_line import Command, Parser

DISTRIBUTION: Final = "rmr-robots"
CLONE: Final = Path(__file__).parents[2]
USES: Final[Mapping[str, str]] = {
    "backports.zstd": "recordings: rmr up, sim, view, replay, why and plot",
    "eclipse-zenoh": "rmr up, agent, world, router, fault, load and attach, rmr view of a run that goes on",
    "lark": "rmr check, compile, eval, sim, up, whatever reads a program",
    "msgpack": "recordings, and rmr up, agent and world",
    "numpy": "rmr sim, up, world, and rmr radio",
    "pydantic": "whatever reads a lab file",
    "pymunk": "rmr sim, up and world",
    "pyyaml": "whatever reads a lab file",
    "starlette": "rmr view",
    "uvicorn": "rmr view",
    "wsproto": "rmr view",
}
"""Library of every install -> what wants it."""
EXTRAS: Final[Mapping[str, str]] = {
    "cluster": "rmr sim --on: sweeps on a Dask cluster",
    "editor": "rmr lsp",
    "foxglove": "rmr view --foxglove",
    "keys": "rmr keys and sign, labs with mtls, secured radios",
    "maps": "labs whose floor is an image",
    "plot": "rmr plot NAME",
    "ros2": "labs with bodies in ROS 2",
    "mujoco": "the robots of docs/examples/ros2",
    "interfaces": "tests that speak to Nav2",
    "dev": "make test and make lint",
    "bench": "make bench: the rivals",
    "paper": "make paper",
    "site": "make site",
}
"""Extra -> what wants it; all but the first seven are of use in a clone alone."""
PROGRAMS: Final[Mapping[str, tuple[str, str]]] = {
    "cc": ("make fast", "apt-get install gcc python3-dev, or name yours in CC"),
    "chromium": ("tests of the page", "apt-get install chromium"),
    "zsh": ("tests of completion", "apt-get install zsh"),
    "fish": ("tests of completion", "apt-get install fish"),
    "docker": ("nothing of RMR", "not needed"),
}
"""Program -> what wants it, what brings it."""


REQUIREMENT: Final = re.compile(
    r"([\w.-]+) *>= *([\d.]+) *(?:; *(?:python_version *< *['\"]([\d.]+)['\"]|extra == ['\"](\w+)['\"]))?"
)
"""Of this distribution: library, least version, and the Python from which on it is not needed, or the extra."""


@dataclass(frozen=True)
class MachineCheck:
    """One thing that was looked for."""

    name: str
    found: bool
    needed: bool
    """Whether a command of `rmr` fails without."""
    holds: str
    """What is there, or what is missing."""
    wanted_by: str
    mend: str
    """What brings it; empty where it is there."""


def checks() -> Iterator[MachineCheck]:
    """Yield everything that is looked for, what all commands need first."""
    yield _check("python", sys.version_info >= (3, 11), sys.version.split()[0], "all commands", "install Python 3.11")
    yield from _libraries()
    yield from _machine()
    yield from _programs()


def _check(name: str, found: bool, holds: str, wanted_by: str, mend: str, *, needed: bool = True) -> MachineCheck:
    return MachineCheck(name, found, needed, holds, wanted_by, "" if found else mend)


def _libraries() -> Iterator[MachineCheck]:
    """Yield the libraries that are missing or too old, else all as one; then each extra."""
    try:
        declared = metadata.requires(DISTRIBUTION) or []
    except metadata.PackageNotFoundError:
        yield _check(
            "libraries", False, f"{DISTRIBUTION} is not installed", "all commands", f"pip install {DISTRIBUTION}"
        )
        return
    wrong: dict[str, list[str]] = {}
    for requirement in declared:
        parts = REQUIREMENT.fullmatch(requirement)
        if parts is None:
            continue  # in a form that this project does not use
        name, least, below, extra = parts.groups()
        if below and sys.version_info >= tuple(map(int, below.split("."))):
            continue  # Python itself has it
        if told := _wrong(name, least):
            wrong.setdefault(extra or "", []).append(told)
            if not extra:
                yield _check(name, False, told, USES.get(name, "commands of rmr"), f"pip install '{name}>={least}'")
    if "" not in wrong:
        count, zenoh = sum("extra ==" not in each for each in declared), metadata.version("eclipse-zenoh")
        yield _check("libraries", True, f"all {count}; eclipse-zenoh {zenoh}", "all commands", "")
    if find_spec("rclpy") is not None:  # of a ROS 2 installation, which pip knows nothing of
        wrong.pop("ros2", None)
    clone = (CLONE / "pyproject.toml").is_file()
    for extra, use in EXTRAS.items() if clone else [*EXTRAS.items()][:7]:
        mend = f"pip install {'-e ' if clone else ''}'{'.' if clone else DISTRIBUTION}[{extra}]'"
        yield _check(extra, extra not in wrong, ", ".join(wrong.get(extra, ["all of it"])), use, mend, needed=False)


def _wrong(name: str, least: str) -> str:
    """Return what is wrong with a library, as words; empty if it is there and new enough."""
    try:
        version = metadata.version(name)
    except metadata.PackageNotFoundError:
        return f"no {name}"
    numbers = [[int(each) for each in re.findall(r"\d+", text)[:3]] for text in (version, least)]
    return f"{name} {version}, older than {least}" if numbers[0] < numbers[1] else ""


def _machine() -> Iterator[MachineCheck]:
    from rmr.bus.endpoint import DEFAULT_PORT
    from rmr_deploy.active_runs import register

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    yield _check("cores", True, str(cores), "rmr up: while it drives, a robot takes about 6 % of one", "")
    origin = getattr(find_spec("rmr.node.node"), "origin", None) or ""
    compiled = not origin.endswith(".py")
    form = "compiled" if compiled else "interpreted: the same results in twice the time"
    mend = "make fast" if (CLONE / "Makefile").is_file() else "a wheel made with RMR_COMPILE=1 make wheel"
    yield _check("core", compiled, form, "rmr sim, above all with --seeds", mend, needed=False)
    free = _is_free(DEFAULT_PORT)
    used = "free" if free else "in use: a world or router that was started by hand, perhaps"
    mend = "rmr-world --listen tcp/127.0.0.1:PORT, and rmr-agent --connect there"
    yield _check(f"port {DEFAULT_PORT}", free, used, "rmr-world without --listen", mend, needed=False)
    folder = register()
    shown = str(folder) if folder else "no folder that is this user's alone"
    mend = "name a folder of yours in RMR_REGISTER"
    yield _check("register", folder is not None, shown, "rmr ls, ps, down and so on", mend)


def _is_free(port: int) -> bool:
    import socket

    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def _programs() -> Iterator[MachineCheck]:
    for name, (use, mend) in PROGRAMS.items():
        found = shutil.which((os.environ.get("CC") or name).split()[0] if name == "cc" else name)
        yield _check(name, found is not None, found or "not on the path", use, mend, needed=False)
    why = _no_namespaces()
    mend = "run them as root, with iproute2 installed"
    yield _check("ip netns", not why, why or "permitted", "tests of labs over several hosts", mend, needed=False)


def _no_namespaces() -> str:
    """Return why this process cannot make network namespaces; empty if it can."""
    if shutil.which("ip") is None:
        return "no program ip"
    try:
        held = int(re.findall(r"^CapEff:\s*(\w+)$", Path("/proc/self/status").read_text(), re.MULTILINE)[0], 16)
    except (OSError, IndexError):
        return "this is not Linux"
    wanted = 1 << 12 | 1 << 21  # CAP_NET_ADMIN and CAP_SYS_ADMIN, capabilities(7)
    return "" if held & wanted == wanted else "not permitted"


def _declare(parser: Parser) -> None:
    parser.flag("--json", dest="as_json", help="As one JSON document.")


def _examine(as_json: bool) -> int:
    """Print what is there and what is not; return the exit code."""
    found = list(checks())
    lacks = [each for each in found if each.needed and not each.found]
    if as_json:
        print_json({"release": __version__, "complete": not lacks, "checks": [asdict(each) for each in found]})
    else:
        width = max(len(each.name) for each in found)
        for each in found:
            state = "ok" if each.found else "LACKS" if each.needed else "without"
            print(f"{state:7}  {each.name:{width}}  {each.holds}")
            if not each.found:
                print(f"{'':9}{'':{width}}  for {each.wanted_by}: {each.mend}")
        told = f"{len(lacks)} missing that commands need" if lacks else "nothing missing that commands need"
        print(f"{DISTRIBUTION} {__version__}: {told}")
    return ExitCode.FAILED if lacks else ExitCode.OK


command = Command(
    """\
Say what this machine holds for RMR and what it lacks, for which command, and what mends it.

`LACKS` is what a command of rmr fails without, `without` what a few things want: an extra, faster simulations, tests.
The exit code is 1 if something is lacking, 0 otherwise. Nothing is installed.""",
    _declare,
    _examine,
)


def main(words: Sequence[str] | None = None, name: str = "rmr doctor") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: command.main(words, name))
