"""The files of `rmr-agent` are where its command line says, wherever a handler goes."""

from pathlib import Path

from command_runner import invoke

import rmr_agent.agent_process
from rmr_agent.main import command


def test_files_that_are_written_do_not_depend_on_the_present_folder_of_later(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    taken = []
    monkeypatch.setattr(rmr_agent.agent_process, "perform", lambda options: taken.append(options) or 0)
    (tmp_path / "p.rbc").touch()
    words = ["--id", "1", "p.rbc", "--state", "s", "--log", "logs/one.jsonl", "--record", "one.mcap", "--secret", "k"]
    assert invoke(command(), words, name="rmr-agent").exit_code == 0
    (options,) = taken
    assert (options.state, options.log) == (tmp_path / "s", tmp_path / "logs/one.jsonl")
    assert (options.record, options.secret) == (tmp_path / "one.mcap", tmp_path / "k")
    assert options.program == Path("p.rbc"), "it is read before"
