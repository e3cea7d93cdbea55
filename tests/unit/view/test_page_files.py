"""The files of the page: vendored libraries unchanged, nothing inline, nothing from elsewhere, modules with a head."""

import hashlib
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
