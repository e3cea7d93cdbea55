"""docs/radio-validation.md shows what validation.json says, and nothing else."""

import json
import re
from importlib import import_module
from types import ModuleType

import pytest
from doc_pages import ROOT, page

FOLDER = ROOT / "docs" / "radio"
PAGE = page("radio-validation")
DATA = json.loads((FOLDER / "validation.json").read_text("utf-8"))


@pytest.fixture
def report(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module that writes the page."""
    monkeypatch.syspath_prepend(ROOT / "tests" / "validation")
    return import_module("report")


def test_every_table_is_that_of_the_data(report: ModuleType) -> None:
    assert report.renewed_page(PAGE, DATA) == PAGE


def test_what_is_missed_and_what_is_not_noticed_stand_on_the_page(report: ModuleType) -> None:
    checks = [dict(check) for check in DATA["checks"]]
    found = next(check for check in checks if check["file"] == "contention" and check["verdict"] == "met")
    found["verdict"] = "missed"
    rules = [{"rule": "acks are late", "noticed": {}, "checks": 0}, *DATA["mutations"]]
    text = report.renewed_page(PAGE, {**DATA, "checks": checks, "mutations": rules})
    assert "No check is missed." not in text
    assert f"| {found['row']} | `{found['quantity']}` |" in text
    assert "Not noticed: acks are late." in text


def test_every_figure_is_shown_and_is_lean(report: ModuleType) -> None:
    assert sorted(re.findall(r"\(radio/(\w+)\.svg\)", PAGE)) == sorted(report.figures.FIGURES)
    assert max((FOLDER / f"{name}.svg").stat().st_size for name in report.figures.FIGURES) < 300_000


def test_every_file_of_the_reference_is_judged() -> None:
    judged = {check["file"] for check in DATA["checks"] if check["verdict"] != "shown"}
    files = {file.stem for file in (ROOT / "tests" / "validation" / "reference").glob("*.json")}
    assert judged == files | {"capture_3db"}


def test_a_verdict_is_what_difference_and_tolerance_say() -> None:
    numbers = [check for check in DATA["checks"] if check["tolerance"] and "difference" in check]
    assert len(numbers) > 500
    for check in numbers:
        assert (check["verdict"] == "met") == (abs(check["difference"]) <= check["tolerance"] * (1 + 1e-5)), check


def test_every_rule_that_was_broken_was_noticed() -> None:
    assert len(DATA["mutations"]) >= 40
    assert [row["rule"] for row in DATA["mutations"] if not row["noticed"]] == []


def test_all_members_answer_within_the_round() -> None:
    assert "All members, of up to 50, answer" in PAGE
    assert max(row["members"] for row in DATA["discovery"]) == 50
    assert {row["worst"] for row in DATA["discovery"]} == {1}


def test_quantities_that_are_not_judged_have_their_reason_in_the_data() -> None:
    reasons = [check.get("unjudged") for check in DATA["checks"] if check["verdict"] == "shown"]
    assert all(reasons)
    assert sum(why == "no tolerance is stated" or "capacity" in why for why in reasons) > len(reasons) / 2
