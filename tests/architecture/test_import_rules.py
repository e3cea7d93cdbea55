"""Imports run one way: `lang -> bytecode <- vm`; `coord`, `radio`, `vm` are siblings; `node` joins them."""

import ast
import os
import re
import subprocess
import sys
from collections.abc import Container
from importlib import metadata
from tempfile import TemporaryDirectory

import pytest
from source_tree import PACKAGES, ROOT, Module, modules, offenders, own_module, reachable

import rmr
from rmr.compiled.build import hot
from rmr.entry.command_line import EXTRAS

MAY_IMPORT: dict[str, set[str]] = {
    "rmr": {"rmr.compiled"},
    "rmr.compiled": {"rmr.entry"},
    "rmr.base": set(),
    "rmr.bytecode": {"rmr.base"},
    "rmr.analysis": {"rmr.base", "rmr.bytecode"},
    "rmr.lang": {"rmr.base", "rmr.bytecode", "rmr.analysis"},
    "rmr.vm": {"rmr.base", "rmr.bytecode", "rmr.analysis"},
    "rmr.coord": {"rmr.base"},
    "rmr.radio": {"rmr.base"},
    "rmr.columns": {"rmr.base", "rmr.bytecode", "rmr.analysis", "rmr.vm"},
    "rmr.node": {"rmr.analysis", "rmr.base", "rmr.bytecode", "rmr.vm", "rmr.coord", "rmr.radio"},
    "rmr.load": {"rmr.analysis", "rmr.base", "rmr.bytecode", "rmr.node"},
    "rmr.mind": {"rmr.base", "rmr.bytecode", "rmr.coord", "rmr.node", "rmr.radio", "rmr.record", "rmr.vm"},
    "rmr.why": {
        "rmr.analysis",
        "rmr.base",
        "rmr.bytecode",
        "rmr.coord",
        "rmr.lang",
        "rmr.mind",
        "rmr.node",
        "rmr.record",
        "rmr.vm",
    },
    "rmr.eval": {"rmr.base", "rmr.bytecode", "rmr.analysis", "rmr.lang", "rmr.vm", "rmr.columns", "rmr.node"},
    "rmr.bus": {"rmr.entry", "rmr.base", "rmr.node", "rmr.radio", "rmr.record"},
    "rmr.record": {"rmr.base"},
    "rmr.entry": {"rmr.base"},
    "rmr.__main__": {"rmr.cli"},
    "rmr.cli": {"rmr.commands", "rmr.entry"},
    "rmr.commands": {
        "rmr.entry",
        "rmr.base",
        "rmr.bytecode",
        "rmr.eval",
        "rmr.lang",
        "rmr.mind",
        "rmr.radio",
        "rmr.record",
        "rmr.vm",
        "rmr.why",
    },
    "rmr_agent": {
        "rmr.base",
        "rmr.load",
        "rmr.bytecode",
        "rmr.vm",
        "rmr.coord",
        "rmr.radio",
        "rmr.mind",
        "rmr.node",
        "rmr.record",
        "rmr.bus",
        "rmr.entry",
    },
    "rmr_world": {
        "rmr.analysis",
        "rmr.base",
        "rmr.bytecode",
        "rmr.lang",
        "rmr.vm",
        "rmr.node",
        "rmr.radio",
        "rmr.record",
        "rmr.bus",
        "rmr.entry",
        "rmr_ros",
    },
    "rmr_ros": {"rmr.base", "rmr.node", "rmr.record"},
    "rmr_sim": {
        "rmr.entry",
        "rmr.load",
        "rmr.base",
        "rmr.bytecode",
        "rmr.lang",
        "rmr.vm",
        "rmr.coord",
        "rmr.radio",
        "rmr.mind",
        "rmr.node",
        "rmr.record",
        "rmr_world",
    },
    "rmr_lab": {"rmr.entry", "rmr.base", "rmr.bytecode", "rmr.lang", "rmr.node", "rmr_world", "rmr_sim"},
    "rmr_deploy": {
        "rmr.entry",
        "rmr.load",
        "rmr.vm",
        "rmr.base",
        "rmr.bytecode",
        "rmr.lang",
        "rmr.bus",
        "rmr.radio",
        "rmr.record",
        "rmr.why",
        "rmr_world",
    },
    "rmr_editor": {"rmr.base", "rmr.bytecode", "rmr.entry", "rmr.lang", "rmr_world"},
    "rmr_view": {
        "rmr.base",
        "rmr.bus",
        "rmr.bytecode",
        "rmr.coord",
        "rmr.entry",
        "rmr.mind",
        "rmr.node",
        "rmr.radio",
        "rmr.record",
        "rmr.vm",
        "rmr.why",
        "rmr_deploy",
        "rmr_sim",
        "rmr_world",
    },
}
"""Part -> the other parts that it may import."""

