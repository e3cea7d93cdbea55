"""The lists of rules of docs/motion.md are those of the code; with RMR_REWRITE=1 they are written anew."""

import os
from textwrap import fill

import pytest
from doc_pages import ROOT

from rmr.node.motion.hazards import HazardStage
from rmr.node.motion.speed_law import HAZARDS
from rmr.node.motion.standoff.escapes import ESCAPES

PAGE = ROOT / "docs" / "motion.md"


def line(text: str) -> str:
    return fill(f"- {text}", 120, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


RULES = {
    "hazards": "\n\n".join(
        f"*{stage.value}*:\n\n"
        + "\n".join(line(f"`{r.name}` ({r.hazard}): {r.rule}") for r in HAZARDS if r.stage is stage)
        for stage in HazardStage
    ),
    "escapes": "\n".join(line(f"`{e.name}`: {e.situation} -> {e.way_out}") for e in ESCAPES),
}


@pytest.mark.parametrize("name", RULES)
def test_the_rules_of_motion_are_generated_from_the_code(name: str) -> None:
    begin, end = f"<!-- {name}: begin -->\n", f"\n<!-- {name}: end -->"
    text = PAGE.read_text("utf-8")
    before, rest = text.split(begin)
    _, after = f"\n{rest}".split(end)
    fresh = before + begin + RULES[name] + end + after
    if os.environ.get("RMR_REWRITE"):
        PAGE.write_text(fresh, "utf-8")
    assert PAGE.read_text("utf-8") == fresh


def test_each_rule_stands_in_the_module_that_it_names() -> None:
    node = ROOT / "rmr" / "node"
    assert [r.where for r in HAZARDS if not list(node.rglob(r.where))] == []
