"""Every program on a page runs, and every Python block too."""

import json
from pathlib import Path

import pytest
from command_runner import invoke
from doc_blocks import blocks_of, is_file

from rmr.commands.subcommands import command as main

pytestmark = pytest.mark.medium

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCKS = [(page, block) for page in PAGES for block in blocks_of(page.read_text("utf-8"))]
ERROR = ["error"]
"""What stands behind the language of a program that is wrong on purpose; files are for the page's own sessions."""
PROGRAMS = [(p, b) for p, b in BLOCKS if b.language == "rmr" and b.words[:1] != ERROR and not is_file(b)]
PYTHON = [(page, block) for page, block in BLOCKS if block.language == "python"]


@pytest.mark.parametrize(("page", "block"), PROGRAMS, ids=[f"{page.name}:{block.line}" for page, block in PROGRAMS])
def test_a_program_runs(page: Path, block, tmp_path: Path) -> None:
    program = tmp_path / "page.rmr"
    program.write_text(block.text, "utf-8")
    checked = invoke(main, ["check", str(program)])
    if checked.exit_code == 3:
        pytest.fail(checked.output)
    result = invoke(main, ["eval", str(program), "--robots", "1-3", "--until", "2s"])
    assert result.exit_code == 0, result.output
    assert list(json.loads(result.stdout)["robots"]) == ["1", "2", "3"]


@pytest.mark.parametrize(("page", "block"), PYTHON, ids=[f"{page.name}:{block.line}" for page, block in PYTHON])
def test_a_python_block_runs(page: Path, block) -> None:
    exec(compile(block.text, f"{page.name}:{block.line}", "exec"), {})
