"""The table of owners in docs/why-late.md has those of the code."""

from pathlib import Path

from rmr.why.delay import TimeOwner

PAGE = (Path(__file__).parents[3] / "docs" / "why-late.md").read_text("utf-8")


def test_table_of_owners_has_those_of_the_code_and_a_meaning_of_each():
    rows = [line.strip("| ").split(" | ") for line in PAGE.partition("## Owners")[2].splitlines() if "`" in line[:4]]
    assert [name for name, meaning in rows if meaning] == [f"`{owner.value}`" for owner in TimeOwner]
