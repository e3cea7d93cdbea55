"""What the compiler would write in place of a mistake, tried: the mistake is gone, and no syntax error is new."""

from collections import Counter
from pathlib import Path

import pytest

from rmr.lang.compiler import compile_source

HERE = Path(__file__).parent
PAGES = sorted([*HERE.glob("*.txt"), *(HERE / "mistakes").glob("*.txt")])
REPEATED = "# "
"""A page that begins so repeats its source, which says nothing more here."""


def source_of(page):
    return page.read_text(encoding="utf-8").partition("----\n")[0]


def told(text):
    return Counter((each.code, each.message) for each in compile_source(text, "a.rmr").diagnostics)


def fixes():
    """Yield (page, diagnostic, text with its fix)."""
    for page in PAGES:
        text = source_of(page)
        for each in compile_source(text, "a.rmr").diagnostics if not text.startswith(REPEATED) else ():
            if each.fix is not None:
                start, end = each.fix.span.start, each.fix.span.end
                yield page, each, text[:start] + each.fix.text + text[end:]


def test_each_fix_mends_what_it_belongs_to():
    tried = list(fixes())
    before = {page: told(source_of(page)) for page in PAGES}
    worse = []
    for page, each, fixed in tried:
        now = told(fixed)
        key = (each.code, each.message)
        syntax = [sum(count for (code, _), count in found.items() if code == "E001") for found in (before[page], now)]
        if now[key] >= before[page][key] or syntax[1] > syntax[0]:
            worse.append((page.stem, each.code, each.message, each.hint, each.fix))
    assert worse == []
    assert len(tried) >= 40
    assert {each.code for _, each, _ in tried} >= {
        "E001",
        "E012",
        "E013",
        "E015",
        "E030",
        "W101",
        "W108",
        "W111",
        "W112",
    }


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("p(R).\np(R) -> q(R).\n", "p(R).\np(R) -o q(R).\n"),
        ("p(R).\np(R), X == 1 -o 1.\n", "p(R).\np(R), X = 1 -o 1.\n"),
        ("p(R).\np(R) q(R) -o 1.\n", "p(R).\np(R), q(R) -o 1.\n"),
        ("p(R)\np(R) -o 1.\n", "p(R).\np(R) -o 1.\n"),
        ("p(R).  # a note\n", "p(R).  // a note\n"),
        ("p(R).\np(R), -o 1.\n", "p(R).\np(R) -o 1.\n"),
        ("const a = 5 sec.\n", "const a = 5s.\n"),
        (
            "// shop\n\nw: assert(p(R), p(R), 5, stop(R)).\np(R).\np(R) -o stop(R).\n",
            "// shop\n\ntype action stop(robot).\nw: assert(p(R), p(R), 5, stop(R)).\np(R).\np(R) -o stop(R).\n",
        ),
        ("type p(robot).\np(R).\n$p(R) -o 1.\n!p(R) -o 1.\n", "type p(robot).\np(R).\n$p(R) -o 1.\np(R) -o 1.\n"),
        ("at2(R, s).\nat2(R, L), L = S -o 1.\n", "at2(R, s).\nat2(R, L), L = s -o 1.\n"),
        ("p(R).\np(R), X = sqr(2) -o q(R, X).\n", "p(R).\np(R), X = sqrt(2) -o q(R, X).\n"),
    ],
)
def test_a_fix_writes_what_is_meant(wrong, right):
    found = [each.fix for each in compile_source(wrong).diagnostics if each.fix is not None]
    fixed = [wrong[: fix.span.start] + fix.text + wrong[fix.span.end :] for fix in found]
    assert right in fixed, found
