"""The page of each diagnostic code, for a person who has just met it: what it means, why, and what to do.

A page is the Markdown file named after its code, beside this module, so that it can be read as it is, too. It has a
wrong example, in a block that begins with ```` ```rmr error CODE ```` (or ``warning``), and a right one, behind
```` ```rmr ````. A file name there says what other examples of the page include it as; ``times N`` says that the
block's lines would stand N times in the file.
"""

import re
import textwrap
from pathlib import Path

from rmr.base.printable import Paint

_LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")


def page(code: str) -> str:
    """Return the page of `code`, which is in CODES, as Markdown."""
    return Path(__file__).with_name(f"{code}.md").read_text(encoding="utf-8")


def without_links(text: str) -> str:
    """Return a page with the words of its links alone."""
    return _LINK.sub(r"\1", text)


def plain(text: str) -> str:
    """Return a page as text that needs no Markdown reader: examples are indented, headings are lines."""
    lines: list[str] = []
    inside = False
    for line in without_links(text).splitlines():
        if line.startswith("```"):
            inside = not inside
            name = line.split()[-1:] if inside and line.endswith(".rmr") else []
            lines += [f"{each}:" for each in name]
        elif inside:
            lines.append(f"    {line}".rstrip())
        else:
            lines.append(line.lstrip("# ").upper() if line.startswith("## ") else line.removeprefix("# "))
    return "\n".join(lines) + "\n"


def laid_out(text: str, columns: int, paint: Paint) -> str:
    """Return a page as `plain` does, with paragraphs filled to `columns`; headings are bold and code has a colour."""
    title, *parts = plain(text).rstrip("\n").split("\n\n")
    shown = [paint("bold", _filled(title, columns))]
    for part in parts:
        if part.isupper():
            shown.append(paint("bold", part))
        elif "\n    " in f"\n{part}":
            shown.append(re.sub("^    .*", lambda line: paint("cyan", line[0]), part, flags=re.MULTILINE))
        else:
            items = re.split(r"\n(?=- )", part)
            filled = "\n".join(_filled(item, columns) for item in items)
            shown.append(re.sub("`([^`]+)`", lambda code: paint("cyan", code[1]) if paint.color else code[0], filled))
    return "\n\n".join(shown) + "\n"


def _filled(text: str, columns: int) -> str:
    """Return a paragraph, or an item of a list, filled anew."""
    indent = "  " if text.startswith("- ") else ""
    words = " ".join(text.split())
    return textwrap.fill(words, columns, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
