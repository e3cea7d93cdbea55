"""A lab's program may be of several files."""

import pytest

from rmr_world.lab_program import ProgramError, load_program


@pytest.fixture
def program(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "main.rmr").write_text('include "parts/moves.rmr".\nstart(R).\nstart(R) -o moveto(R, exit).\n')
    (tmp_path / "parts" / "moves.rmr").write_text("type action moveto(R: robot, A: area) -o at(R, A).\n")
    return tmp_path / "main.rmr"


def test_a_lab_runs_a_program_of_several_files(program):
    loaded = load_program(program)
    assert loaded.warnings == ""
    moveto = loaded.program.predicates[loaded.program.index("moveto")]
    assert [loaded.program.predicates[each.predicate].name for each in moveto.effects] == ["at"]


def test_mistakes_are_shown_in_the_file_in_which_they_are(program):
    part = program.parent / "parts" / "moves.rmr"
    part.write_text(part.read_text() + "start(R, X).\n")
    with pytest.raises(ProgramError) as caught:
        load_program(program)
    shown = str(caught.value)
    assert f"{part}:2:10: error[E023]" in shown
    assert "    2 | start(R, X).\n      |          ^\n" in shown
