"""The page of each diagnostic code, for a person who has just met it: what it means, why, and what to do.

A page is the Markdown file named after its code, beside this module, so that it can be read as it is, too. It has a
wrong example, in a block that begins with ```` ```rmr error CODE ```` (or ``warning``), and a right one, behind
```` ```rmr ````. A file name there says what other examples of the page include it as; ``times N`` says that the
block's lines would stand N times in the file.
"""

import re
from pathlib import Path

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
