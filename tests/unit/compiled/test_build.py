"""Claims about `make fast` where it cannot do what it is asked for."""

import ast
from collections.abc import Iterator

import pytest

from rmr.compiled import build


@pytest.fixture
def stale(monkeypatch, tmp_path):
    """Nothing is compiled yet, and nothing will be."""
    monkeypatch.setattr(build, "FOLDER", build.ROOT / "build" / "no-such-folder")
    monkeypatch.setattr(build, "compile_into", lambda _: pytest.fail("nothing can be compiled here"))
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("arguments", "code"), [([], 2), (["--if-possible"], 0)])
def test_without_a_c_compiler_it_is_said_what_to_do(stale, monkeypatch, capsys, arguments, code):
    monkeypatch.setenv("CC", "no-such-compiler --fast")
    monkeypatch.setattr("sys.argv", ["build", *arguments])
    assert build.main() == code
    told = capsys.readouterr()
    assert "there is no C compiler no-such-compiler: install one, or name yours in CC" in told.err
    assert "all works interpreted as well" in told.err


def test_what_is_not_compiled_exists_and_what_is_compiled_is_named_once():
    hot = build.hot()
    assert len(set(hot)) == len(hot)
    assert all((build.ROOT / path).exists() for path in build.INTERPRETED)
    assert not set(hot) & set(build.INTERPRETED)


def statements() -> Iterator[tuple[str, ast.stmt]]:
    """Yield the statements of the modules that are compiled, with the module's path."""
    for path in build.hot():
        yield from ((path, node) for node in ast.parse((build.ROOT / path).read_text("utf-8")).body)


def test_constants_of_what_is_compiled_are_final():
    """Others are looked up by name at each use. What has a name of one letter is a type variable."""
    constants = [
        (f"{path}:{node.lineno} {name.id}", isinstance(node, ast.AnnAssign) and ast.unparse(node.annotation))
        for path, node in statements()
        for name in (node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)])
        if isinstance(name, ast.Name) and name.id.isupper() and len(name.id) > 1
    ]
    assert len(constants) > 100
    assert [where for where, declared in constants if not (declared and declared.startswith("Final"))] == []


def test_constants_that_are_tuples_of_floats_say_so():
    """mypyc (2.4) takes one whose length it knows, and which begins with a float, for unset in some places."""
    tuples = [
        (path, node, node.value.elts[0])
        for path, node in statements()
        if isinstance(node, ast.AnnAssign) and isinstance(node.value, ast.Tuple) and node.value.elts
    ]
    floats = [
        (path, node)
        for path, node, first in tuples
        if isinstance(first, ast.Constant) and isinstance(first.value, float)
    ]
    assert floats
    assert [f"{path}:{node.lineno}" for path, node in floats if "..." not in ast.unparse(node.annotation)] == []


def test_progress_tells_of_each_package_once_all_its_files_are_compiled(capsys):
    sources = ["b/__native_rmr___base___time.c", "b/__native_rmr___base___arena.c", "b/__native_rmr___node___node.c"]
    progress = build.CompilerProgress()
    progress.begin([*sources, "b/float_ops.c"])
    for source in [sources[0], "b/float_ops.c", "b/rmr/base/time.c", *sources[1:]]:
        progress.done(source)
    assert capsys.readouterr().out.splitlines() == [
        "  rmr.base is compiled; 1 files to go",
        "  rmr.node is compiled; 0 files to go",
    ]
