import json
import os
import subprocess
import sys

import pytest
from command_runner import invoke

from rmr import __version__, cli
from rmr.bytecode.layout import SIZE_MAX
from rmr.commands import subcommands
from rmr.entry import JSON_VERSION

GOOD = "p(R).\np(R) -o q(R).\n"
DOUBTED = "location(R, s).\nlocation(R, L), L = S -o 1.\n"
BAD = "p(R, X).\n"


def rmr(*arguments):
    return invoke(subcommands.command, [str(each) for each in arguments])


@pytest.fixture
def program(tmp_path):
    def write(text, name="a.rmr"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def test_help_and_version_name_every_command():
    result = rmr("--help")
    assert result.exit_code == 0
    external = {**subcommands.PROGRAMS, **subcommands.FLEET}
    for name in (*subcommands.COMMANDS, *external):
        assert f"  {name} " in result.stdout
        assert name in external or rmr(name, "--help").exit_code == rmr(name, "--version").exit_code == 0
    assert rmr("--version").stdout == f"rmr (rmr-robots) {__version__}\n"


def test_help_imports_neither_the_parser_nor_anything_heavy():
    script = "import sys, contextlib; from rmr.commands.subcommands import command\n"
    script += "with contextlib.suppress(SystemExit): command.main(['--help'])\n"
    script += "print(sorted(set(sys.modules) & {'lark', 'pydantic', 'rmr.lang', 'numpy', 'zenoh', 'asyncio'}))"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert result.stdout.endswith("[]\n")


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (GOOD, 0),
        (DOUBTED, 0),
        ("", 0),
        (BAD, 3),
        (b"p(R, \xe9).", 3),
        (b"\0\0\0", 3),
        ("p(R, " + "(" * 10_000, 3),
        ("p(R), X = " + "1 + " * 10_000 + "1 -o q(R).", 3),
        ("// \n" * (1 << 20) + "//", 3),
    ],
)
def test_check_tells_by_its_exit_code_whether_a_program_is_valid(program, text, code):
    result = rmr("check", program(text))
    assert result.exit_code == code
    assert "Traceback" not in result.output
    assert bool(result.stderr) == (text != GOOD)


def test_check_reports_several_files_and_the_worst_of_them_decides(program, tmp_path):
    result = rmr("check", program(GOOD), program(BAD, "b.rmr"), tmp_path / "missing.rmr", program(DOUBTED, "d.rmr"))
    assert result.exit_code == 3
    for name in ("b.rmr:1:6: error[E023]", "missing.rmr:1:1: error[E003]: no such file", "d.rmr:2:21: warning[W101]"):
        assert name in result.stderr
    assert result.stderr.endswith("2 errors, 1 warning\nfor more: rmr explain E023\n")


def test_a_missing_file_and_a_directory_are_wrong_usage(tmp_path):
    assert rmr("check", tmp_path / "missing.rmr").exit_code == 2
    assert rmr("check", tmp_path).exit_code == 2
    assert rmr("compile", tmp_path / "missing.rmr").exit_code == 2
    assert rmr("check").exit_code == 2


def test_check_as_json_prints_one_document_on_stdout_and_nothing_else(program, tmp_path):
    result = rmr("check", "--json", program(BAD), program(GOOD, "b.rmr"), tmp_path / "missing.rmr")
    listed = json.loads(result.stdout)["diagnostics"]
    assert [each["code"] for each in listed] == ["E023", "E003"]
    assert result.stderr == ""
    assert json.loads(rmr("check", "--json", program(GOOD)).stdout) == {"version": JSON_VERSION, "diagnostics": []}


CORRECTABLE = """\
include "part.rmr".
ball(@1)
ball(R) - o full(R, sqr(4)).
type full(robot, float).
full(2, 3.0).
full(R, N) -o shown(R, N).
lost(R) -o 1.
"""


def test_check_corrects_the_errors_whose_correction_is_known_and_leaves_the_rest(program):
    path = program(CORRECTABLE)
    path.chmod(0o640)
    part = program("ball(3).\r\n", "part.rmr")
    found = rmr("check", "--fix", path)
    assert path.read_bytes().decode() == (
        CORRECTABLE.replace("ball(@1)", "ball(@1).")
        .replace("- o", "-o")
        .replace("sqr", "sqrt")
        .replace("full(2", "full(@2")
    )
    assert part.read_bytes() == b"ball(@3).\r\n", "an included file, with its ends of lines"
    assert path.stat().st_mode & 0o777 == 0o640
    assert f"{part}: 1 error corrected" in found.stderr
    assert "W102" in found.stderr, "a rule that cannot fire is a warning: what it means is not known"
    assert "sqrt" in path.read_text()
    before = path.read_bytes()
    again = rmr("check", "--fix", path)
    assert "corrected" not in again.stderr
    assert path.read_bytes() == before


