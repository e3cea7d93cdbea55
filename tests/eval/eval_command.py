"""Helpers for the tests of `rmr eval`: programs as text, the command in this process, its report."""

import json
from typing import Any

from command_runner import Result, invoke

from rmr.commands.subcommands import command as main


class Bench:
    """A folder of programs and the command run on them."""

    def __init__(self, folder):
        self.folder = folder

    def file(self, name: str, text: str) -> str:
        """Write a file; return its path."""
        (self.folder / name).write_text(text)
        return str(self.folder / name)

    def call(self, *arguments: str) -> Result:
        """Run `rmr eval` with arguments."""
        result = invoke(main, ["eval", *arguments], name="rmr")
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        return result

    def run(self, text: str, *arguments: str) -> dict[str, Any]:
        """Run a program; return its report."""
        result = self.call(self.file("p.rmr", text), *arguments)
        assert result.exit_code == 0, result.stderr
        report: dict[str, Any] = json.loads(result.stdout)
        return report

    def refused(self, text: str, *arguments: str, code: int = 2) -> str:
        """Run a program that is refused; return what is said."""
        result = self.call(self.file("p.rmr", text), *arguments)
        assert (result.exit_code, result.stdout) == (code, ""), result.output
        return result.stderr

    def told(self, text: str, *arguments: str) -> str:
        """Run a program; return what is said beside the report."""
        return self.call(self.file("p.rmr", text), *arguments).stderr

    def notes(self, text: str, *arguments: str) -> list[dict[str, Any]]:
        """Run a program; return its trace."""
        self.run(text, *arguments, "--trace", str(self.folder / "t.jsonl"))
        return [json.loads(line) for line in (self.folder / "t.jsonl").read_text().splitlines()]


def facts(report, robot=1):
    """The facts of one robot."""
    return report["robots"][str(robot)]["facts"]


def actions(report, robot=1):
    """The actions of one robot."""
    return report["robots"][str(robot)]["actions"]
