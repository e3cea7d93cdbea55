"""The fenced blocks of a page, and what its console sessions print.

A block with a file name behind its language (```` ```rmr hello.rmr ````) writes that file; a ``console`` block holds
commands (``$ rmr eval ...``) and what they print. The blocks of one page share a folder, in the order of the page. A
line ``...`` of an output stands for any lines. With RMR_REWRITE=1 outputs that do not agree are written anew, and what
``...`` left out stays left out.
"""

import re
import shlex
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from difflib import SequenceMatcher
from io import StringIO
from pathlib import Path

from command_runner import invoke

from rmr.commands.subcommands import PROGRAMS
from rmr.commands.subcommands import command as main
from rmr.entry.command_line import Runnable
from rmr_deploy.why_program import why_command
from rmr_lab.main import check, new
from rmr_sim.main import main as simulate
from rmr_sim.main import sweep_command
from rmr_view.plot import command as plot

FENCE = re.compile(r"^```(?P<language>\w+)(?P<words>[^\n]*)\n(?P<text>.*?)^```$", re.DOTALL | re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """A fenced block."""

    language: str
    words: list[str]
    text: str
    start: int
    """Offset of its text in the page."""
    line: int


def blocks_of(page: str) -> list[Block]:
    """Return the fenced blocks of a page."""
    return [
        Block(m["language"], m["words"].split(), m["text"], m.start("text"), page.count("\n", 0, m.start()) + 1)
        for m in FENCE.finditer(page)
    ]


def is_file(block: Block) -> bool:
    """Whether the block is a file to write."""
    return len(block.words) == 1 and re.fullmatch(r"[\w/-]+\.\w+", block.words[0]) is not None


def has_sessions(page: str) -> bool:
    """Whether a page has console blocks."""
    return any(block.language == "console" for block in blocks_of(page))


def session(text: str) -> list[tuple[str, str]]:
    """Return the commands of a console block with what the page says they print."""
    parts = re.split(r"^\$ (.*(?:\\\n.*)*)\n", text, flags=re.MULTILINE)
    assert parts[0] == "", f"a console block begins with `$ command`: {text!r}"
    return list(zip(parts[1::2], parts[2::2], strict=True))


PROGRESS = re.compile(r"^\d+ of \d+ runs, .* to go\n", re.MULTILINE)
"""How far a sweep is: how often that is told depends on the machine's speed, so pages leave it out."""


def printed(command: str) -> str:
    """Run a command of this package in the present folder; return what it prints."""
    given, _, piped = command.replace("\\\n", " ").rpartition(" | ")
    name, *arguments = shlex.split(piped)
    text = shlex.split(given)[1].replace("\\n", "\n") if given else None  # of `printf TEXT | command`
    if name == "cat":
        return "".join(Path(each).read_text("utf-8") for each in arguments)
    if arguments[:1] == ["sim"]:  # a program of its own: as a subcommand it would take this process's place
        return _simulated(arguments[1:])
    if arguments[:1] == ["sweep"]:  # likewise
        return _invoked(sweep_command(), arguments[1:])
    if arguments[:1] == ["why"]:  # likewise
        return _invoked(why_command(), arguments[1:])
    if arguments[:1] == ["new"]:  # likewise
        return _invoked(new, arguments[1:])
    if arguments[:1] == ["plot"]:  # likewise
        return _invoked(plot(), arguments[1:])
    if arguments[:1] == ["check"] and not any(each.endswith(".rmr") for each in arguments):  # a lab
        return _invoked(check, arguments[1:])
    assert arguments[:1] == [] or arguments[0] not in PROGRAMS, f"{command} would take this process's place"
    arguments = ["compile", *arguments] if name == "rmrc" else arguments
    return _invoked(main, arguments, text)


def _invoked(command: Runnable, arguments: list[str], text: str | None = None) -> str:
    result = invoke(command, arguments, text=text)
    assert result.exception is None or isinstance(result.exception, SystemExit), arguments
    return result.output


def _simulated(arguments: list[str]) -> str:
    out = StringIO()
    with redirect_stdout(out), redirect_stderr(out):
        simulate(arguments)
    return PROGRESS.sub("", out.getvalue())


def agrees(shown: str, output: str) -> bool:
    """Whether `output` is what a page shows, `...` lines aside."""
    pattern = "".join(
        r"(?:.*\n)*?" if line.strip() == "..." else re.escape(line) for line in shown.splitlines(keepends=True)
    )
    return re.fullmatch(pattern, output) is not None


GAP = "...\n"


def written_anew(shown: str, output: str) -> str:
    """Return what a page shows of a new `output`: the lines most like those that it showed, `...` between them."""
    parts = [part.splitlines(keepends=True) for part in re.split(r"^\.\.\.\n", shown, flags=re.MULTILINE)]
    lines = output.splitlines(keepends=True)
    at = len(parts[0])
    found = ["".join(lines[:at])]
    for part in parts[1:-1]:
        starts = range(at, max(at, len(lines) - len(part)) + 1)
        start = max(starts, key=lambda k: sum(map(_likeness, part, lines[k:])))
        at = start + len(part)
        found.append("".join(lines[start:at]))
    if len(parts) > 1:
        found.append("".join(lines[max(at, len(lines) - len(parts[-1])) :]))
    new = GAP.join(found)
    return new if len(parts) > 1 and agrees(new, output) else output


def _likeness(one: str, other: str) -> float:
    """Return how much two lines are alike, numbers aside and as they are: 0 to 2."""
    return (
        SequenceMatcher(None, *(re.sub(r"\d+", "0", line) for line in (one, other))).ratio()
        + SequenceMatcher(None, one, other).ratio()
    )
