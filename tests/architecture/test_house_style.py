"""What of the house style a machine can hold: size, determinism, and nothing of one machine in the tree."""

import ast
import re
from collections import Counter
from pathlib import PurePosixPath

from source_tree import PROJECT, ROOT, Module, modules, offenders, tracked_text

MODULE_LINES_GUIDE = 400
LONGER_MODULES: dict[str, str] = {
    "rmr.bus.wire": "one table of messages: each with its form and the checks of its fields",
    "rmr.bytecode.decoder": "one class that mirrors the encoder, a method for each entry of the format",
    "rmr.bytecode.functions": "one table: a row for each function of the language, with its scalar function",
    "rmr.bytecode.program": "the data of the byte-code, one record for each construct",
    "rmr.commands.radio_command": "one command: the options of each experiment, its run, and the words of its results",
    "rmr.eval.ensemble": "one run: its robots, the events from outside and what robots note share one state",
    "rmr.lang.analyse.names": "the symbol table and the checks of uses against it",
    "rmr.lang.lower.emitter": "one class, a method for each construct that has code",
    "rmr.lang.read.habits": "one table: a function for each form that other languages have",
    "rmr.lang.read.tree_builder": "one class, a method for each rule of the grammar",
    "rmr.lang.read.syntax": "the nodes of the syntax tree, one record for each rule of the grammar",
    "rmr.node.driver": "one robot's drive: samples in, wheels and facts out, and one state between them",
    "rmr.node.crossing.crossing": "one state machine: its phases and all of its transitions",
    "rmr.node.crossing.crossings": "the crossings of one robot at events, stations and passages: one table",
    "rmr.node.motion.navigator": "one drive: its order, route, gates and manoeuvres are one state",
    "rmr.node.logic.exchange": "one protocol: what is sent, repeated, received and renewed shares one state",
    "rmr.node.payloads": "one table of the kinds of frames, with how each is written and read",
    "rmr.record.mcap_scan": "one reader: the index at the end of a file, and the scan where there is none",
    "rmr.vm.generate.body": "the search of a body and that of a fold in it, which need each other",
    "rmr.vm.generate.facts": "insertion and removal, in a function, in line, and for many facts: one text of each",
    "rmr.vm.generate.match_search": "the searches of one rule, which share its state, in each way of finding matches",
    "rmr.vm.machine": "what both engines share: one state and the orders that change it",
    "rmr.vm.goal_ways": "one state: steps of the graph, found backwards and kept up to date fact by fact",
    "rmr_deploy.export": "one list of commands, and the forms in which three engines are told them",
    "rmr_deploy.launch": "one run: its start, what it is watched for, and its end share one state",
    "rmr_world.server": "one process: what it is asked, what it steps and what it tells share one state and one clock",
    "rmr_world.schema": "the lab file, one model for each section of it",
}
"""Modules longer than the guide, each with the reason why it is not two: cutting by arithmetic makes two that only make
sense together."""
FUNCTION_LINES_MAX = 60
"""Functions aim for ten lines and are rarely over forty; sixty is where a reader is lost for certain."""

PRIVATE = [
    re.compile(pattern)
    for pattern in (
        r"(?<![\w.])/wor[k]/",
        r"(?<![\w.])/roo[t]/",
        r"(?<![\w.])/(?:home|Users)/\w",
        r"(?<![\w.])/tm[p]/\w",
        r"\.\./share[d]\b",
    )
]
"""Paths that mean something on one machine only."""

REGISTRY = re.compile(r"(?:index-url|find-links|trusted-host)\s*[= ]\s*\S*(?:/|\.)")
"""Where packages come from is the installing machine's affair."""


def cores() -> list[Module]:
    """Return the modules of `rmr` that are neither the bus nor what loads and starts programs."""
    outer = ("rmr.bus", "rmr.compiled", "rmr.entry")
    return [module for module in modules() if module.name.startswith("rmr.") and module.part not in outer]


def calls(module: Module) -> list[tuple[str, int]]:
    return [(ast.unparse(node.func), node.lineno) for node in module.nodes if isinstance(node, ast.Call)]


