"""`rmr fmt` as a command: what it writes, lists and refuses."""

import json
import os
import stat

import pytest
from command_runner import invoke

from rmr.commands import subcommands

UGLY = "p( R ).\r\n// why\r\np(R)-o q(R) ."
NEAT = "p(R).\n// why\np(R) -o q(R).\n"
BAD = "p(R.\n"


def fmt(*arguments, text=None):
    return invoke(subcommands.command, ["fmt", *(str(each) for each in arguments)], text=text)


@pytest.fixture
def program(tmp_path):
    def write(text, name="a.rmr"):
        path = tmp_path / name
        path.write_bytes(text.encode())
        return path

    return write


def test_files_are_rewritten_in_place_and_only_those_that_change(program):
    ugly, neat = program("\ufeff" + UGLY), program(NEAT, "b.rmr")
    os.utime(neat, ns=(1, 1))
    result = fmt(ugly, neat)
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "1 file of 2 formatted\n")
    assert ugly.read_bytes() == neat.read_bytes() == NEAT.encode()
    assert neat.stat().st_mtime_ns == 1


def test_the_permissions_stay_and_so_does_a_symbolic_link(program, tmp_path):
    real = program(UGLY, "real.rmr")
    real.chmod(0o640)
    link = tmp_path / "link.rmr"
    link.symlink_to(real)
    assert fmt(link).exit_code == 0
    assert link.is_symlink()
    assert real.read_text() == NEAT
    assert stat.S_IMODE(real.stat().st_mode) == 0o640
    assert sorted(each.name for each in tmp_path.iterdir()) == ["link.rmr", "real.rmr"]


def test_check_writes_nothing_and_lists_what_would_change(program):
    ugly, neat = program(UGLY), program(NEAT, "b.rmr")
    result = fmt("--check", ugly, neat)
    assert (result.exit_code, result.stdout) == (1, f"{ugly}\n")
    assert ugly.read_bytes() == UGLY.encode()
    assert fmt("--check", neat).exit_code == 0


def test_check_agrees_with_what_formatting_does(program):
    ugly = program(UGLY)
    assert fmt("--check", ugly).exit_code == 1
    assert fmt(ugly).exit_code == 0
    assert fmt("--check", ugly).exit_code == 0


def test_diff_writes_nothing_and_prints_the_change(program):
    ugly = program("p(R).\nq( R ).")
    result = fmt("--diff", ugly)
    assert result.exit_code == 1
    assert result.stdout == (
        f"--- {ugly}\n+++ {ugly}\n@@ -1,2 +1,2 @@\n p(R).\n-q( R ).\n\\ No newline at end of file\n+q(R).\n"
    )
    assert ugly.read_text() == "p(R).\nq( R )."


def test_a_file_with_syntax_errors_is_left_alone_and_the_others_are_formatted(program):
    bad, ugly = program(BAD), program(UGLY, "b.rmr")
    result = fmt(bad, ugly)
    assert result.exit_code == 3
    assert f"{bad}:1:4: error[E001]" in result.stderr
    assert (bad.read_text(), ugly.read_text()) == (BAD, NEAT)


def test_a_program_that_does_not_compile_is_formatted_all_the_same(program):
    wrong = program("p(R)-o q(R,X).")
    assert fmt(wrong).exit_code == 0
    assert wrong.read_text() == "p(R) -o q(R, X).\n"


def test_a_missing_file_is_wrong_usage_and_an_unreadable_one_invalid(program, tmp_path):
    ugly = program(UGLY)
    result = fmt(tmp_path / "missing.rmr", ugly)
    assert (result.exit_code, ugly.read_text()) == (2, NEAT)
    assert "missing.rmr:1:1: error[E003]: no such file" in result.stderr
    assert fmt(tmp_path).exit_code == 2
    binary = tmp_path / "b.rmr"
    binary.write_bytes(b"\xff\xfe")
    assert fmt(binary).exit_code == 3
    assert fmt().exit_code == 2


def test_a_dash_reads_stdin_and_writes_stdout():
    assert fmt("-", text=UGLY).stdout == NEAT
    assert fmt("-", text="p(R, \u00e9).").exit_code == 3
    assert fmt("-", text='p(R,"\u00e9").').stdout == 'p(R, "\u00e9").\n'
    failed = fmt("-", text=BAD)
    assert (failed.exit_code, failed.stdout) == (3, "")
    assert "<stdin>:1:4: error[E001]" in failed.stderr
    checked = fmt("-", "--check", text=UGLY)
    assert (checked.exit_code, checked.stdout) == (1, "<stdin>\n")


def test_a_dash_stands_alone(program):
    assert fmt("-", program(NEAT)).exit_code == 2
    assert fmt("-", "--json", text=NEAT).exit_code == 2


def test_json_says_of_each_file_whether_it_changes(program):
    ugly, neat = program(UGLY), program(NEAT, "b.rmr")
    result = fmt("--check", "--json", ugly, neat)
    assert result.exit_code == 1
    files = [{"file": str(ugly), "changed": True}, {"file": str(neat), "changed": False}]
    assert json.loads(result.stdout) == {"version": 1, "files": files}


@pytest.mark.skipif(os.name != "posix" or os.getuid() == 0, reason="root may write anywhere")
def test_a_file_that_cannot_be_written_is_a_failure_and_stays(program, tmp_path):
    ugly = program(UGLY)
    tmp_path.chmod(0o500)
    result = fmt(ugly)
    tmp_path.chmod(0o700)
    assert (result.exit_code, ugly.read_bytes()) == (1, UGLY.encode())
