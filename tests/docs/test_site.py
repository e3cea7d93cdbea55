"""The site of the pages: its order, what is copied for it, and what it refuses. `make site` builds all of it, in CI."""

import runpy
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SITE = runpy.run_path(str(ROOT / "deploy" / "release" / "documentation.py"))
SETTINGS = tomllib.loads((ROOT / "zensical.toml").read_text())["project"]


def leaves(entry):
    """Return the pages of an entry of the navigation, in their order."""
    if isinstance(entry, str):
        return [entry]
    parts = entry.values() if isinstance(entry, dict) else entry
    return [page for part in parts for page in leaves(part)]


def test_a_path_of_six_pages_comes_first_and_reference_behind_it():
    nav = SETTINGS["nav"]
    assert [len(leaves(each)) for each in nav[:6]] == [1] * 6
    assert [name for each in nav[6:] for name in each] == ["Reference", "Validation", "Decisions"]


def test_every_page_has_its_place_and_only_one():
    placed = leaves(SETTINGS["nav"])
    assert len(placed) == len(set(placed))
    pages = {page.relative_to(ROOT).as_posix() for page in SITE["pages"]()}
    linked = {page for page in pages if page.startswith(("docs/decisions/0", "rmr/lang/pages/"))}
    assert set(placed) == pages - linked | {"help.md"}


def test_the_page_of_commands_has_each_with_its_options():
    page = SITE["help_page"]()
    for heading in ("rmr sim", "rmr lab list", "rmr fault radio", "rmrc", "rmr-agent", "rmr-world"):
        assert f"\n## {heading}\n\n```text\nusage: {heading} " in page
    assert "  --hard-chaos " in page


def test_the_copy_has_each_page_and_what_it_links_to(tmp_path):
    count = SITE["staged"](tmp_path / "tree")
    copied = {
        each.relative_to(tmp_path / "tree").as_posix() for each in (tmp_path / "tree").rglob("*") if each.is_file()
    }
    assert len(copied) == count
    assert {"README.md", "LICENSE", "docs/pictures/parts.svg", "rmr/lang/pages/E012.md"} <= copied
    assert "tests/conformance/README.md" in copied
    assert "docs/decisions/0001-integer-nanoseconds.md" in copied
    assert "pyproject.toml" not in copied


def test_a_link_out_of_the_tree_is_refused_with_its_target(tmp_path, monkeypatch):
    page = ROOT / "README.md"
    monkeypatch.setitem(SITE["staged"].__globals__, "targets", lambda file, text: [ROOT / "docs" / "none.svg"])
    monkeypatch.setitem(SITE["staged"].__globals__, "pages", lambda: [page])
    with pytest.raises(SITE["SiteError"], match=r"docs/none\.svg, which is not a file of the tree"):
        SITE["staged"](tmp_path / "tree")


def test_a_browser_gets_folders_without_a_link_and_blocks_with_a_title():
    text = "[all](../tests/) [one](../LICENSE)\n\n```rmr a.rmr\n[x](../tests/)\n```\n```rmr error E020\n```\n"
    shown = SITE["for_a_browser"](ROOT / "docs" / "page.md", text)
    assert shown == (
        'all [one](../LICENSE)\n\n```rmr title="a.rmr"\n[x](../tests/)\n```\n```rmr title="error E020"\n```\n'
    )


@pytest.mark.parametrize(
    "loaded",
    [
        '<script async src="https://cdn.example.org/x.js"></script>',
        '<link rel="stylesheet" href="//fonts.example.org/a.css">',
        "<link href=https://fonts.example.org rel=preconnect>",
        '<img alt="" src="http://pictures.example.org/a.png">',
        "<style>@font-face { src: url(https://fonts.example.org/a.woff2) }</style>",
    ],
)
def test_what_a_page_loads_from_another_host_is_found(tmp_path, loaded):
    (tmp_path / "page.html").write_text(f"<p>{loaded}</p>")
    assert len(SITE["elsewhere"](tmp_path)) == 1


def test_links_for_the_reader_and_files_of_the_site_are_none_of_these(tmp_path):
    page = '<a href="https://example.org">x</a> <script src="../a.js"></script> <link rel="stylesheet" href="b.css">'
    (tmp_path / "page.html").write_text(page)
    assert SITE["elsewhere"](tmp_path) == []


def test_each_page_tells_the_browser_to_load_nothing_from_another_host():
    template = (ROOT / "deploy" / "release" / "site" / "main.html").read_text()
    assert "Content-Security-Policy" in template
    assert "default-src 'self'" in template
    assert "http" not in template.partition("content=")[2]
    assert SETTINGS["theme"]["font"] is False


def test_without_the_generator_the_words_say_what_to_do(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(SITE["sysconfig"], "get_path", lambda name: str(tmp_path))
    assert SITE["main"]([str(tmp_path / "site")]) == 1
    assert "zensical is not installed: make site installs it" in capsys.readouterr().err
    assert SITE["main"](["--help"]) == 2
