"""The files of the page: vendored libraries unchanged, nothing inline, nothing from elsewhere, modules with a head."""

import hashlib
import itertools
import math
import re
from pathlib import Path

import pytest

import rmr_view

PAGE = Path(rmr_view.__file__).parent / "page"
VENDOR = PAGE / "vendor"
OWN = sorted(PAGE.glob("*.js"))


def test_vendored_files_have_their_hashes():
    told = dict(reversed(line.split("  ")) for line in (VENDOR / "SHA256SUMS").read_text().splitlines())
    found = {
        file.name: hashlib.sha256(file.read_bytes()).hexdigest()
        for file in VENDOR.iterdir()
        if file.name not in {"SHA256SUMS", "README.md"}
    }
    assert found == told


def lab_of(colour):
    """Return a colour (#rrggbb) in CIELAB under D65 (CIE 15:2004), in which distances are what people see."""
    linear = [
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4
        for c in (int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5))
    ]
    rows = ((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505))
    white = (0.95047, 1.0, 1.08883)
    shares = [sum(a * b for a, b in zip(row, linear, strict=True)) / w for row, w in zip(rows, white, strict=True)]
    x, y, z = (t ** (1 / 3) if t > 0.008856 else 7.787 * t + 16 / 116 for t in shares)
    return 116 * y - 16, 500 * (x - y), 200 * (y - z)


def test_twelve_robots_have_colours_that_differ_from_each_other_from_alarm_and_from_both_floors():
    """Ten times what is just noticed, 2.3 (Mahy et al. 1994)."""
    text = (PAGE / "palette.js").read_text()
    robots = re.findall(r"#[0-9A-Fa-f]{6}", re.search(r"const ROBOTS = \[(.*?)\]", text, re.S)[1])
    assert len(robots) == 12
    others = [*re.findall(r'ALERT = "(#\w+)"', text), *re.findall(r'floor: "(#\w+)"', text)]
    assert len(others) == 3
    pairs = [*itertools.combinations(robots, 2), *itertools.product(robots, others)]
    assert [pair for pair in pairs if math.dist(*map(lab_of, pair)) < 23] == []


def test_every_vendored_library_has_its_licence():
    assert {file.name for file in VENDOR.glob("LICENSE.*")} == {"LICENSE.htm", "LICENSE.preact", "LICENSE.uPlot"}
    for name in ("htm-preact.js", "uPlot.iife.min.js", "uPlot.min.css"):
        assert f"`{name}`" in (VENDOR / "README.md").read_text()


def test_index_has_no_inline_script_or_style():
    index = (PAGE / "index.html").read_text()
    assert not re.search(r"<script(?![^>]*\bsrc=)", index)
    assert "<style" not in index
    assert not re.search(r"\s(style|on\w+)=", index)


@pytest.mark.parametrize("file", [*OWN, PAGE / "style.css", PAGE / "index.html"], ids=lambda file: file.name)
def test_page_names_no_other_host_and_evaluates_no_text(file):
    text = file.read_text()
    assert not re.search(r"(https?|wss?)://(?!www\.w3\.org/)|//[a-z0-9.-]+\.(com|org|net|io)/", text)
    for forbidden in ("eval(", "new Function", "innerHTML", "insertAdjacentHTML", "document.write"):
        assert forbidden not in text
    assert not re.search(r"dangerouslySetInnerHTML|\son\w+=\"", text)


@pytest.mark.parametrize("file", OWN, ids=lambda file: file.name)
def test_module_begins_with_what_it_is_and_imports_what_exists(file):
    text = file.read_text()
    assert text.startswith("// ")
    for name in re.findall(r'from "(\./[^"]+)"', text):
        assert (PAGE / name).is_file(), name


@pytest.mark.parametrize("file", OWN, ids=lambda file: file.name)
def test_every_name_of_an_import_is_exported(file):
    for names, path in re.findall(r'import \{([^}]+)\} from "\./([^"]+)"', file.read_text()):
        if path.startswith("vendor/"):
            continue
        exported = re.findall(r"^export (?:async )?(?:function|class|const|let) (\w+)", (PAGE / path).read_text(), re.M)
        for name in names.split(","):
            assert name.strip() in exported, (path, name)
