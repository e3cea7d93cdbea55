"""Checks of the files that are named on a command line: one that cannot be read is wrong usage, in every command.

The content of a file has another exit code: that of an invalid program, byte-code or lab file. A file that another
file names counts as part of that one.
"""

from collections.abc import Iterable
from pathlib import Path


def unreadable(paths: Iterable[Path | None]) -> list[str]:
    """Return an error line for each of `paths` that is not a readable file; None stands for an option not given."""
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
