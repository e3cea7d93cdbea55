"""The tables of docs/motion.md are those of the code; with RMR_REWRITE=1 they are written anew."""

import os

import pytest
from doc_pages import ROOT

from rmr.node.motion.speed_law import HAZARDS
from rmr.node.motion.standoff.escapes import ESCAPES

PAGE = ROOT / "docs" / "motion.md"
TABLES = {
    "hazards": [
        "| rule | stage | hazard | what is done |",
        "|---|---|---|---|",
        *(f"| `{r.name}` | {r.stage.value} | {r.hazard} | {r.rule} |" for r in HAZARDS),
    ],
    "escapes": [
        "| escape | situation | way out |",
        "|---|---|---|",
        *(f"| `{e.name}` | {e.situation} | {e.way_out} |" for e in ESCAPES),
    ],
}


@pytest.mark.parametrize("name", TABLES)
def test_the_tables_of_motion_are_generated_from_the_code(name: str) -> None:
    begin, end = f"<!-- {name}: begin -->\n", f"\n<!-- {name}: end -->"
    text = PAGE.read_text("utf-8")
    before, rest = text.split(begin)
    _, after = f"\n{rest}".split(end)
    fresh = before + begin + "\n".join(TABLES[name]) + end + after
    if os.environ.get("RMR_REWRITE"):
        PAGE.write_text(fresh, "utf-8")
    assert PAGE.read_text("utf-8") == fresh


def test_each_rule_stands_in_the_module_that_it_names() -> None:
    node = ROOT / "rmr" / "node"
    assert [r.where for r in HAZARDS if not list(node.rglob(r.where))] == []
