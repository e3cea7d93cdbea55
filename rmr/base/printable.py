"""Sanitising of untrusted text before it is shown on a terminal.

Escape sequences, control characters and marks of writing direction become ``?``. Texts from the bus, log lines for
people, tables and screens are all sanitised here.
"""


def printable(text: str) -> str:
    """Return `text` with each character that is neither printable nor a line feed replaced by ``?``."""
    if text.isprintable():
        return text
    return "".join([char if char == "\n" or char.isprintable() else "?" for char in text])


def one_line(text: str, characters_max: int) -> str:
    """Return `text` as one printable line of at most `characters_max` characters; what is longer ends with ``...``."""
    if len(text) > characters_max:
        text = text[: characters_max - 3] + "..."
    return printable(text.replace("\n", " "))