def test_a_program_that_two_include_is_corrected_once(program):
    part = program("ball(3).\n", "part.rmr")
    programs = [program(f'include "part.rmr".\ngo(R).\n// {name}\n', name) for name in ("a.rmr", "b.rmr")]
    assert rmr("check", "--fix", *programs).exit_code == 0
    assert part.read_text() == "ball(@3).\n"


def test_a_program_that_may_not_be_written_is_named_and_left(program, monkeypatch):
    path = program("ball(3).\n")
    monkeypatch.setattr(os, "replace", lambda *_: (_ for _ in ()).throw(PermissionError(13, "Permission denied")))
    found = rmr("check", "--fix", path)
    assert found.exit_code == 1
    assert f"{path}: error: Permission denied" in found.stderr
    assert [each.name for each in path.parent.iterdir()] == ["a.rmr"]


def test_a_lab_is_not_corrected(tmp_path):
    found = rmr("check", "--fix", "corridor")
    assert found.exit_code == 2
    assert "--fix corrects programs" in found.stderr


def test_compile_writes_beside_the_program_and_prints_its_size(program, tmp_path):
    result = rmr("compile", program(GOOD))
    written = (tmp_path / "a.rbc").read_bytes()
    assert result.exit_code == 0
    assert result.stdout == f"{tmp_path}/a.rbc: {len(written)} octets, 2 predicates, 1 rule, 0 warnings\n"
    assert [each.name for each in tmp_path.iterdir()] == ["a.rmr", "a.rbc"] or len(list(tmp_path.iterdir())) == 2


def test_what_compile_writes_is_what_dis_prints(program, tmp_path):
    source = program(GOOD)
    assert rmr("compile", source, "-o", tmp_path / "x.rbc").exit_code == 0
    shown = rmr("dis", tmp_path / "x.rbc")
    assert shown.exit_code == 0
    assert "p($0) -o q($0)" in shown.stdout
    assert f"{source}:2:1" in shown.stdout


def test_a_file_may_be_called_by_any_octets(tmp_path):
    source = tmp_path / os.fsdecode(b"\xff.rmr")
    source.write_text(GOOD)
    assert rmr("check", source).exit_code == 0
    assert rmr("compile", source, "-o", tmp_path / "x.rbc").exit_code == 0
    assert "?.rmr:2:1" in rmr("dis", tmp_path / "x.rbc").stdout


def test_dis_says_what_is_wrong_with_a_file_that_is_too_large(program, tmp_path):
    path = tmp_path / "x.rbc"
    assert rmr("compile", program(GOOD), "-o", path).exit_code == 0
    path.write_bytes(path.read_bytes() + bytes(SIZE_MAX))
    result = rmr("dis", path)
    assert result.exit_code == 3
    assert f"at most {SIZE_MAX}" in result.stderr


def test_a_stripped_program_knows_no_source(program, tmp_path):
    source = program(GOOD)
    assert rmr("compile", source, "-o", tmp_path / "whole.rbc").exit_code == 0
    assert rmr("compile", source, "-o", tmp_path / "bare.rbc", "--strip").exit_code == 0
    assert str(source) not in rmr("dis", tmp_path / "bare.rbc").stdout
    assert (tmp_path / "bare.rbc").stat().st_size < (tmp_path / "whole.rbc").stat().st_size


def test_a_program_larger_than_robots_read_is_not_written(program, tmp_path, monkeypatch):
    monkeypatch.setattr("rmr.bytecode.layout.SIZE_MAX", 60)
    source = program(GOOD)
    result = rmr("compile", source)
    assert result.exit_code == 3
    assert result.stderr.startswith(f"{source}: error: the program takes ")
    assert not (tmp_path / "a.rbc").exists()


