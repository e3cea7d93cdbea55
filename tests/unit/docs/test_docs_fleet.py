"""docs/fleet.md names every verb, every option and every event of the code, and no others."""

import re

from doc_pages import ROOT

from rmr_deploy.event_log import EVENTS
from rmr_deploy.fleet import VERBS
from rmr_deploy.fleet import command as fleet

PAGE = (ROOT / "docs" / "fleet.md").read_text()


def cells(title: str) -> list[list[str]]:
    """Return the rows of the table whose head begins with `title`."""
    _, _, rest = PAGE.partition(f"| {title} |")
    lines = rest.splitlines()[2:]
    rows = lines[: next((i for i, line in enumerate(lines) if not line.startswith("|")), len(lines))]
    return [[cell.strip() for cell in row.strip("|").split(" | ")] for row in rows]


def test_every_verb_is_documented_and_no_other():
    named = {verb for row in cells("command") for verb in re.findall(r"`rmr (\w+)", row[0])}
    assert named - {"up"} == set(VERBS)


def test_every_option_of_a_verb_is_documented_and_no_other():
    told = {
        (verb, option)
        for options, verbs, _ in cells("option")
        for verb in (set(VERBS) - {"ls", "attach"} if verbs.startswith("all but") else re.findall(r"`(\w+)`", verbs))
        for option in re.findall(r"`(-[-\w]+)", options)
    }
    declared = {
        (verb, option)
        for verb in VERBS
        for option in fleet().commands[verb].load().parser(verb).names
        if option not in ("-h", "--help", "--version")
    }
    assert told == declared


def test_every_event_is_documented_and_no_other():
    assert {row[0].strip("`"): row[1] for row in cells("event")} == EVENTS