OF_WORLD = {"rmr_world.main", "rmr_world.world_process", "rmr_world.server", "rmr_world.lab_time"}
"""The world as a process."""

LIBRARIES: dict[str, set[str]] = {
    "rmr.compiled": {"mypyc", "setuptools"},
    "rmr.lang": {"lark"},
    "rmr.columns": {"numpy"},
    "rmr.radio": {"cryptography", "numpy"},
    "rmr.bus": {"cryptography", "zenoh", "msgpack"},
    "rmr.mind": {"msgpack"},
    "rmr.record": {"backports", "compression", "msgpack"},
    "rmr_world": {"pydantic", "pydantic_core", "yaml", "pymunk", "numpy", "PIL"},
    "rmr_ros": {
        "geometry_msgs",
        "nav_msgs",
        "numpy",
        "rclpy",
        "rosgraph_msgs",
        "sensor_msgs",
        "std_msgs",
        "tf2_msgs",
        "visualization_msgs",
    },
    "rmr_sim": {"numpy", "pytest"},
    "rmr_deploy": {"yaml"},  # yaml: what it exports for compose
    "rmr_editor": {"lsprotocol", "pygls", "pygments"},
    "rmr_view": {"pydantic", "matplotlib", "starlette", "uvicorn", "websockets"},
}
"""Part -> the third-party libraries that it may import; a part that is missing here may import none."""

OUTSIDE = {
    "asyncio",
    "socket",
    "selectors",
    "ssl",
    "threading",
    "multiprocessing",
    "subprocess",
    "signal",
    "time",
    "datetime",
}
"""Standard library modules through which a core would reach for the network, threads or the wall clock."""

HEAVY = (
    "lark",
    "pydantic",
    "yaml",
    "pymunk",
    "numpy",
    "PIL",
    "rmr.lang",
    "rmr.columns",
    "rmr_world",
    "rmr_sim",
    "rmr_lab",
    "rmr_deploy",
    "rmr_view",
)
"""What a robot process never carries: fifty of them must start in seconds."""

KEYED = ("cryptography", "cffi")
"""What a robot process carries only where it was given a key."""


def test_a_module_imports_only_the_parts_below_it():
    def above(module: Module) -> set[str]:
        own = {own_module(imported) for imported in module.imports} - {None, "rmr"}
        parts = {".".join(name.split(".")[:2]) if name.startswith("rmr.") else name.split(".")[0] for name in own}
        return parts - MAY_IMPORT.get(module.part, set()) - {module.part}

    assert offenders(above) == {}


@pytest.mark.parametrize("part", ["rmr_sim", "rmr_deploy"])
def test_the_simulator_and_the_launcher_take_lab_physics_and_report_of_the_world_but_not_its_server(part):
    imported = {own_module(name) for module in modules() if module.part == part for name in module.imports}
    assert not imported & OF_WORLD


def test_a_module_uses_only_the_libraries_of_its_part():
    def unlisted(module: Module) -> set[str]:
        foreign = {imported.split(".")[0] for imported in module.imports if own_module(imported) is None}
        return foreign - sys.stdlib_module_names - LIBRARIES.get(module.part, set())

    assert offenders(unlisted) == {}


def test_a_library_that_the_default_install_lacks_is_told_with_what_brings_it():
    def brought(name: str) -> set[str]:
        needs = [re.match(r"[\w.-]+", each)[0] for each in metadata.requires(name) or () if "extra ==" not in each]
        there = {each for each in needs if is_installed(each)}
        return {normal(name)}.union(*map(brought, there))

    def is_installed(name: str) -> bool:
        return any(normal(name) == normal(each) for of in distributions.values() for each in of)

    def normal(name: str) -> str:
        return re.sub(r"[._-]+", "-", name).lower()

    distributions = metadata.packages_distributions()
    default = brought("rmr-robots")
    parts = LIBRARIES.keys() - {"rmr.compiled", "rmr_ros"}  # in a clone alone; told by the world
    used = set().union(*(LIBRARIES[part] for part in parts)) - {"compression", "pygments", "pytest"}  # of who has them
    assert {each for each in used if default.isdisjoint(map(normal, distributions[each]))} <= EXTRAS.keys()


def test_nothing_in_rmr_but_the_bus_touches_network_threads_or_wall_clock():
    outer = ("rmr.bus", "rmr.cli", "rmr.commands", "rmr.entry")  # the command line is nobody's core
    inner = [module for module in modules() if module.name.startswith("rmr.") and module.part not in outer]
    assert offenders(lambda module: {imported.split(".")[0] for imported in module.imports} & OUTSIDE, inner) == {}


def test_a_robot_process_can_reach_no_heavy_library_even_by_a_late_import():
    reached = reachable("rmr_agent.main")
    assert "rmr_agent.agent_process" in reached
    assert {name: importer for name, importer in reached.items() if name.split(".")[0] in HEAVY or name in HEAVY} == {}


