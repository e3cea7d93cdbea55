"""The decision records are numbered without a gap, of one form, and all in the index."""

import re
from pathlib import Path

import pytest

DECISIONS = Path(__file__).parents[2] / "docs" / "decisions"
RECORDS = sorted(DECISIONS.glob("[0-9]*.md"))
INDEX = (DECISIONS / "README.md").read_text("utf-8")


def test_decision_records_are_numbered_without_a_gap():
    assert [int(path.name[:4]) for path in RECORDS] == list(range(1, len(RECORDS) + 1))
    assert len(RECORDS) >= 12


@pytest.mark.parametrize("path", RECORDS, ids=lambda path: path.stem)
def test_a_decision_record_has_context_decision_and_consequences_and_stands_in_the_index(path):
    text = path.read_text("utf-8")
    number, title = re.match(r"# (\d+)\. (.+)\n", text).groups()
    assert int(number) == int(path.name[:4])
    assert re.findall(r"^## (.+)$", text, flags=re.MULTILINE) == ["Context", "Decision", "Consequences"]
    assert f"| [{number}]({path.name}) | {title} |" in INDEX
