"""The table of rights on the page, and what it says about attackers, against the code."""

import re

import zenoh
from doc_pages import codes, page, section, table

from rmr.bus.rates import RATES
from rmr.bus.rights import RIGHTS, VERBS

PAGE = section(page("keys"), "Rights")


def documented(role, verbs):
    """Yield the rows that the page has of a role: verbs with the same keys share one."""
    shared = {}
    for verb, keys in verbs.items():
        shared.setdefault(keys, []).append(verb)
    for keys, together in shared.items():
        yield role, ", ".join(together), ", ".join(f"`{key.replace('{n}', 'N')}`" for key in keys)


def test_the_table_of_rights_is_that_of_the_routers():
    rows = [row for role, verbs in RIGHTS.items() for row in documented(role, verbs)]
    assert table(PAGE, "role", "may", "keys behind `rmr/LAB/`") == rows


def test_every_verb_is_explained():
    assert [codes(row[0])[0] for row in table(PAGE, "verb", "is")] == list(VERBS)


def test_what_attackers_achieve_follows_from_the_table():
    """Each cell of which `test_rights` tries at a router."""
    rows = table(PAGE, "with the keys of", "tries to", "so it", "which is")
    for who, _, how, outcome in rows:
        verb, key = re.fullmatch(r"(\w+) `(.+)`", how).groups()
        role, _, robot = who.partition(" ")
        allowed = [row.replace("{n}", robot) for row in RIGHTS[role].get(verb, ())]
        carried = any(zenoh.KeyExpr(row).includes(zenoh.KeyExpr(key)) for row in allowed)
        assert outcome == ("carried" if carried else "dropped"), (who, how)
    assert {who.partition(" ")[0] for who, *_ in rows} == {"robot", "viewer", "operator"}


def test_the_rates_on_the_page_are_those_of_the_code():
    rows = table(page("keys"), "messages", "a second", "at once")
    assert all(rate.reason for rate in RATES.values())
    assert rows == [(f"`{kind}`", str(rate.per_s), str(rate.at_once)) for kind, rate in RATES.items()]
