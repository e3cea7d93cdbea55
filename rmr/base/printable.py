"""Texts for people: sanitised, cut, coloured, their width in columns, and numbers with their nouns.

Untrusted text is sanitised before it is shown on a terminal: texts from the bus, log lines for people, tables and
screens. Escape sequences, control characters and marks of writing direction become ``?``. Styles are added
afterwards: sequences of ECMA-48 (SGR), which take no column.
"""

import re
from typing import Final

SGR: Final = {"bold": "1", "red": "31", "green": "32", "yellow": "33", "blue": "34", "cyan": "36"}
"""The words of a style -> their parameters."""


class Paint:
    """Gives texts a style, or none where there is no colour."""

    def __init__(self, color: bool) -> None:
        self.color = color

    def __call__(self, style: str, text: str) -> str:
        """Return `text` in a style such as ``bold red``; an empty style is none."""
        if not self.color or not style:
            return text
        return f"\x1b[{';'.join(SGR[word] for word in style.split())}m{text}\x1b[0m"


def columns_of(text: str) -> int:
    """Return the columns that `text`, a line without styles, takes: two for a wide character, none for a combining one.

    Wide is what has the East Asian Width W or F (Unicode Standard Annex #11).
    """
    if text.isascii():
        return len(text)
    from unicodedata import category, east_asian_width  # noqa: PLC0415 - few texts need its tables

    return sum(0 if category(each) in ("Mn", "Me") else 2 if east_asian_width(each) in "WF" else 1 for each in text)


def cut(text: str, columns_max: int) -> str:
    """Return `text`, a line that may have styles, ending with ``...`` where it would take more columns."""
    parts = re.split("(\x1b\\[[0-9;]*m)", text)
    if sum(map(columns_of, parts[::2])) <= columns_max:
        return text
    room = columns_max - 3
    for place in range(0, len(parts), 2):
        kept = ""
        for char in parts[place]:
            room -= columns_of(char)
            if room < 0:
                break
            kept += char
        parts[place] = kept
    return "".join(parts) + "..."[: max(0, columns_max)]


def printable(text: str) -> str:
    """Return `text` with each character that is neither printable nor a line feed replaced by ``?``."""
    if text.isprintable():
        return text
    return "".join([char if char == "\n" or char.isprintable() else "?" for char in text])


def shortened(text: str, characters_max: int) -> str:
    """Return `text`, ending with ``...`` where it has more than `characters_max` characters."""
    return text if len(text) <= characters_max else text[: characters_max - 3] + "..."


def one_line(text: str, characters_max: int) -> str:
    """Return `text` as one printable line of at most `characters_max` characters (`shortened`)."""
    return printable(shortened(text, characters_max).replace("\n", " "))


def counted(number: object, noun: str) -> str:
    """Return `number` with its noun: ``1 error``, ``2 errors``, ``3 processes``."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}{'es' if noun.endswith('s') else 's'}"