def iterated(module: Module) -> list[ast.expr]:
    loops = (ast.For, ast.AsyncFor, ast.comprehension)
    return [node.iter for node in module.nodes if isinstance(node, loops)]


def test_a_module_longer_than_the_guide_of_400_lines_gives_its_reason():
    lengths = {module.name: len(module.path.read_text().splitlines()) for module in modules()}
    assert {name for name, lines in lengths.items() if lines > MODULE_LINES_GUIDE} == set(LONGER_MODULES)
    assert all(len(reason) >= 20 for reason in LONGER_MODULES.values())


def test_a_function_fits_on_a_screen():
    def long(module: Module) -> list[tuple[str, int]]:
        functions = [node for node in module.nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
        lengths = [(node.name, node.end_lineno - node.lineno + 1) for node in functions]
        return [(name, lines) for name, lines in lengths if lines > FUNCTION_LINES_MAX]

    assert offenders(long) == {}


def test_a_module_begins_with_its_theory():
    assert offenders(lambda module: len(ast.get_docstring(module.tree) or "") < 20) == {}


def test_a_core_never_iterates_a_set_nor_hashes_by_the_process():
    def depends_on_the_process(module: Module) -> list[int]:
        sets = [node.lineno for node in iterated(module) if isinstance(node, ast.Set | ast.SetComp)]
        sets += [
            node.lineno
            for node in iterated(module)
            if isinstance(node, ast.Call) and ast.unparse(node.func) in ("set", "frozenset")
        ]
        return sets + [line for name, line in calls(module) if name == "hash"]

    assert offenders(depends_on_the_process, cores()) == {}


def test_a_core_draws_chance_only_from_the_stream_it_is_handed():
    def drawn(module: Module) -> list[object]:
        called = [(n, line) for n, line in calls(module) if n.startswith("random.") and n != "random.Random"]
        imported = [name for name in module.imports if name.startswith("random.") and name != "random.Random"]
        return [*called, *imported]

    assert offenders(drawn, cores()) == {}


def test_a_core_neither_prints_nor_waits():
    def outside(module: Module) -> list[tuple[str, int]]:
        return [(n, line) for n, line in calls(module) if n in ("print", "input", "sleep", "breakpoint")]

    assert offenders(outside, [module for module in cores() if module.part != "rmr.commands"]) == {}


def test_no_tracked_file_names_a_path_of_one_machine():
    found = [
        f"{name}:{number}: {line.strip()}"
        for name, text in tracked_text()
        for number, line in enumerate(text.splitlines(), 1)
        if any(pattern.search(line) for pattern in PRIVATE)
    ]
    assert found == []


def test_no_tracked_file_names_a_package_registry():
    found = [name for name, text in tracked_text() if REGISTRY.search(text)]
    assert found == []
    assert "://" not in (ROOT / "requirements.lock").read_text()


def test_every_install_of_this_project_names_its_distribution_and_extras_that_it_has():
    """`rmr` alone is another project on the package index."""
    extras = set(PROJECT["project"]["optional-dependencies"])
    told = re.compile(r"pip install (?:-\w+ )*'?(?P<name>rmr[\w.-]*|\.)(?:\[(?P<extras>[\w, -]+)\])?")
    found = [(name, each) for name, text in tracked_text() for each in told.finditer(text)]
    known = (PROJECT["project"]["name"], ".", "rmr_robots-VERSION.whl")
    assert len(found) > 10
    assert [(name, each[0]) for name, each in found if each["name"] not in known] == []
    wanted = {(name, extra) for name, each in found if each["extras"] for extra in re.split(r", *", each["extras"])}
    assert {(name, extra) for name, extra in wanted if extra not in extras} == set()


def test_no_tracked_source_is_left_to_be_done():
    mark = "TO" + "DO"
    assert [name for name, text in tracked_text() if name.endswith(".py") and mark in text] == []


def test_no_two_modules_of_the_tests_share_a_name():
    """They are imported by their bare names, so the second would be taken for the first."""
    paths = [PurePosixPath(name) for name, _ in tracked_text() if name.startswith("tests/") and name.endswith(".py")]
    counts = Counter(path.name for path in paths if path.name != "conftest.py")
    assert len(counts) > 100
    assert [str(path) for path in paths if counts[path.name] > 1] == []
