"""The documents say what the code does: examples compile, tables equal the code's tables."""

import re
from pathlib import Path

import pytest

from rmr.bytecode.codec import encode
from rmr.bytecode.conform import NESTING_MAX
from rmr.bytecode.disassemble import disassemble
from rmr.bytecode.layout import FLAG_DEBUG, FLAG_TEXTUAL, MAGIC, SIZE_MAX, TABLES, VERSION
from rmr.bytecode.limits import SLOTS_MAX, STACK_MAX
from rmr.bytecode.opcodes import FORMS, FUNCTIONS, Op, Operand
from rmr.lang import provided
from rmr.lang.build import RESERVED
from rmr.lang.compiler import compile_source
from rmr.lang.diagnostic import CODES
from rmr.lang.types import FUNCTIONS as TYPED_FUNCTIONS
from rmr.lang.types import LIST_FUNCTIONS

ROOT = Path(__file__).parents[3]
LANGUAGE = ROOT / "docs" / "language.md"
BYTECODE = ROOT / "docs" / "bytecode.md"
CORRIDOR = ROOT / "deploy" / "labs" / "corridor" / "corridor.rmr"

FENCE = re.compile(r"^```(\w+) ?(.*?)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def blocks(path, language):
    """Return (line, words behind the language, text) of each fenced block of `language`."""
    text = path.read_text(encoding="utf-8")
    found = FENCE.finditer(text)
    return [(text[: m.start()].count("\n") + 1, m[2].split(), m[3]) for m in found if m[1] == language]


def examples():
    for path in (LANGUAGE, BYTECODE, ROOT / "README.md"):
        for line, words, text in blocks(path, "rmr"):
            yield pytest.param(words, text, id=f"{path.name}:{line}")


def rows(path, heading, columns):
    """Return the first `columns` cells of each row of the tables of a section."""
    section = re.split(rf"^#+ {re.escape(heading)}\n", path.read_text(encoding="utf-8"), flags=re.MULTILINE)[1]
    section = re.split(r"^#+ ", section, maxsplit=1, flags=re.MULTILINE)[0]
    cells = [re.split(r"(?<!\\)\|", line)[1:-1] for line in section.splitlines() if line.startswith("| ")]
    return [tuple(cell.strip() for cell in row[:columns]) for row in cells]


def codes(text):
    return [each.code for each in compile_source(text).diagnostics]


def spelt(text):
    """Return a program without comments and spaces."""
    return re.sub(r"\s+", "", re.sub(r"//.*", "", text))


@pytest.mark.parametrize(("words", "text"), list(examples()))
def test_an_example_compiles_or_is_as_wrong_as_it_says(words, text):
    found = set(codes(text))
    if words[:1] == ["error"]:
        assert {code for code in found if code.startswith("E")} == set(words[1:])
    elif words[:1] == ["warning"]:
        assert found == set(words[1:])
    else:
        assert (words, found) == ([], set())


def test_the_tour_shows_the_corridor_program_as_it_runs():
    shown = [spelt(text) for _, _, text in blocks(LANGUAGE, "rmr")]
    assert spelt(CORRIDOR.read_text(encoding="utf-8")) in shown


def test_the_diagnostics_are_those_of_the_code():
    listed = [row for row in rows(LANGUAGE, "Errors and warnings", 2) if row[0] != "code"]
    assert listed == list(CODES.items())


def test_the_reserved_words_are_those_of_the_code():
    words = re.search(r"Reserved, they name nothing: ([^.]*)\.", LANGUAGE.read_text(encoding="utf-8"))
    assert words is not None
    assert set(re.findall(r"`(\w+)`", words[1])) == RESERVED


def test_the_provided_facts_are_those_of_the_code():
    listed = [row[0].strip("`") for row in rows(LANGUAGE, "Sensed facts", 1) if row[0] != "provided"]
    known = [provided.declaration_text(name, types, "") for name, (_, types) in provided.PREDICATES.items()]
    assert [f"type {signature}." for signature in listed] == known


def test_the_provided_actions_are_those_of_the_code():
    listed = [row[0].strip("`") for row in rows(LANGUAGE, "Actions", 1) if row[0] != "provided"]
    assert listed == [provided.declaration_text(name, types, "action ") for name, types in provided.ACTIONS.items()]


def test_the_functions_of_expressions_are_those_of_the_code():
    listed = [name for row in rows(LANGUAGE, "Expressions", 1) for name in re.findall(r"`(\w+)\(", row[0])]
    assert set(listed) == {*TYPED_FUNCTIONS, *LIST_FUNCTIONS, "if"}


def test_the_opcodes_are_those_of_the_code():
    words = {Operand.SMALL: "small", Operand.CONSTANT: "constant"}
    known = []
    for op in Op:
        form = FORMS[op]
        operand = words.get(form.operand, form.operand.name.lower())
        pops = str(form.pops) if form.pops >= 0 else {Op.CALL: "arity", Op.LIST: "count"}[op]
        known.append((f"0x{op:02x}", op.name, operand, pops, str(form.pushes)))
    assert [row for row in rows(BYTECODE, "Code", 5) if row[0].startswith("0x")] == known


def test_the_functions_of_the_byte_code_are_those_of_the_code():
    listed = [row for row in rows(BYTECODE, "Code", 3) if row[0].isdigit()]
    assert listed == [(str(index), each.name, str(each.arity)) for index, each in enumerate(FUNCTIONS)]


def test_the_header_and_the_tables_are_those_of_the_code():
    listed = rows(BYTECODE, "File", 3)
    tables = listed.index(("#", "table", "entry"))
    assert [row[:2] for row in listed[tables + 1 :]] == [(str(index), name) for index, name in enumerate(TABLES)]
    what = {row[0]: row[2] for row in listed[:tables]}
    assert MAGIC.hex(" ") in what["0"]
    assert what["4"] == f"version: {VERSION}"
    assert (FLAG_TEXTUAL, FLAG_DEBUG) == (1 << 0, 1 << 1)
    assert f"{SIZE_MAX:,}".replace(",", " ") in what["6"]


def test_the_limits_are_those_of_the_code():
    limits = dict(rows(BYTECODE, "Limits", 2))
    assert limits["slots of a rule or assertion"] == str(SLOTS_MAX)
    assert limits["values on the stack"] == str(STACK_MAX)
    assert limits["lists in lists, in values and types"] == str(NESTING_MAX)
    assert limits["file"] == f"{SIZE_MAX >> 20} MiB"


def test_the_example_of_the_byte_code_is_what_the_compiler_and_the_disassembler_make():
    [(_, _, source)] = blocks(BYTECODE, "rmr")
    [(_, _, shown)] = blocks(BYTECODE, "dis")
    program = compile_source(source).program
    assert program is not None
    assert disassemble(encode(program, debug=False)) == shown
