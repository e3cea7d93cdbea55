from rmr.lang.compiler import compile_file, compile_source
from rmr.lang.diagnostics.render import render_text, to_json


def rendered(text, color=False):
    compilation = compile_source(text, "a.rmr")
    return render_text(compilation.diagnostics, {"a.rmr": compilation.source}, color)


def test_text_shows_place_code_line_underline_and_hint():
    assert rendered("p(R).\np(R), X = sqr(2) -o q(R, X).\n") == (
        "a.rmr:2:11: error[E015]: there is no function `sqr`\n"
        "    2 | p(R), X = sqr(2) -o q(R, X).\n"
        "      |           ^^^\n"
        "  hint: did you mean `sqrt`?\n"
    )


def test_both_places_of_a_contradiction_are_shown():
    text = rendered("type p(robot).\ntype p(robot).\n")
    assert "a.rmr:2:6: error[E010]" in text
    assert "a.rmr:1:6: note: first declared here\n    1 | type p(robot).\n      |      -\n" in text


def test_colour_is_added_only_on_request():
    assert "\x1b[" in rendered("p(R, X).", color=True)
    assert "\x1b[" not in rendered("p(R, X).")


def test_control_characters_of_a_source_do_not_reach_the_terminal():
    assert "\x1b" not in rendered('p(R, "\x1b[31m", X).\x1b')


def test_a_place_behind_tabs_and_wide_characters_is_underlined_in_its_column():
    _, line, under = rendered('p(R,\t"日本", X).').splitlines()[:3]
    assert line.index("X") + 2 == under.index("^")


def test_a_place_of_several_lines_is_underlined_line_by_line():
    assert rendered("type p(robot).\np(A),\n\n\tp(B)  // both\n  -o 1.\n") == (
        "a.rmr:2:1: error[E035]: nothing in the body leads from `A` to `B`\n"
        "    2 | p(A),\n"
        "      | ^^^^^\n"
        "    3 | \n"
        "    4 |  p(B)  // both\n"
        "      |  ^^^^^^^^^^^^^\n"
        "    5 |   -o 1.\n"
        "      |   ^^^^^\n"
        "a.rmr:2:1: note: a fact of `A`\n"
        "    2 | p(A),\n"
        "      | ----\n"
        "a.rmr:4:2: note: a fact of `B`\n"
        "    4 |  p(B)  // both\n"
        "      |  ----\n"
        "  hint: add a link, a fact of `A` that names the other: `peer(A, B)` or `neighbor(A, B)`\n"
    )


def test_of_very_many_lines_the_first_and_the_last_are_shown():
    text = "type p(robot).\np(A), p(B),\n" + "p(A),\n" * 100 + "p(A) -o 1.\n"
    lines = rendered(text).partition("note")[0].splitlines()
    assert [line.split()[0] for line in lines if "|" in line and line.split()[0] != "|"] == [
        "2",
        "3",
        "4",
        "5",
        "...",
        "103",
    ]


def test_a_place_behind_the_end_of_a_line_has_a_mark():
    assert rendered("p(R)").splitlines()[1:3] == ["    1 | p(R)", "      |     ^"]


def test_columns_are_counted_in_characters_and_marks_in_columns_of_the_screen():
    text = 'p(R, "e\u0301\u4e2d\uff21\U0001f600", X).'  # one character without a column, three with two
    compilation = compile_source(text, "a.rmr")
    [listed] = to_json(compilation.diagnostics, compilation.sources)
    assert (listed["column"], listed["end_column"]) == (text.index("X") + 1, text.index("X") + 2)
    line, under = rendered(text).splitlines()[1:3]
    assert line.endswith(text)
    assert under.index("^") == line.index("X") - 1 + 3


def test_a_very_long_line_is_cut_around_the_place():
    text = rendered("p(R, " + ", ".join(["1"] * 100) + ", X" + ", 1" * 100 + ").")
    assert max(len(line) for line in text.splitlines()) < 240
    assert "X" in text.splitlines()[1]


def test_json_has_the_keys_that_the_contract_names():
    compilation = compile_source("p(R).\np(R, X).\n", "a.rmr")
    listed = to_json(compilation.diagnostics, {"a.rmr": compilation.source})
    assert listed[0] == {
        "file": "a.rmr",
        "line": 2,
        "column": 1,
        "end_line": 2,
        "end_column": 8,
        "severity": "error",
        "code": "E011",
        "message": "`p` has 1 argument, here it is given 2",
        "hint": None,
        "fix": None,
    }
    assert [list(each) for each in listed] == [list(listed[0])] * len(listed)


def test_json_has_the_correction_that_the_compiler_knows():
    compilation = compile_source("p(R, 1).\np(R, sqr(2)).\n", "a.rmr")
    (listed,) = to_json(compilation.diagnostics, compilation.sources)
    place = {"file": "a.rmr", "line": 2, "column": 6, "end_line": 2, "end_column": 9}
    assert listed["fix"] == {**place, "text": "sqrt"}


def test_a_file_that_cannot_be_read_is_a_diagnostic(tmp_path):
    (tmp_path / "latin.rmr").write_bytes(b"p(R, \xe9).")
    (tmp_path / "huge.rmr").write_bytes(b"// \n" * 1_100_000)
    (tmp_path / "code.rmr").write_bytes(b"RMR\x1a\x01")
    for name, unreadable in (("missing", True), ("", True), ("latin", False), ("huge", False), ("code", False)):
        compilation = compile_file(tmp_path / f"{name}.rmr" if name else tmp_path)
        [diagnostic] = compilation.diagnostics
        assert (diagnostic.code, compilation.program, compilation.unreadable) == ("E003", None, unreadable)
        assert render_text([diagnostic], {}, False)
