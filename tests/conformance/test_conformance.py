"""Compiler and machine, whichever engine runs it, make of each case what stands beside it.

Run with RMR_REWRITE=1 to write octets and traces anew, and review them as a diff.
"""

import json
import os
from pathlib import Path

import pytest
from conformance import Case, as_hex, as_lines

from rmr.bytecode.codec import decode, encode
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.heads import bodies, items
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    GOALS_OF,
    Aggregate,
    Comprehension,
    Constant,
    Duty,
    Fold,
    HeadValue,
    Kind,
    Mode,
    Operator,
    Program,
    Slot,
    Steps,
    When,
)
from rmr.lang.compiler import compile_file
from rmr.vm.engines import Engine

CASES = Path(__file__).parent / "cases"
SOURCES = sorted(CASES.glob("*.rmr"))
REWRITE = bool(os.environ.get("RMR_REWRITE"))


DRIVEN = "W115"
"""A program that nothing starts: the scripts beside the cases insert the facts."""

WARNED = {
    "budget": {"W113"},  # the budget ends a rule that never stops
    "assertion": {"W116"},
    "assertion_across": {"W116"},
    "assertion_for_one": {"W116"},
    "assertion_holds": {"W116"},
    "assertion_reported": {"W116"},
}
"""Cases with warnings that are meant; jobs that no action serves have no turns."""


def compiled(source: Path) -> bytes:
    compilation = compile_file(source)
    assert compilation.program is not None, compilation.diagnostics
    found = {each.code for each in compilation.diagnostics} - {DRIVEN}
    assert found == WARNED.get(source.stem, set())
    return encode(compilation.program, debug=False)


def octets(source: Path) -> bytes:
    return bytes.fromhex(source.with_suffix(".hex").read_text())


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_the_compiler_writes_the_octets(source):
    data = compiled(source)
    if REWRITE:
        source.with_suffix(".hex").write_text(as_hex(data))
    assert data == octets(source)


@pytest.mark.parametrize("engine", Engine, ids=lambda engine: engine.value)
@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_the_machine_leaves_the_trace(source, engine):
    script = json.loads(source.with_suffix(".json").read_text())
    trace = as_lines(Case(decode(octets(source)), script, engine).run())
    beside = source.with_suffix(".jsonl")
    if REWRITE and engine is Engine.INTERPRETER:
        beside.write_text(trace)
    assert trace == beside.read_text()


def test_every_case_is_whole_and_nothing_else_is_there():
    kinds = {".rmr", ".json", ".hex", ".jsonl"}
    assert {path.name for path in CASES.iterdir()} == {source.stem + kind for source in SOURCES for kind in kinds}
    assert 25 <= len(SOURCES) <= 80


def codes(thing: object) -> list[object]:
    """Everything that stands in a program."""
    found = [thing]
    if isinstance(thing, tuple):
        for item in thing:
            found += codes(item)
    elif hasattr(thing, "__dataclass_fields__"):
        for name in thing.__dataclass_fields__:
            found += codes(getattr(thing, name))
    return found


def test_every_construct_has_a_case():
    read: set[bool] = set()
    withdrawn: set[bool] = set()
    programs = [decode(octets(source)) for source in SOURCES]
    parts = [part for program in programs for part in codes(program)]
    instructions = {(part.op, part.operand) for part in parts if type(part).__name__ == "Instruction"}
    assert {op for op, _ in instructions} == set(Op)
    assert {operand for op, operand in instructions if op is Op.CALL} == set(range(len(FUNCTIONS)))
    assert {part.operator for part in parts if isinstance(part, Aggregate)} == set(Operator)
    assert {part.mode for program in programs for part in atoms(program)} == set(Mode)
    assert {part.kind for program in programs for part in program.predicates} == set(Kind)
    assert {Comprehension, Aggregate, Steps, HeadValue, When} <= {type(part) for part in parts}
    assert {part.operator for part in parts if isinstance(part, Fold)} == set(Operator)
    assert {each.best.least for program in programs for each in program.predicates if each.best} == {True, False}
    assert {each.unordered for program in programs for each in program.predicates} == {True, False}
    assert any(program.functions for program in programs)
    for program in programs:
        tables = {at for at, each in enumerate(program.predicates) if each.name.startswith(GOALS_OF)}
        read |= {each.predicate in tables for each in atoms(program)}
        withdrawn |= {each.predicate in tables for rule in program.rules for each in items(rule.head)}
    assert read == withdrawn == {True, False}
    assertions = [each for program in programs for each in program.assertions]
    assert {each.scheduled for each in assertions} == {True, False}
    assert any(each.robot is not None for each in assertions)
    assert any(isinstance(each.finisher, Constant) for each in assertions)
    assert any(each.finisher != Slot(0) and isinstance(each.finisher, Slot) for each in assertions)
    assert {each.duty for program in programs for each in program.ensemble} == set(Duty)
    assert any(goal.leads is not None for program in programs for goal in program.goals)


def atoms(program: Program) -> list[object]:
    inner = [conjunct for rule in program.rules for body in bodies(rule) for conjunct in body]
    return [each for each in inner if hasattr(each, "mode")]


KINDS_OF_LINE = (
    *("fired", "inserted", "removed", "sent", "achieved", "withdrawn", "action", "cancelled", "failed"),
    *("repeats", "started", "finished", "missed", "await", "seen", "facts"),
)


def test_every_kind_of_line_stands_in_a_trace():
    lines = [line for source in SOURCES for line in source.with_suffix(".jsonl").read_text().splitlines()]
    firsts = {next(key for key in json.loads(line) if key != "at") for line in lines}
    assert firsts == set(KINDS_OF_LINE)
    readme = (CASES.parent / "README.md").read_text()
    assert [kind for kind in KINDS_OF_LINE if f'`{{"at": ..., "{kind}": ' not in readme and kind != "facts"] == []
