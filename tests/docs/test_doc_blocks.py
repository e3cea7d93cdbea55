"""Every page says what the commands really print."""

import os
from pathlib import Path

import pytest
from doc_blocks import agrees, blocks_of, has_sessions, is_file, printed, session, written_anew

ROOT = Path(__file__).parents[2]
PAGES = [path for path in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))] if has_sessions(path.read_text())]
LONG = frozenset({"own-lab.md"})
"""Pages whose commands take 10 s."""
TIERED = [
    pytest.param(path, marks=pytest.mark.slow if path.name in LONG else pytest.mark.medium, id=path.name)
    for path in PAGES
]


@pytest.mark.parametrize("page", TIERED)
def test_a_page_shows_what_its_commands_print(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = page.read_text("utf-8")
    changes: list[tuple[int, int, str]] = []
    wrong: list[str] = []
    for block in blocks_of(text):
        if is_file(block):
            Path(block.words[0]).parent.mkdir(parents=True, exist_ok=True)
            Path(block.words[0]).write_text(block.text, "utf-8")
        if block.language != "console":
            continue
        new = ""
        for command, shown in session(block.text):
            output = printed(command)
            good = agrees(shown, output)
            new += f"$ {command}\n" + (shown if good else written_anew(shown, output))
            if not good:
                wrong.append(f"{page.name}:{block.line}: $ {command}\nprints\n{output}not\n{shown}")
        changes.append((block.start, block.start + len(block.text), new))
    if os.environ.get("RMR_REWRITE"):
        for start, end, new in reversed(changes):
            text = text[:start] + new + text[end:]
        page.write_text(text, "utf-8")
    else:
        assert wrong == []


def test_a_page_that_says_something_else_is_found() -> None:
    assert agrees("a\n...\nb\n", "a\nx\ny\nb\n")
    assert agrees("a\n...\nb\n", "a\nb\n")
    assert not agrees("a\nb\n", "a\nc\n")
    assert not agrees("a\n...\n", "b\n")
    assert session("$ rmr x\nout\n$ rmr y\n") == [("rmr x", "out\n"), ("rmr y", "")]


def test_a_page_that_is_written_anew_leaves_out_what_it_left_out() -> None:
    output = "head\na: 1\nb: 2\nc: 3\nd: 4\nend\n"
    assert written_anew("head\n...\nc: 7\n...\nend\n", output) == "head\n...\nc: 3\n...\nend\n"
    assert written_anew("head\n...\n", output) == "head\n...\n"
    assert written_anew("...\nb: 1\nc: 1\n...\n", output) == "...\nb: 2\nc: 3\n...\n"
    assert written_anew("head\na: 2\n", output) == output
