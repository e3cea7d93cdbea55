"""Whatever its size, depth or repetition, a text is answered: by a program, or by what there is too much of."""

import pytest
from lang_source import codes, errors

from rmr.bytecode.codec import decode, encode
from rmr.lang.compiler import compile_file, compile_source
from rmr.lang.read import parser
from rmr.lang.read.parser import NESTING_MAX
from rmr.lang.read.source_text import SOURCE_OCTETS_MAX

DEEP = {
    "parentheses": "p(R, X), Y = {(}X{)} -o p(R, Y).",
    "lists": "p(R, X) -o q(R, {[}X{]}).",
    "constant lists": "p(R, {[}1{]}).",
    "lists taken apart": "p(R, {[}X{]}) -o 1.",
    "calls": "p(R, X) -o p(R, {abs(}X{)}).",
    "choices": "p(R, X) -o p(R, {if(true, 1, }X{)}).",
    "negations": "p(R, X), {not }(X = 1) -o 1.",
    "signs": "p(R, X), Y = {- }X -o p(R, Y).",
    "constant signs": "p(R, {- }1).",
    "types of lists": "type p(robot, {list }int).",
    "comprehensions": "p(R) -o {{X | p(R, X) | }p(R){}}.",
}
"""What nests: between braces what is repeated."""

LONG = {
    "sums": "p(R, X), Y = X{ + 1} -o p(R, Y).",
    "constant sums": "p(R, 1{ + 1}).",
    "conjunctions": "p(R, X), X = 1{ && X = 1} -o 1.",
    "steps": "p(R) -o p(R){ then p(R)}.",
    "heads": "p(R) -o p(R){, p(R)}.",
    "bodies": "p(R){, p(R)} -o 1.",
    "arguments": "p(R{, 1}).",
    "effects": "type action a(R: robot) -o p(R){, p(R)}.",
    "constants": "{const c = 1.\n}",
    "types": "{type p(robot, int).\n}",
    "strategies": "{order textual.\n}",
    "assertions": "{x: assert(p(R), q(R), 1, stop(R)).\n}",
    "joins": "{p(A), p(B) -o 1.\n}",
}
"""What goes on and on."""


def repeated(pattern, times):
    """Return `pattern` with what stands between braces so many times."""
    opening = pattern.replace("{{", "{\0").replace("{}}", "{\1}")
    parts = opening.replace("{", "\2").replace("}", "\2").split("\2")
    return (
        "".join(part * times if index % 2 else part for index, part in enumerate(parts))
        .replace("\0", "{")
        .replace("\1", "}")
    )


@pytest.mark.parametrize("pattern", DEEP.values(), ids=DEEP)
@pytest.mark.parametrize("depth", [15, NESTING_MAX - 10, 400, 10_000])
@pytest.mark.medium
def test_nested_program_compiles_or_is_reported_as_too_deep(pattern, depth):
    compilation = compile_source(repeated(pattern, depth))
    assert {each.code for each in compilation.errors} <= {"E001", "E004", "E008", "E023"}
    assert depth < 10_000 or compilation.program is None
    if compilation.program is not None:
        assert decode(encode(compilation.program, debug=True)) == compilation.program


@pytest.mark.parametrize("pattern", LONG.values(), ids=LONG)
@pytest.mark.parametrize(
    "length", [pytest.param(240, marks=pytest.mark.medium), pytest.param(5_000, marks=pytest.mark.slow)]
)
def test_long_program_compiles_or_is_reported_as_too_large(pattern, length):
    compilation = compile_source(repeated(pattern, length))
    assert {each.code for each in compilation.errors} <= {"E004", "E007", "E008", "E010", "E035"}
    assert length < 5_000 or compilation.program is None
    if compilation.program is not None:
        assert decode(encode(compilation.program, debug=True)) == compilation.program


@pytest.mark.parametrize(
    "what",
    [
        "{}(R).",
        "p(R, {}).",
        'p(R, "{}").',
        "// {}\np(R).",
        "/* {} */ p(R).",
        "p(R). {}: watch(p(R), p(R), 1, stop(R)).",
    ],
)
@pytest.mark.medium
def test_names_strings_and_comments_may_be_long(what):
    compilation = compile_source(what.format("x" * 10_000))
    assert compilation.errors == []
    assert decode(encode(compilation.program, debug=True)) == compilation.program


@pytest.mark.parametrize(
    "number",
    [
        "9" * 10_000,
        "0." + "0" * 10_000 + "1",
        "1e" + "9" * 5_000,
        "1e-" + "9" * 5_000,
        "9" * 5_000 + "ms",
        "@" + "9" * 5_000,
    ],
)
@pytest.mark.medium
def test_numbers_of_any_length_are_values_or_out_of_range(number):
    assert set(errors(f"p(R, {number}). p(R, -{number.lstrip('@')}).")) <= {"E005"}


@pytest.mark.parametrize(
    ("octets", "expected"),
    [
        (b"", ["W107"]),
        (b"\xef\xbb\xbf", ["W107"]),
        (b"\xef\xbb\xbfp(R).\r\np(R, X).\r\n", ["E011", "E023"]),
        (b"p(R).\r\n\r\np(R)\r\nq(R).\r\n", ["E001"]),
        (b"p(R).\0", ["E001"]),
        (b"\0" * 10_000, ["E001"]),
        (b"p(R, \xff).", ["E003"]),
        ("p(R).".encode("utf-16"), ["E003"]),
        (b"\x7fELF" + bytes(range(256)) * 100, ["E003"]),
        (b"p(R).\n" * (SOURCE_OCTETS_MAX // 6 + 1), ["E003"]),
    ],
    ids=["empty", "mark", "mark and CRLF", "CRLF", "NUL", "all NUL", "Latin-1", "UTF-16", "binary", "too large"],
)
@pytest.mark.medium
def test_compiler_handles_arbitrary_octets(tmp_path, octets, expected):
    (tmp_path / "a.rmr").write_bytes(octets)
    assert [each.code for each in compile_file(tmp_path / "a.rmr").diagnostics] == expected


@pytest.mark.medium
def test_a_mark_of_the_encoding_takes_no_column(tmp_path):
    (tmp_path / "a.rmr").write_bytes(b"\xef\xbb\xbfp(R, X).")
    compilation = compile_file(tmp_path / "a.rmr")
    assert compilation.source.position(compilation.diagnostics[0].span.start) == (1, 6)


@pytest.mark.medium
def test_more_items_than_a_program_may_have_are_not_read(monkeypatch):
    monkeypatch.setattr(parser, "ITEMS_MAX", 100)
    assert errors("p(R).\n" * 100) == []
    assert errors("p(R).\n" * 200 + "p(R, X).") == ["E008"]


@pytest.mark.medium
def test_duplicate_definitions_are_reported_once_each():
    text = "type p(robot).\nconst c = 1.\norder textual.\nx: watch(p(R), p(R), 1, stop(R)).\np(R).\n?p(R).\n"
    assert codes(text * 2) == ["E010"] * 4
