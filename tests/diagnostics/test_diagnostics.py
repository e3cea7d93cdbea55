"""What the compiler says about wrong programs: each file holds a source and, behind a line of dashes, the output.

Run with RMR_REWRITE=1 to write the outputs anew, and review them as a diff.
"""

import os
import re
from pathlib import Path

import pytest

from rmr.lang.compiler import compile_source
from rmr.lang.diagnostics.diagnostic import CODES
from rmr.lang.diagnostics.render import render_text

HERE = Path(__file__).parent
RULER = "----\n"
REPEATED = re.compile(r"# (\d+) times, the last (\d+) shown\n")
"""On a page's first line: the source is so many times what the page holds, and so many lines of output are on it."""


def pages():
    return sorted(HERE.glob("*.txt"))


def output(page, source):
    """Return what the compiler says about the source on a page."""
    repeated = REPEATED.match(source)
    text = source if repeated is None else source[repeated.end() :] * int(repeated[1])
    compilation = compile_source(text, page.stem + ".rmr")
    found = render_text(compilation.diagnostics, compilation.sources, color=False)
    return found if repeated is None else "".join(found.splitlines(keepends=True)[-int(repeated[2]) :])


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.stem)
def test_the_output_is_the_one_on_the_page(page):
    source, _, expected = page.read_text(encoding="utf-8").partition(RULER)
    found = output(page, source)
    if os.environ.get("RMR_REWRITE"):
        page.write_text(source + RULER + found, encoding="utf-8")
    else:
        assert found == expected


@pytest.mark.parametrize("code", CODES)
def test_every_code_stands_on_a_page(code):
    shown = [page.stem for page in pages() if f"[{code}]" in page.read_text(encoding="utf-8").partition(RULER)[2]]
    assert shown
