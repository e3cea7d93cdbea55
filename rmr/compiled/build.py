"""`make fast`: compile the modules in which a robot spends its time, with mypyc, into ``build/compiled``.

With ``--check``, as `make lint` does, mypyc only reads them: what it cannot compile is said, and nothing is made.

The sources stay as they are and say everything: mypyc reads the types that mypy checks, calls methods directly and
keeps numbers unboxed, and results are the same to the bit. What is made is found by `rmr.compiled` and is all or
nothing: it is put in its place when it is whole, and used as long as no source has changed.
"""

import os
import shlex
import shutil
import sys
import sysconfig
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rmr.compiled import FOLDER, INDEX, modules_in, state
from rmr.entry import ExitCode

ROOT = FOLDER.parents[1]
ROOTS = {"rmr": "rmr", "agents/rmr_agent": "rmr_agent", "world/rmr_world": "rmr_world", "world/rmr_sim": "rmr_sim"}
"""Where the packages lie that are compiled in part."""
HOT = (
    "agents/rmr_agent/clock.py",
    "agents/rmr_agent/incarnation.py",
    "agents/rmr_agent/bus_ports.py",
    "agents/rmr_agent/robot_recording.py",
    "rmr/base/*.py",
    "rmr/bus/checks.py",
    "rmr/bus/line.py",
    "rmr/bus/losses.py",
    "rmr/bus/wire.py",
    "rmr/coord/*.py",
    "rmr/mind/mind_format.py",
    "rmr/mind/mind_log.py",
    "rmr/mind/durable_node.py",
    "rmr/mind/recorded_node.py",
    "rmr/node/*.py",
    "rmr/node/actions/*.py",
    "rmr/node/crossing/*.py",
    "rmr/node/logic/*.py",
    "rmr/node/motion/*.py",
    "rmr/node/motion/standoff/*.py",
    "rmr/node/peers/*.py",
    "rmr/radio/*.py",
    "rmr/record/foxglove_messages.py",
    "rmr/record/mcap_format.py",
    "rmr/record/mcap_writer.py",
    "rmr/record/record_writer.py",
    "rmr/record/robot_observer.py",
    "world/rmr_sim/robot_host.py",
    "world/rmr_sim/sim_recorder.py",
    "world/rmr_sim/simulated_robot.py",
    "world/rmr_sim/simulation.py",
    "world/rmr_world/physics.py",
    "world/rmr_world/robot_body.py",
    "world/rmr_world/sensors.py",
)
INTERPRETED = {
    "rmr/base/ids.py": "loaded by commands that need nothing else",
    "rmr/base/mistake.py": "the same",
    "rmr/base/printable.py": "the same",
    "rmr/base/record.py": "makes classes at run time",
    "rmr/base/values.py": "its classes are strings and ints",
    "rmr/radio/settings.py": "a table that commands and schema read, with whole numbers where those write them",
    "rmr/node/actions/handle.py": "a handler meets the same coroutines and classes in both forms",
    "rmr/node/actions/built_in.py": "the same",
    "rmr/node/actions/drives.py": "the same",
    "rmr/node/actions/node_handle.py": "the same",
    "rmr/node/actions/user_file.py": "runs once, on a user's file",
}
"""What HOT names and is not compiled, and why."""
OPTIONS = ROOT / "pyproject.toml"
GROUP = "rmr_compiled"
"""All are parts of one library: `rmr_compiled__mypyc`."""
EXACT = ["-ffp-contract=off"] if os.name == "posix" else []
"""A product and a sum are rounded one by one, as Python does, also on machines that can round them together."""


class UncompiledError(Exception):
    """What the compilers have to say against a source."""


class UnableError(Exception):
    """This machine cannot compile: what is missing, and what to do about it."""


def main() -> int:
    """Compile what is not up to date; with ``--if-possible`` go on where the machine cannot."""
    os.chdir(ROOT)
    if sys.argv[1:] == ["--check"]:
        return _check()
    shown = FOLDER.relative_to(ROOT)
    if modules_in(FOLDER):
        print(f"{shown} is up to date")
        return 0
    try:
        look_for_a_compiler()
    except UnableError as reason:
        print(f"make fast: {reason}; all works interpreted as well, at less than half of the speed", file=sys.stderr)
        return 0 if sys.argv[1:] == ["--if-possible"] else ExitCode.USAGE
    print(f"compiling {len(hot())} modules into {shown}", flush=True)
    try:
        compile_into(FOLDER)
    except UncompiledError as why:
        print(why, file=sys.stderr)
        return ExitCode.FAILED
    return 0


def _check() -> int:
    """Let mypyc read the hot modules, and say what it cannot compile."""
    with TemporaryDirectory() as scratch:
        try:
            _written_in_c(hot(), Path(scratch))
        except UncompiledError as why:
            print(why, file=sys.stderr)
            return ExitCode.FAILED
    print(f"mypyc compiles all {len(hot())} modules")
    return 0


def look_for_a_compiler() -> None:
    """Raise UnableError unless there are sources, a C compiler and Python's headers."""
    if not OPTIONS.exists():
        raise UnableError(f"{ROOT} holds no sources: compile in a clone of the repository")
    [command, *_] = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")
    if shutil.which(command) is None:
        raise UnableError(f"there is no C compiler {command}: install one, or name yours in CC")
    headers = Path(sysconfig.get_paths()["include"])
    if not (headers / "Python.h").exists():
        raise UnableError(f"{headers} has no Python.h: install Python's development files")