def test_compile_as_json_prints_one_document(program, tmp_path):
    document = json.loads(rmr("compile", "--json", program(DOUBTED)).stdout)
    assert document["output"] == f"{tmp_path}/a.rbc"
    assert document["octets"] == (tmp_path / "a.rbc").stat().st_size
    assert (document["predicates"], document["rules"]) == (1, 1)
    assert [each["code"] for each in document["diagnostics"]] == ["W101"]
    document = json.loads(rmr("compile", "--json", program(BAD)).stdout)
    assert (document["output"], document["diagnostics"][0]["code"]) == (None, "E023")


def test_compile_writes_nothing_on_error_and_keeps_what_was_there(program, tmp_path):
    (tmp_path / "a.rbc").write_bytes(b"old")
    result = rmr("compile", program(BAD))
    assert (result.exit_code, result.stdout) == (3, "")
    assert (tmp_path / "a.rbc").read_bytes() == b"old"
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a.rbc", "a.rmr"]


def test_compile_never_overwrites_the_program(program, tmp_path):
    source = program(GOOD, "a.rbc")
    assert rmr("compile", source).exit_code == 2
    assert rmr("compile", source, "-o", tmp_path / "." / "a.rbc").exit_code == 2
    assert source.read_text() == GOOD


def test_an_output_that_cannot_be_written_is_a_failure(program, tmp_path):
    result = rmr("compile", program(GOOD), "-o", tmp_path / "no" / "such" / "x.rbc")
    assert result.exit_code == 1
    assert "No such file or directory" in result.stderr
    (tmp_path / "folder").mkdir()
    assert rmr("compile", program(GOOD), "-o", tmp_path / "folder").exit_code == 1
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a.rmr", "folder"]


@pytest.mark.parametrize("octets", [b"", b"p(R).\n", b"RMR\x1a", b"RMR\x1a" + b"\xff" * 100])
def test_dis_refuses_what_is_no_byte_code(program, octets):
    result = rmr("dis", program(octets, "x.rbc"))
    assert result.exit_code == 3
    assert "no valid byte-code" in result.stderr
    assert "Traceback" not in result.output


def test_dis_of_a_missing_file_is_wrong_usage(tmp_path):
    assert rmr("dis", tmp_path / "x.rbc").exit_code == 2
    assert rmr("dis", tmp_path).exit_code == 2


def test_a_misspelt_command_gets_a_hint():
    result = rmr("chekc")
    assert result.exit_code == 2
    assert "did you mean 'check'?" in result.stderr


@pytest.mark.parametrize("name", [*subcommands.PROGRAMS, *subcommands.FLEET])
def test_a_command_of_another_package_is_carried_out_under_its_name(name):
    command = [sys.executable, "-c", "from rmr.cli import main; main()", name]
    helped = subprocess.run([*command, "--help"], capture_output=True, text=True, check=True)
    assert helped.stdout.startswith(f"usage: rmr {name} ")
    wrong = subprocess.run([*command, "--absurd"], capture_output=True, text=True, check=False)
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert wrong.stderr.startswith(f"rmr {name}: ")


def test_a_package_that_is_not_installed_is_named(capsys):
    assert subcommands.OtherPackage("rmr_absent.main:main").main([], "rmr sim") == 1
    assert capsys.readouterr().err.startswith("rmr sim: rmr_absent is not installed")


@pytest.mark.parametrize(
    ("module", "words", "told"),
    [
        ("lsprotocol", ["lsp"], "rmr lsp: pygls is not installed; pip install 'rmr-robots[editor]' brings it"),
        ("pygls", ["lsp"], "rmr lsp: pygls is not installed; pip install 'rmr-robots[editor]' brings it"),
        (
            "cryptography",
            ["keys", "init", "ca"],
            "cryptography is not installed; pip install 'rmr-robots[keys]' brings it",
        ),
    ],
)
def test_a_library_of_an_extra_that_is_not_installed_is_told(module, words, told, tmp_path):
    code = f"import sys; sys.modules[{module!r}] = None; from rmr.cli import main; main()"
    result = subprocess.run(
        [sys.executable, "-c", code, *words],
        cwd=tmp_path,
        stdin=subprocess.PIPE,
        text=True,
        check=False,
        capture_output=True,
    )
    assert (result.returncode, result.stdout) == (1, "")
    assert result.stderr.endswith(told + "\n")
    assert result.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_rmrc_is_rmr_compile(program, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["rmrc", str(program(GOOD))])
    with pytest.raises(SystemExit) as ended:
        cli.compile_main()
    assert ended.value.code == 0
    assert (tmp_path / "a.rbc").exists()
