"""docs/trace.md lists every note that a robot takes, with its fields and its meaning."""

import json

from doc_pages import codes, page, table

from rmr.node.trace import ENTRIES_MAX, EVENTS

PAGE = page("trace")


def test_every_note_is_documented_as_the_code_says():
    documented = {
        codes(what)[0]: (tuple(codes(fields)), means) for what, fields, means in table(PAGE, "what", "fields", "means")
    }
    assert documented == {what: (event.fields, event.meaning) for what, event in EVENTS.items()}
    assert f"newest {ENTRIES_MAX} entries" in " ".join(PAGE.split())


def test_the_example_is_an_entry_of_the_vocabulary():
    entry = json.loads(next(line for line in PAGE.splitlines() if line.startswith("    {")))
    assert tuple(entry) == ("t", "robot", "what", *EVENTS[entry["what"]].fields)
