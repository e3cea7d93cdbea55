"""What the compiler says about wrong programs: each file holds a source and, behind a line of dashes, the output.

Run with RMR_REWRITE=1 to write the outputs anew, and review them as a diff.
"""

import os
import re
from pathlib import Path

import pytest

from rmr.lang.compiler import compile_source
from rmr.lang.diagnostic import CODES
from rmr.lang.render import render_text

HERE = Path(__file__).parent
RULER = "----\n"
ELSEWHERE = {"E003", "E004", "E007", "E008", "E009", "W107", "W109"}
"""About whole files, or too large for a page: held by the unit tests."""


def pages():
    return sorted(HERE.glob("*.txt"))


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.stem)
def test_the_output_is_the_one_on_the_page(page):
    source, _, expected = page.read_text(encoding="utf-8").partition(RULER)
    compilation = compile_source(source, page.stem + ".rmr")
    found = render_text(compilation.diagnostics, compilation.sources, color=False)
    if os.environ.get("RMR_REWRITE"):
        page.write_text(source + RULER + found, encoding="utf-8")
    else:
        assert found == expected


def test_every_code_stands_on_a_page():
    shown = {code for page in pages() for code in re.findall(r"\[([EW][0-9]+)\]", page.read_text(encoding="utf-8"))}
    assert shown | ELSEWHERE == set(CODES)
