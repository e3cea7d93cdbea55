"""The user's file of actions: what it registers, and its mistakes in one message each."""

import os
from pathlib import Path

import pytest

from rmr.node.actions.user_file import ActionsError, load_actions

BLINK = "from rmr import action\n@action('blink')\nasync def blink(robot): ...\n"


@pytest.fixture
def file(tmp_path):
    """Return a function that writes a file of actions."""

    def write(text):
        path = tmp_path / "acts.py"
        path.write_text(text)
        return path

    return write


def test_no_file_registers_nothing_and_a_file_its_actions(file):
    assert load_actions(None) == {}
    assert list(load_actions(file(BLINK))) == ["blink"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 / 0\n", ":1: ZeroDivisionError: division by zero"),
        ("def (\n", ": SyntaxError: invalid syntax"),
        ("import no_such_module\n", ":1: ModuleNotFoundError: No module named 'no_such_module'"),
        ("open('/no/such/file')\n", ":1: FileNotFoundError: "),
        ("raise SystemExit(7)\n", r": calls exit\(7\) while it is loaded"),
        ("x = 1\n", ": registers no action"),
    ],
)
def test_a_mistake_of_the_file_is_told_with_its_path_and_line(file, text, message):
    with pytest.raises(ActionsError, match=f"acts.py{message}"):
        load_actions(file(text))


@pytest.mark.parametrize("name", ["acts.py", "../acts.py", "./acts.py"])
def test_the_line_of_a_mistake_is_told_also_of_a_file_that_is_named_from_where_one_is(file, monkeypatch, name):
    folder = file("\n\n1 / 0\n").parent
    (folder / "below").mkdir()
    monkeypatch.chdir(folder / "below" if name.startswith("..") else folder)
    with pytest.raises(ActionsError, match=f"^{Path(name)}:3: ZeroDivisionError"):
        load_actions(Path(name))


def test_a_file_that_raises_what_is_no_exception_is_told_as_well(file):
    with pytest.raises(ActionsError, match=r"acts\.py:2: Own: mine"):
        load_actions(file("class Own(BaseException): pass\nraise Own('mine')\n"))


def test_a_file_that_is_not_there_or_no_python_is_told(tmp_path, file):
    for path in (tmp_path / "none.py", tmp_path, file(BLINK).rename(tmp_path / "acts.txt")):
        with pytest.raises(ActionsError, match="no such Python file"):
            load_actions(path)


def test_a_folder_that_may_not_be_entered_is_told(monkeypatch):
    def denied(_path):
        raise PermissionError(13, os.strerror(13))

    monkeypatch.setattr(Path, "is_file", denied)
    with pytest.raises(ActionsError, match=r"acts\.py: Permission denied"):
        load_actions(Path("acts.py"))
