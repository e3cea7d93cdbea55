"""The source of a program, as the page shows it."""

from pathlib import Path

OCTETS_MAX = 1 << 20
"""Octets of a source that are shown at most."""


def program_of(path: Path) -> dict[str, str | None]:
    """Return name and source of the program in `path`; the source is None for byte-code, or if it cannot be read."""
    source = None
    if path.suffix != ".rbc":
        try:
            with path.open("rb") as file:
                source = file.read(OCTETS_MAX).decode(errors="replace")
        except OSError:
            source = None
    return {"name": path.name, "source": source}
