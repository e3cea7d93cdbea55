"""The pages as a site in build/site: search, a path for newcomers, the reference behind it.

The pages are written for the tree, with links between its files. So the site is a mirror of the tree: `staged` copies
each page and what it links to, and every link leads where it leads in the tree. Only what a browser cannot follow
differs: a folder is named and not linked, and a fenced block with a file name has that as its title. The generator
builds in strict mode, in which a link or an anchor that leads nowhere is an error. A policy in each page (`main.html`)
keeps a browser from loading anything from another host, and `elsewhere` looks for what would. Options of
commands have a page that no file has, `help.md`: the commands say them (`--help`), and no page of the tree does again.

    python deploy/release/documentation.py [FOLDER]
"""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from pathlib import Path

from rmr.commands.man_command import helps

ROOT = Path(__file__).parents[2]
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
"""A link or a picture: whether it is a picture, its words, where it leads."""
FENCE = re.compile(r"^```(\w+) +(\S.*)$", re.MULTILINE)
COLOUR = re.compile(r"\x1b\[[\d;]*m")
LOADED = re.compile(
    r"<(?:script|img|iframe|source|video|audio)\b[^>]*?\ssrc=[\"']?((?:https?:)?//[^\"'\s>]+)"
    r"|<link\b(?=[^>]*?\srel=[\"']?(?:stylesheet|preload|preconnect|icon|modulepreload))[^>]*?\shref=[\"']?((?:https?:)?//[^\"'\s>]+)"
    r"|(?:@import\s+|url\()[\"']?((?:https?:)?//[^\"'\s)]+)",
    re.IGNORECASE,
)
"""What a browser loads by itself, in a page or a style sheet, with a host in its address."""


class SiteError(Exception):
    """The site cannot be built: what is wrong, and what to do."""


def pages() -> list[Path]:
    """Return the pages that the site has whether or not another links to them."""
    diagnostics, keys = (ROOT / "rmr" / "lang" / "pages").glob("*.md"), (ROOT / "world" / "rmr_world").glob("*.md")
    found = [ROOT.glob("*.md"), (ROOT / "docs").rglob("*.md"), diagnostics, keys]
    return sorted(page for each in found for page in each)


def targets(page: Path, text: str) -> Iterator[Path]:
    """Yield the files of the tree that a page links to."""
    for _, _, link in LINK.findall(prose(text)):
        path = link.partition("#")[0]
        if path and "://" not in link and not link.startswith("mailto:"):
            yield Path(os.path.normpath(page.parent / path))


def prose(text: str) -> str:
    """Return a page without its fenced blocks."""
    return re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)


def for_a_browser(page: Path, text: str) -> str:
    """Return the text of a page as the site has it."""

    def unlinked(link: re.Match[str]) -> str:
        path = link[3].partition("#")[0]
        folder = path and "://" not in path and (page.parent / path).is_dir()
        return link[2] if folder else link[0]

    parts = re.split(r"(^```.*?^```$)", text, flags=re.DOTALL | re.MULTILINE)
    for index, part in enumerate(parts):
        # Words behind the language are the name of a file, or say what is wrong with a program on purpose.
        parts[index] = FENCE.sub(r'```\1 title="\2"', part) if index % 2 else LINK.sub(unlinked, part)
    return "".join(parts)


def staged(folder: Path) -> int:
    """Copy the pages, and what they link to, to `folder` and return how many files there are. Raises SiteError."""
    shutil.rmtree(folder, ignore_errors=True)
    todo, seen = pages(), set[Path]()
    while todo:
        file = todo.pop()
        if file in seen or file.is_dir():
            continue
        seen.add(file)
        if not file.is_file() or not file.is_relative_to(ROOT):
            raise SiteError(f"a page links to {file}, which is not a file of the tree")
        copy = folder / file.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        if file.suffix == ".md":
            text = file.read_text("utf-8")
            todo += targets(file, text)
            copy.write_text(for_a_browser(file, text), "utf-8")
        else:
            shutil.copyfile(file, copy)
    return len(seen)


def help_page() -> str:
    """Return a page of what every command says of itself with `--help`."""
    parts = [f"## {name}\n\n```text\n{text}\n```\n" for name, text in helps()]
    return "\n".join(["# Every command\n", "What `--help` says, and the manual pages of `rmr man`.\n", *parts])


def elsewhere(site: Path) -> list[str]:
    """Return what the pages of a site would load from another host, as `file: address`."""
    files: Iterable[Path] = sorted(file for file in site.rglob("*") if file.suffix in {".html", ".css"})
    return [
        f"{file.relative_to(site)}: {next(filter(None, found))}"
        for file in files
        for found in LOADED.findall(file.read_text("utf-8"))
    ]


def built(folder: Path) -> str:
    """Build the site into `folder` and return what there is to say. Raises SiteError."""
    generator = Path(sysconfig.get_path("scripts")) / "zensical"
    if not generator.exists():
        raise SiteError("zensical is not installed: make site installs it, from requirements-site.lock")
    work = folder.parent / "pages"
    files = staged(work / "tree")
    (work / "tree" / "help.md").write_text(help_page(), "utf-8")
    settings = (ROOT / "zensical.toml").read_text("utf-8")
    # Its folders are relative to the file, and within its folder.
    shutil.copytree(Path(__file__).with_name("site"), work / "theme", dirs_exist_ok=True)
    paths = 'docs_dir = "tree"\nsite_dir = "site"\n'
    (work / "zensical.toml").write_text(settings.replace("[project]\n", f"[project]\n{paths}", 1), "utf-8")
    done = subprocess.run(
        [str(generator), "build", "--strict", "--clean"], cwd=work, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SiteError("the generator says\n" + COLOUR.sub("", done.stdout + done.stderr).partition("Traceback")[0])
    shutil.rmtree(folder, ignore_errors=True)
    shutil.move(work / "site", folder)
    if found := elsewhere(folder):
        raise SiteError("loaded from another host, which no page may:\n  " + "\n  ".join(found))
    return f"{len(list(folder.rglob('*.html')))} pages of {files} files in {folder}"


def main(words: list[str]) -> int:
    """Build the site into the folder in `words`, or build/site; return the exit code."""
    if len(words) > 1 or (words and words[0].startswith("-")):
        print("usage: python deploy/release/documentation.py [FOLDER]", file=sys.stderr)
        return 2
    try:
        print(built(Path(words[0]).resolve() if words else ROOT / "build" / "site"))
    except SiteError as error:
        print(f"site: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
