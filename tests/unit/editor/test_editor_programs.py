"""Texts, positions and roots of the programs that an editor has open, without an editor."""

import pytest

from rmr_editor.programs import Change, Lines, Programs

FACE = "\U0001f600"


def opened(programs, path, text):
    uri = path.as_uri()
    programs.open(uri, str(path), text, 1)
    return uri


def compiled(programs):
    """Compile what has changed; return the codes of what is said about each file, by its name."""
    job = programs.job()
    assert programs.take(job, job.run())
    found = programs.diagnostics()
    return {uri.rpartition("/")[2]: [each.code for each, _ in found[uri]] for uri in found}


@pytest.mark.parametrize(("encoding", "behind"), [("utf-8", 4 + 2 + 1), ("utf-16", 2 + 1 + 1), ("utf-32", 1 + 1 + 1)])
def test_positions_count_units_of_the_encoding(encoding, behind):
    text = f"first\r\n{FACE}äx"
    lines = Lines(text, encoding)
    assert lines.position(len(text)) == (1, behind)
    for offset in (0, 3, 5, 7, 8, 9, 10):
        assert lines.offset(*lines.position(offset)) == offset


def test_a_position_within_a_character_is_its_beginning():
    assert Lines(f"a{FACE}b", "utf-16").offset(0, 2) == 1
    assert Lines(f"a{FACE}b", "utf-8").offset(0, 3) == 1


def test_a_position_beyond_a_line_is_its_end_and_beyond_the_last_line_that_of_the_text():
    lines = Lines("ab\ncd\r\nef\rgh", "utf-16")
    assert [lines.offset(line, 99) for line in range(6)] == [2, 5, 9, 12, 12, 12]
    assert lines.position(6) == (1, 2)  # between carriage return and line feed


def test_lines_end_where_the_protocol_says_and_nowhere_else():
    assert Lines("a\u2028b\x0bc\fd\x85e", "utf-16").position(8) == (0, 8)


def test_changes_are_applied_one_after_the_other(tmp_path):
    programs = Programs()
    uri = opened(programs, tmp_path / "a.rmr", f"p(R).\n// {FACE} q\n")
    changes = [Change("qq", (1, 6), (1, 7)), Change("x", (1, 8), (1, 8)), Change("", (0, 0), (1, 0))]
    assert programs.change(uri, 2, changes)
    assert programs.buffer(uri).text == f"// {FACE} qqx\n"
    assert programs.change(uri, 3, [Change("new")])
    assert programs.buffer(uri).text == "new"
    assert not programs.change("file:///none.rmr", 1, [])


def test_an_included_file_is_judged_within_the_program_that_includes_it(tmp_path):
    (tmp_path / "part.rmr").write_text("on disk")
    programs = Programs()
    opened(programs, tmp_path / "part.rmr", "type p(robot).\np(R) -o q(R).\n")
    assert compiled(programs) == {"part.rmr": ["W115"]}  # alone: nothing starts it
    main = opened(programs, tmp_path / "main.rmr", 'include "part.rmr".\np(R).\nq(R) -o 1.\n')
    assert compiled(programs) == {"part.rmr": [], "main.rmr": []}
    programs.change(main, 2, [Change("")])
    assert compiled(programs) == {"part.rmr": ["W115"], "main.rmr": ["W107"]}


def test_a_change_of_a_part_compiles_its_program_and_no_other(tmp_path):
    programs = Programs()
    part = opened(programs, tmp_path / "part.rmr", "p(R).\n")
    opened(programs, tmp_path / "main.rmr", 'include "part.rmr".\np(R) -o 1.\n')
    opened(programs, tmp_path / "other.rmr", "q(R).\nq(R) -o 1.\n")
    compiled(programs)
    assert [each.name for each in programs.job().kept] == ["main.rmr", "other.rmr"]
    programs.change(part, 2, [Change("p(R")])
    assert [each.name for each in programs.job().kept] == ["other.rmr"]
    assert compiled(programs) == {"part.rmr": ["E001"], "main.rmr": [], "other.rmr": []}


def test_files_that_include_each_other_have_one_root(tmp_path):
    programs = Programs()
    opened(programs, tmp_path / "a.rmr", 'include "b.rmr".\n')
    opened(programs, tmp_path / "b.rmr", 'include "a.rmr".\n')
    assert compiled(programs) == {"a.rmr": [], "b.rmr": ["E009"]}


def test_a_file_that_was_missing_is_read_once_it_is_there(tmp_path):
    programs = Programs()
    main = opened(programs, tmp_path / "main.rmr", 'include "part.rmr".\np(R) -o 1.\n')
    assert compiled(programs) == {"main.rmr": ["E003"]}
    opened(programs, tmp_path / "part.rmr", "p(R).\n")
    assert compiled(programs) == {"main.rmr": [], "part.rmr": []}
    programs.close((tmp_path / "part.rmr").as_uri())
    assert compiled(programs) == {"main.rmr": ["E003"]}
    (tmp_path / "part.rmr").write_text("p(R).\n")
    programs.on_disk()
    assert compiled(programs) == {"main.rmr": []}
    assert programs.buffer(main).version == 1


def test_results_of_older_texts_are_refused(tmp_path):
    programs = Programs()
    uri = opened(programs, tmp_path / "a.rmr", "p(R).\n")
    job = programs.job()
    programs.change(uri, 2, [Change("p(")])
    assert not programs.take(job, job.run())
    assert not programs.settled
    assert compiled(programs) == {"a.rmr": ["E001"]}
    assert programs.settled


def test_a_text_larger_than_any_program_is_refused(tmp_path):
    programs = Programs()
    opened(programs, tmp_path / "a.rmr", " " * ((1 << 22) + 1))
    assert compiled(programs) == {"a.rmr": ["E003"]}