def hot() -> list[str]:
    """Return the sources that are compiled, relative to the root."""
    found = [path.relative_to(ROOT).as_posix() for pattern in HOT for path in sorted(ROOT.glob(pattern))]
    return [path for path in found if not path.endswith("__init__.py") and path not in INTERPRETED]


def compile_into(folder: Path) -> None:
    """Compile the hot modules into `folder`, whose contents are replaced at the end. Raises UncompiledError."""
    states = {path: state(path) for path in _sources()}
    being_made = folder.with_name(folder.name + ".new")
    shutil.rmtree(being_made, ignore_errors=True)
    _build(hot(), being_made)
    _write_index(being_made, states)
    shutil.rmtree(folder, ignore_errors=True)
    being_made.rename(folder)


def _sources() -> Iterator[Path]:
    """All that the compiled modules may know of: types, constants and functions of any module; what to do with them."""
    yield from (OPTIONS, Path(__file__))
    for root in ROOTS:
        yield from sorted((ROOT / root).rglob("*.py"))


def _build(sources: list[str], into: Path) -> None:
    from setuptools import Distribution  # noqa: PLC0415
    from setuptools.command.build_ext import build_ext  # noqa: PLC0415
    from setuptools.errors import CompileError  # noqa: PLC0415

    class OnAllCores(build_ext):
        def build_extensions(self) -> None:
            self.compiler.compile = _side_by_side(self.compiler.compile, CompilerProgress())
            super().build_extensions()

    scratch = into.with_name(into.name + ".c")
    print("[1/2] mypyc checks types and writes C (about half a minute)", flush=True)
    extensions = _written_in_c(sources, scratch)
    for extension in extensions:
        extension.extra_compile_args += EXACT
    cores = os.cpu_count() or 1
    print(f"[2/2] the C compiler works on {cores} cores (about a minute of processor time)", flush=True)
    build = OnAllCores(Distribution({"name": "rmr", "ext_modules": extensions}))
    build.build_lib, build.build_temp = str(into), str(scratch)
    build.parallel = cores  # each module has a small library of its own to be linked, beside the one of all
    build.ensure_finalized()
    try:
        build.run()
    except CompileError as error:
        raise UncompiledError(str(error)) from error
    shutil.rmtree(scratch)


def _written_in_c(sources: list[str], scratch: Path) -> list[Any]:
    """Return the extensions that mypyc makes of `sources`, with C files in `scratch`. Raises UncompiledError."""
    from mypyc.build import mypycify  # noqa: PLC0415 - a second, and not needed where all is up to date

    said = StringIO()  # mypyc warns of code that it compiles less well: of no use to users
    try:
        with redirect_stdout(said), redirect_stderr(said):
            return mypycify(
                ["--config-file", str(OPTIONS), *sources],
                opt_level="1",  # 3 makes nothing faster and takes half as long again
                debug_level="0",
                multi_file=True,
                target_dir=str(scratch),
                group_name=GROUP,
            )
    except SystemExit as end:
        raise UncompiledError(said.getvalue()) from end


class CompilerProgress:
    """Tells each time that all files of a package have been compiled."""

    def __init__(self) -> None:
        self._left: Counter[str] = Counter()

    def begin(self, sources: Iterable[str]) -> None:
        """Expect these C files."""
        self._left.update(filter(None, map(package_of, sources)))

    def done(self, source: str) -> None:
        """Take note of a file that has been compiled."""
        package = package_of(source)
        if not package:
            return
        self._left[package] -= 1
        if not self._left[package]:
            del self._left[package]
            print(f"  {package} is compiled; {sum(self._left.values())} files to go", flush=True)


def package_of(source: str) -> str:
    """Return the package whose module is in the C file `source`; empty for what is mypyc's own."""
    name = Path(source).stem.removeprefix("__native_")
    return ".".join(name.split("___")[:-1]) if Path(source).stem != name else ""


def _side_by_side(compile_all: Callable[..., list[str]], progress: CompilerProgress) -> Callable[..., list[str]]:
    """Return a `compile` of a compiler of setuptools that compiles one file a core at a time, the longest first."""

    def compile_each(sources: list[str], **options: Any) -> list[str]:
        progress.begin(sources)
        longest_first = sorted(sources, key=lambda source: Path(source).stat().st_size, reverse=True)
        made: list[str] = []
        with ThreadPoolExecutor(os.cpu_count()) as cores:
            each = cores.map(lambda source: compile_all([source], **options), longest_first)
            for source, objects in zip(longest_first, each, strict=True):
                made += objects
                progress.done(source)
        return made

    return compile_each


def _write_index(folder: Path, states: dict[Path, str]) -> None:
    compiled = {OPTIONS: f"{GROUP}__mypyc"} | {ROOT / path: _module(path) for path in hot()}
    lines = [f"{was}\t{compiled.get(path, '')}\t{path}" for path, was in states.items()]
    (folder / INDEX).write_text("\n".join([sys.implementation.cache_tag, *lines, ""]))


def _module(path: str) -> str:
    """Return the name of the module at `path`."""
    [root] = [root for root in ROOTS if path.startswith(f"{root}/")]
    return ".".join([ROOTS[root], *path[len(root) + 1 : -len(".py")].split("/")])


if __name__ == "__main__":
    sys.exit(main())
