"""The labs that come with RMR, and their names on the command line: `rmr up corridor` works in every folder.

In a clone they are the folder ``deploy/labs``; a wheel has a copy inside this package. An existing path has precedence
over a provided lab of the same name. Nothing heavy is imported, for the options of the commands are read with this.
"""

import os
from pathlib import Path

LAB_FILE = "lab.yaml"
_PACKAGED = Path(__file__).with_name("labs")
_IN_TREE = Path(__file__).parents[2] / "deploy" / "labs"


def labs_folder() -> Path:
    """Return the folder of the provided labs."""
    return _IN_TREE if (_IN_TREE.parents[1] / "pyproject.toml").is_file() else _PACKAGED


def provided_labs() -> dict[str, Path]:
    """Return the folders of the provided labs by name, in alphabetic order."""
    return {file.parent.name: file.parent for file in sorted(labs_folder().glob(f"*/{LAB_FILE}"))}


def resolve(path: Path) -> Path:
    """Return `path`, or the folder of the provided lab that it names if there is no such path."""
    if path.exists() or path.name != str(path) or os.fspath(path) in {"", "."}:
        return path
    return provided_labs().get(path.name, path)


def existing_lab(text: str) -> Path:
    """Return the path `text` if it exists or is the name of a provided lab; raise ValueError, which says what is."""
    path = Path(text)
    if not resolve(path).exists():
        raise ValueError(missing(path))
    return path


def missing(path: Path) -> str:
    """Return the message for a lab that is neither a path nor a provided lab."""
    from difflib import get_close_matches  # noqa: PLC0415 - few names are misspelt

    names = list(provided_labs())
    near = get_close_matches(path.name, names, n=1)
    hint = f"did you mean '{near[0]}'?" if near else f"provided labs are {', '.join(names)}"
    return f"there is no {path}; {hint}"
