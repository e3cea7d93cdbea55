"""Claims about when the compiled form of a module is found in place of its source."""

import subprocess
import sys

import pytest

from rmr.compiled import INDEX, Finder, modules_in, state


@pytest.fixture
def folder(tmp_path):
    """A folder of compiled modules, here told from their sources by a word: Python asks both in the same way."""
    sources = tmp_path / "sources"
    sources.mkdir()
    for name in ("one", "two"):
        (sources / f"{name}.py").write_text("FORM = 'source'\n")
    made = tmp_path / "compiled"
    (made / "lib").mkdir(parents=True)
    (made / "lib" / "one.py").write_text("FORM = 'compiled'\n")
    write_index(made, sources)
    return made


def write_index(made, sources, python=sys.implementation.cache_tag):
    lines = [f"{state(sources / 'one.py')}\tlib.one\t{sources / 'one.py'}"]
    lines += [f"{state(sources / 'two.py')}\t\t{sources / 'two.py'}"]
    (made / INDEX).write_text("\n".join([python, *lines, ""]))


def test_what_was_made_of_these_sources_is_found(folder):
    assert modules_in(folder) == {"lib.one"}
    assert Finder(folder, modules_in(folder)).find_spec("lib.one").origin == str(folder / "lib" / "one.py")


def test_what_was_not_compiled_is_left_to_others(folder):
    assert Finder(folder, modules_in(folder)).find_spec("lib.two") is None


@pytest.mark.parametrize("changed", ["one.py", "two.py"])
def test_after_a_change_of_any_source_all_are_interpreted(folder, changed):
    source = folder.parent / "sources" / changed
    source.write_text(source.read_text() + "# changed\n")
    assert modules_in(folder) == frozenset()


def test_what_was_compiled_for_another_python_is_not_taken(folder):
    write_index(folder, folder.parent / "sources", python="cpython-27")
    assert modules_in(folder) == frozenset()


@pytest.mark.parametrize("index", ["", "nonsense", f"{sys.implementation.cache_tag}\nnonsense", None])
def test_a_folder_without_a_whole_index_holds_nothing(folder, index):
    (folder / INDEX).unlink()
    if index is not None:
        (folder / INDEX).write_text(index)
    assert modules_in(folder) == frozenset()


def test_a_source_that_is_gone_is_a_change(folder):
    (folder.parent / "sources" / "two.py").unlink()
    assert modules_in(folder) == frozenset()


@pytest.mark.parametrize("named", ["", "nowhere"])
def test_where_rmr_compiled_names_no_such_folder_sources_are_interpreted(named):
    code = "import rmr.base.geometry; print(rmr.base.geometry.__file__)"
    command = [sys.executable, "-c", code]
    told = subprocess.run(command, env={"RMR_COMPILED": named}, capture_output=True, text=True, check=True).stdout
    assert told.endswith("geometry.py\n")
