"""Files that a person names on the command line: one that cannot be read is wrong usage, in every command alike.

What is in a file that can be read is another matter: an invalid program, byte-code or lab file has its own exit code,
and so has a file that another file names.
"""

from collections.abc import Iterable
from pathlib import Path


def unreadable(paths: Iterable[Path | None]) -> list[str]:
    """Return a line for each of `paths` that is no file that can be read; None stands for a file that nobody named."""
    lines = []
    for path in paths:
        try:
            if path is not None:
                path.open("rb").close()
        except OSError as error:
            lines.append(f"{path}: {error.strerror or error}")
        except ValueError:
            lines.append(f"{str(path)!r}: no name of a file")
    return lines
