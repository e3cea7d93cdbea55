"""`rmr record`: what it prints, its exit codes, what is wrong in one sentence."""

import json

import pytest
from command_runner import invoke
from record_maker import write_part

from rmr.commands import subcommands


def record(*words):
    return invoke(subcommands.command, ["record", *map(str, words)])


@pytest.fixture
def run(tmp_path):
    for process in ("world", "robots-1-2", "robots-3"):
        write_part(tmp_path / "record" / f"{process}.mcap", process, run="5", finish=process != "robots-3")
    return tmp_path


def test_info_lists_channels_and_attachments(run):
    answer = record("info", run)
    assert answer.exit_code == 0
    assert answer.stdout.startswith("corridor, processes, seed 7, robots 1-3\n")
    assert "/trace" in answer.stdout
    assert "900 messages" in answer.stdout
    assert "floor.json" in answer.stdout
    assert "robots-3.mcap: the file was cut short" in answer.stderr


def test_the_folder_that_holds_the_folders_of_runs_is_none_of_a_run_and_the_newest_is_named(run):
    assert "is no run folder" in record("info", run.parent / "nothing").stderr + record("info", run / "record").stderr
    answer = record("info", run.parent)
    assert answer.exit_code == 3
    assert answer.stderr == (
        f"rmr record info: {run.parent}: no recording of a run: it holds the folders of runs; name one, such as {run}, "
        "the newest\n"
    )


def test_info_as_json_is_one_document(run):
    found = json.loads(record("info", run, "--json").stdout)
    assert found["channels"] == {"/trace": {"messages": 900, "octets": found["channels"]["/trace"]["octets"]}}
    assert found["about"]["roster"] == "1-3"
    assert found["complete"] is False
    assert len(found["problems"]) == 1


def test_join_tells_the_file_and_what_is_missing(run):
    answer = record("join", run)
    assert answer.exit_code == 0
    assert answer.stdout == f"{run / 'run.mcap'}: 900 messages\n"
    assert "robots-3.mcap: the file was cut short" in answer.stderr
    again = record("join", run)
    assert again.exit_code == 0
    assert "nothing to join" in again.stdout


def test_recover_gives_a_file_its_index(tmp_path):
    path = write_part(tmp_path / "a.mcap", "sim", finish=False)
    assert record("recover", path).stdout == f"{path}: 300 messages\n"
    assert "nothing to recover" in record("recover", path).stdout


@pytest.mark.parametrize("name", ["info", "join", "recover"])
def test_a_path_that_is_not_there_is_wrong_usage(name, tmp_path):
    answer = record(name, tmp_path / "none")
    assert answer.exit_code == 2
    assert f"{tmp_path / 'none'}: No such file or directory" in answer.stderr


@pytest.mark.parametrize("name", ["info", "join", "recover"])
def test_what_is_no_recording_is_invalid(name, tmp_path):
    (tmp_path / "a.txt").write_text("hello")
    for path in (tmp_path, tmp_path / "a.txt"):
        answer = record(name, path)
        assert answer.exit_code == 3
        assert answer.stderr.startswith(f"rmr record {name}: {path}: no ")
        assert answer.stderr.count("\n") == 1


def test_a_file_that_cannot_be_written_is_a_failure(run):
    answer = record("join", run, "-o", run / "none" / "a.mcap")
    assert answer.exit_code == 1
    told = f"rmr record join: cannot write {run / 'none' / 'a.mcap'}: No such file or directory"
    assert answer.stderr == f"{told}; what was recorded is where it was\n"
