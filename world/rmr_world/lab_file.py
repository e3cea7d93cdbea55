"""A lab file, its folder or the name of a provided lab, loaded as a `Lab`.

`load_lab` reports every error of a file at once, each with line and column. It runs the first two phases of
`rmr_world.validate`; the others need the lab's program.

The key of its radio is read by the programs that start all of its robots, the launcher and the simulator. The world
server does not read it: it publishes the security level only, for the bus is clear text.
"""

from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path

from rmr.entry.command_line import remedy
from rmr.radio.key_file import KeyFileError, read_key
from rmr.radio.security import UNSECURED
from rmr_world.document import Plain, read
from rmr_world.finding import FilePath, Finding, LabError
from rmr_world.lab import PROGRAM_SUFFIXES, Lab
from rmr_world.provided_labs import LAB_FILE, resolve
from rmr_world.validate.pipeline import lab_of


def lab_path(path: Path) -> Path:
    """Return the lab file that `path` means: a lab file, its folder, or the name of a provided lab."""
    path = resolve(path)
    return path / LAB_FILE if path.is_dir() else path


def load_lab(path: Path, more: Mapping[str, Sequence[object]] | None = None) -> Lab:
    """Return the lab in `path`: a lab file, a folder with a ``lab.yaml``, or the name of a provided lab.

    `more` has items that are added to lists of the file, such as ``facts``, in the form that they have there.

    Raises LabError with all errors of the file.
    """
    file = lab_path(path)
    if file.suffix in PROGRAM_SUFFIXES:
        message = "is a program: name the lab file that it stands in, or its folder"
        raise LabError([Finding(str(file), 1, 1, "", message)])
    document = read(file)
    for key, items in (more or {}).items():
        if items and isinstance(document.value, dict) and isinstance(given := document.value.get(key) or [], list):
            document.value[key] = [*given, *map(_plain, items)]
    return lab_of(document, file)


def _plain(item: object) -> Plain:
    """Return an item as the reader of the file would have it."""
    if isinstance(item, Mapping):
        return {str(key): _plain(value) for key, value in item.items()}
    if isinstance(item, list | tuple):
        return [_plain(value) for value in item]
    return item if isinstance(item, str | int | float | bool) or item is None else str(item)


def files_of(lab: Lab) -> Iterator[tuple[FilePath, Path]]:
    """Yield the files that a run of `lab` reads beside its lab file, each with the place that names it there.

    The image of a map file of ROS is named by that file: its place is (). What a program includes is left out.
    Raises MapError for a map file that has been changed and cannot be read any more.
    """
    for place, file in (
        (("program",), lab.program),
        (("actions",), lab.actions),
        (("events",), lab.events),
        (("radio", "key_file"), lab.key_file),
        *((("loads", index, "program"), load.program) for index, load in enumerate(lab.loads)),
        (("map",), lab.map_file),
    ):
        if file is not None:
            yield place, file
    if lab.map_file is not None:
        from rmr_world.floor_map import image_of  # noqa: PLC0415 - see LabDraft._map_boxes

        if (image := image_of(lab.map_file)) is not None:
            yield (), image


def radio_key(lab: Lab) -> bytes | None:
    """Return the key that secures the lab's radio; None if the radio is open.

    Raises LabError when the lab names no key file, or one that holds no key, and where no library can use it.
    """
    if lab.radio.security == UNSECURED:
        return None
    if lab.key_file is None:
        raise _wrong(lab, "security", f"{lab.radio.security} needs a key: name its file in radio.key_file")
    try:
        import_module("cryptography")
    except ModuleNotFoundError as error:
        raise _wrong(lab, "security", f"{lab.radio.security} needs a library: {remedy(error)}") from None
    try:
        return read_key(lab.key_file)
    except KeyFileError as error:
        raise _wrong(lab, "key_file", str(error)) from None


def _wrong(lab: Lab, part: str, message: str) -> LabError:
    return LabError([lab.error(("radio", part), message)])