def test_import_rmr_loads_none_of_the_parts_that_its_api_names():
    code = "import sys, rmr; assert 'simulate' in dir(rmr); print(*sys.modules, sep='\\n')"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert [name for name in loaded if name.startswith(("rmr.", "rmr_"))] == ["rmr.compiled"]
    assert [name for name in loaded if name.startswith(HEAVY + KEYED)] == []


def test_a_robot_process_takes_nothing_from_the_api_but_what_actions_need():
    reached = {"rmr_agent.main", *reachable("rmr_agent.main")}
    taken = {name for module in modules() if module.name in reached for name in module.imports}
    of_api = {name for name in taken if name.startswith("rmr.") and name.removeprefix("rmr.") in rmr.__all__}
    assert of_api <= {"rmr.action", "rmr.ActionFailed", "rmr.RobotHandle"}


def test_every_package_says_that_it_is_typed():
    assert [package.name for package in PACKAGES if not (package / "py.typed").is_file()] == []


def test_a_robot_process_has_loaded_no_heavy_library():
    code = "import sys, rmr_agent.main, rmr_agent.agent_process; print(*sys.modules, sep='\\n')"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert [name for name in loaded if name.startswith(HEAVY + KEYED)] == []


def loaded_by(words: list[str], ends_with: Container[int] = (0,)) -> set[str]:
    """Return the modules that the command `rmr` has loaded when it ends, as sources."""
    code = (
        "import atexit, sys; from rmr.cli import main; atexit.register(lambda: print('loaded', *sys.modules)); main()"
    )
    with TemporaryDirectory() as folder:
        command = [sys.executable, "-c", code, *words]
        ended = subprocess.run(
            command, check=False, cwd=folder, capture_output=True, text=True, env=os.environ | {"RMR_COMPILED": ""}
        )
    assert ended.returncode in ends_with, ended.stderr
    return set(ended.stdout.rpartition("loaded ")[2].split())


def test_one_simulated_run_loads_nothing_that_only_other_runs_need():
    loaded = loaded_by(["sim", "corridor", "--robots", "1", "--no-record"])
    assert {"rmr_sim.simulation", "numpy", "yaml"} <= loaded  # it has run
    unwanted = (
        "rmr_sim.sweep",
        "rmr_sim.hunt.hunt_command",
        "rmr_sim.disk",
        "rmr_sim.sim_recorder",
        "rmr_lab",
        "rmr_view",
        "rmr_deploy",
        "rmr.mind.durable_node",
        "rmr.load.",
        "rmr.record.",
        "rmr.bus.session",
        "rmr.bus.wire",
        "rmr.columns",
        *("asyncio", "zenoh", "multiprocessing", "subprocess", "ssl"),
        *("lark", "PIL", "matplotlib", "backports", "cryptography"),
        "difflib",
    )
    assert sorted(name for name in loaded if name.startswith(unwanted)) == []


@pytest.mark.parametrize(
    "words", [["--help"], ["sim", "--help"], ["check", "--help"], ["sim", "corridor", "--seed", "x"], ["up", "--help"]]
)
def test_help_and_wrong_usage_load_only_what_says_so(words):
    unwanted = (
        "numpy",
        "yaml",
        "rmr_world.lab",
        "rmr.node",
        "rmr.lang",
        "asyncio",
        "shutil",
        "lzma",
        "zenoh",
        *HEAVY[:4],
    )
    loaded = loaded_by(words, ends_with={0, 2})
    assert "rmr.entry.command_line" in loaded
    assert sorted(name for name in loaded if name.startswith(unwanted)) == []


def test_what_a_run_loads_defines_its_values_as_records():
    """A dataclass takes sixteen times as long to define, at each start (`rmr.base.record`)."""
    loaded = loaded_by(["sim", "corridor", "--robots", "1", "--no-record"]) - compiled_modules()
    assert "rmr_world.bound" in loaded

    def dataclasses(module: Module) -> set[str]:
        return {node.name for node in module.nodes if isinstance(node, ast.ClassDef) and is_record_to_be(node)}

    assert offenders(dataclasses, [module for module in modules() if module.name in loaded]) == {}


def is_record_to_be(node: ast.ClassDef) -> bool:
    """Return whether a class is a dataclass that `record` could make: frozen, with defaults that are constants."""
    made = [ast.unparse(each) for each in node.decorator_list] == ["dataclass(frozen=True, slots=True)"]
    computed = [each for each in node.body if isinstance(each, ast.AnnAssign) and isinstance(each.value, ast.Call)]
    checked = [each for each in node.body if isinstance(each, ast.FunctionDef) and each.name == "__post_init__"]
    return made and not computed and not checked and not node.bases


def compiled_modules() -> set[str]:
    """Return the modules that `make fast` compiles: mypyc knows the classes of `dataclass` alone."""
    paths = {ROOT / path for path in hot()}
    return {module.name for module in modules() if module.path in paths}
