"""docs/bytecode.md says what the code does: tables, opcodes, functions, reasons, limits, annotated files."""

import ast
import inspect
import re

import pytest
from doc_pages import blocks, codes, page, section, table

from rmr.base.values import ROBOT_ID_MAX
from rmr.bytecode import arithmetic, limits, part_checks, verify
from rmr.bytecode.codec import encode
from rmr.bytecode.conform import LENGTH_MAX, NESTING_MAX
from rmr.bytecode.disassemble import disassemble
from rmr.bytecode.encoder import AGGREGATE, BIND, COMPREHENSION, GUARD, STEPS, TAGS
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.layout import FLAG_DEBUG, FLAG_ENSEMBLE, FLAG_TEXTUAL, MAGIC, SIZE_MAX, TABLES, VERSION
from rmr.bytecode.opcodes import FORMS, Op, Operand
from rmr.bytecode.program import Duty, Kind, Mode, Operator
from rmr.bytecode.provided import PREDICATES
from rmr.lang.compiler import compile_source
from rmr.vm import assertions, derive, goal_ways, goals, machine, match, once, ranks, rotor, underway, watches

PAGE = page("bytecode")


def test_the_header_is_the_one_of_the_code():
    what = {row[0]: row[2] for row in table(PAGE, "offset", "size", "what")}
    assert MAGIC.hex(" ") in what["0"]
    assert what["4"] == f"version: {VERSION}"
    assert (FLAG_TEXTUAL, FLAG_DEBUG, FLAG_ENSEMBLE) == (1 << 0, 1 << 1, 1 << 2)
    assert f"at most {SIZE_MAX:,}".replace(",", " ") in what["6"]


def test_the_tables_are_those_of_the_code():
    told = re.search(r"The tables are, in this order: (.*?) With bit 2", " ".join(section(PAGE, "File").split()))
    assert told is not None
    assert codes(told[1]) == list(TABLES)


def test_the_duties_are_those_of_the_code():
    listed = table(PAGE, "duty", "name", "meaning")
    assert [row[:2] for row in listed] == [(str(int(duty)), duty.name.lower()) for duty in Duty]


def test_the_opcodes_are_those_of_the_code():
    words = {Operand.SMALL: "small", Operand.CONSTANT: "constant"}
    known = []
    for op in Op:
        form = FORMS[op]
        operand = "" if form.operand is Operand.NONE else " " + words.get(form.operand, form.operand.name.lower())
        known.append((f"0x{op:02x}", op.name + operand))
        assert form.pushes == (0 if form.operand is Operand.SKIP else 1)
    listed = table(PAGE, "opcode", "instruction", "does", "no value")
    assert [row[:2] for row in listed] == known
    told = " ".join(PAGE.split())
    assert "Instructions with a skip push nothing, all others one value" in told
    pops = re.search(r"((?:0x\w\w to 0x\w\w(?: and )?)+) pop two values, a below b; (.*?) pop one;", told)
    assert pops is not None
    spans = re.findall(r"0x(\w\w) to 0x(\w\w)", pops[1])
    assert {op for op in Op if any(int(a, 16) <= op <= int(b, 16) for a, b in spans)} == popping(2)
    assert {Op[name] for name in re.findall(r"[A-Z_]+", pops[2])} == popping(1)
    assert "CALL and APPLY pop as many as the function has arguments, LIST as many as its count" in told
    assert popping(-1) == {Op.CALL, Op.APPLY, Op.LIST}


def popping(count):
    """Return the opcodes that pop `count` values; with -1, those whose operand says how many."""
    return {op for op in Op if FORMS[op].pops == count}


def test_the_functions_are_those_of_the_code():
    listed = table(PAGE, "number", "function", "no value")
    assert [row[:2] for row in listed] == [
        (str(i), f"{each.name}({', '.join('abcd'[: each.arity])})") for i, each in enumerate(FUNCTIONS)
    ]


SAMPLES = [0, 1, -7, 2.5, True, "a", (), (1, 2.5), ("a",)]


@pytest.mark.parametrize("op", [*arithmetic.UNARY, *arithmetic.BINARY])
def test_an_operator_is_said_to_have_no_value_if_that_happens(op):
    says = {row[1]: row[3] for row in table(PAGE, "opcode", "instruction", "does", "no value")}
    fails = False
    for left in SAMPLES:
        for right in SAMPLES if op in arithmetic.BINARY else [None]:
            try:
                arithmetic.BINARY[op](left, right) if op in arithmetic.BINARY else arithmetic.UNARY[op](left)
            except arithmetic.NoValue:
                fails = True
    assert bool(says[op.name]) is fails


def test_the_tags_are_those_of_the_code():
    assert [mode.name.lower() for mode in Mode] == ["consume", "read", "keep", "absent"]
    assert (GUARD, BIND) == (4, 5)
    assert "0 consume, 1 read, 2 keep, 3 absent: an atom. 4 guard, 5 bind" in PAGE
    assert [(kind.__name__, tag) for kind, tag in TAGS.items()] == [
        ("DeriveFact", 0),
        ("DeriveGoal", 1),
        ("DeriveAction", 2),
    ]
    assert (COMPREHENSION, STEPS) == (3, 4)
    aggregates = ", ".join(f"{AGGREGATE + operator} {operator.name.lower()}" for operator in Operator)
    assert f"aggregate: {aggregates}" in PAGE
    kinds = ", ".join(f"{kind} {kind.name.lower()}" for kind in Kind)
    assert f"kind: {kinds}" in PAGE


