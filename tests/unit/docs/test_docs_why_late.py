"""The table of owners in docs/why-late.md is that of the code."""

from pathlib import Path

from rmr.why.delay import MEANINGS, TimeOwner

PAGE = (Path(__file__).parents[3] / "docs" / "why-late.md").read_text("utf-8")


def test_table_of_owners_is_the_one_of_the_code():
    rows = [line.strip("| ").split(" | ") for line in PAGE.partition("## Owners")[2].splitlines() if "`" in line[:4]]
    assert rows == [[f"`{owner.value}`", meaning] for owner, meaning in MEANINGS.items()]


def test_every_owner_has_a_meaning():
    assert list(MEANINGS) == list(TimeOwner)
