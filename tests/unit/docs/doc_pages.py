"""The documentation as data: tables and code blocks of a page, so that tests can hold them to the code."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[3]
Row = tuple[str, ...]


def page(name: str) -> str:
    """Return the text of `docs/NAME.md`."""
    return (ROOT / "docs" / f"{name}.md").read_text()


def table(text: str, *header: str) -> list[Row]:
    """Return the rows of all tables under `header`, cell by cell, code quotes left in place."""
    lines = text.splitlines()
    wanted = [i for i, line in enumerate(lines) if line.startswith("|") and _cells(line) == header]
    assert wanted, f"no table with the header {header}"
    found = []
    for begin in wanted:
        for line in lines[begin + 2 :]:
            if not line.startswith("|"):
                break
            row = _cells(line)
            assert len(row) == len(header), line
            found.append(row)
    return found


def _cells(line: str) -> Row:
    return tuple(cell.strip() for cell in line.strip().strip("|").split("|"))


def listed(text: str) -> list[tuple[list[str], str]]:
    """Return (names, meaning) of each line of a list that begins with names in code quotes: "- `a`, `b`: meaning"."""
    items = re.findall(r"^- (`.+)$", re.sub(r"\n  +", " ", text), re.MULTILINE)
    rows = [re.match(r"((?:`[^`]+`(?:, )?)+): (.+)", item) for item in items]
    return [(codes(row[1]), row[2]) for row in rows if row]


def codes(cell: str) -> list[str]:
    """Return what stands between code quotes in a cell."""
    return re.findall(r"`([^`]+)`", cell)


def section(text: str, title: str) -> str:
    """Return what stands under the heading `title`, up to the next heading of its level or a higher one."""
    match = re.search(rf"^(#+) {re.escape(title)}$", text, re.MULTILINE)
    assert match, f"no section {title}"
    level = len(match[1])
    end = re.compile(rf"^#{{1,{level}}} ", re.MULTILINE).search(text, match.end())
    return text[match.end() : end.start() if end else None]


def blocks(text: str, language: str) -> list[str]:
    """Return the fenced code blocks of `language`."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