def test_the_kinds_of_what_robots_provide_are_those_of_the_code():
    assert {each.name: each.kind for each in PREDICATES.values() if each.kind is not Kind.SENSED} == {
        "id": Kind.PERSISTENT
    }
    assert "`id` is persistent, all others are sensed" in " ".join(PAGE.split())


def template(node):
    """Return the text of a reason, `…` for what is filled in; None if `node` is no text."""
    if isinstance(node, ast.IfExp):
        return template(node.orelse)
    if isinstance(node, ast.JoinedStr):
        return "".join(part.value if isinstance(part, ast.Constant) else "…" for part in node.values)
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def reasons():
    """Return every text that the verifier may tell: what it yields, and what the check of the stack returns."""
    found = []
    for module, kinds in ((verify, ast.Yield), (part_checks, (ast.Yield, ast.Return))):
        nodes = (node for node in ast.walk(ast.parse(inspect.getsource(module))) if isinstance(node, kinds))
        found += [text for node in nodes if (text := template(node.value)) is not None]
    return set(found)


def test_every_reason_of_the_verifier_is_documented():
    documented = [codes(row[0])[0] for row in table(PAGE, "reason", "what must hold")]
    plain = " ".join(section(PAGE, "What is verified").split()).partition("above, say what must hold: ")[2]
    documented += codes(plain.partition("`.")[0] + "`")
    assert len(set(documented)) == len(documented)
    limit = "… …, at most … are possible"
    assert limit in {template(node) for node in ast.walk(ast.parse(inspect.getsource(limits)))}
    assert set(documented) - {limit} == reasons()


def test_the_limits_are_those_of_the_code():
    named = dict(table(PAGE, "of a file", "at most"))
    assert named == {
        "file": f"{SIZE_MAX >> 20} MiB",
        "variables of a rule or assertion": str(limits.SLOTS_MAX),
        "values on the stack": str(limits.STACK_MAX),
        "instructions in an expression": str(limits.INSTRUCTIONS_MAX),
        "conjuncts in a body": str(limits.CONJUNCTS_MAX),
        "items in a head": str(limits.HEAD_MAX),
        "functions of the program": str(limits.FUNCTIONS_MAX),
        "arguments of a predicate or function": str(limits.ARGUMENTS_MAX),
        "effects of an action, on completion or on failure": str(limits.EFFECTS_MAX),
        "actions that serve an assertion": str(limits.SERVING_MAX),
    }
    values = {row[1]: row[2] for row in table(PAGE, "tag (u8)", "value", "then")}
    assert values["robot"].endswith(f"at most {ROBOT_ID_MAX}")
    assert values["list"].endswith(f"at most {NESTING_MAX} lists in each other")
    assert f"Nothing longer than {LENGTH_MAX} is a value" in PAGE
    assert f"at most {verify.RANK_MAX}" in PAGE


def test_what_a_robot_keeps_is_bounded_as_documented():
    assert {row[0]: int(row[1]) for row in table(PAGE, "kept by a robot", "at most", "beyond")} == {
        "facts": machine.FACTS_MAX,
        "characters and items of the facts' strings and lists": machine.FACTS_LENGTH_MAX,
        "goals that are open": goals.GOALS_MAX,
        "firings of one run": machine.FIRING_BUDGET,
        "steps of the search for ranks in one run": ranks.RANKING_STEPS,
        "runs in a row that wait for ranks": ranks.RANKING_RUNS_MAX,
        "steps and wanted facts of the search": goal_ways.EDGES_MAX,
        "actions of which the end is awaited": underway.ACTIONS_MAX,
        "ordered steps that wait for an action": underway.CHAINS_MAX,
        "jobs that wait for their finish fact": assertions.LIVE_MAX,
        "facts watched for other robots' jobs": watches.WATCHES_MAX,
        "combinations of kept facts for which a rule with a rank has fired": rotor.ROTOR_MEMORY_MAX,
        "matches, of a rule that consumes nothing, that have not fired": once.MATCHES_MAX,
    }
    assert f"looked at {match.LOOKS_MAX} facts" in " ".join(PAGE.split())
    assert f"with more than {derive.MATCHES_MAX} matches of its comprehensions and aggregates" in PAGE


def test_the_example_is_what_the_compiler_and_the_disassembler_make():
    text = section(PAGE, "An example")
    sources, shown = blocks(text, "rmr"), blocks(text, "dis")
    assert len(sources) == len(shown) == 1
    for source, octets in zip(sources, shown, strict=True):
        compilation = compile_source(source)
        assert compilation.diagnostics == []
        assert disassemble(encode(compilation.program, debug=False)) == octets
