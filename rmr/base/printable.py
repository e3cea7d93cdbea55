"""Texts for people: sanitised, cut, and numbers with their nouns.

Untrusted text is sanitised before it is shown on a terminal: texts from the bus, log lines for people, tables and
screens. Escape sequences, control characters and marks of writing direction become ``?``.
"""


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
