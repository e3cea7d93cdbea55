"""What a recording says of its run: the metadata record `rmr` of each file."""

import os
import platform
import sys
import zlib
from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Final

from rmr import __version__
from rmr.base import time
from rmr.base.ids import listed, spelled
from rmr.base.record import record

FORMAT: Final = "1"
"""Version of the channels and their messages. A reader refuses another one."""
METADATA_NAME: Final = "rmr"
LAUNCHER_PROCESS: Final = "launcher"
"""The process that starts the others of a run, and the name of its file beside theirs."""


CHECKSUM: Final = "checksum"
"""Key of the checksum of the other values. The record stands at both ends of a file, as a damaged one leaves nothing to
read the rest by."""


def checked(values: Mapping[str, str]) -> dict[str, str]:
    """Return `values` with their checksum."""
    return {**values, CHECKSUM: f"{zlib.crc32(repr(sorted(values.items())).encode()):08x}"}


def is_intact(values: Mapping[str, str]) -> bool:
    """Return whether the checksum of `values` is right."""
    return checked({key: value for key, value in values.items() if key != CHECKSUM}) == values


class AboutError(ValueError):
    """The metadata is none of a recording of this version; the message says why."""


@record
class RunAbout:
    """Lab, seed and robots of a run, and the software that recorded it."""

    lab: str
    mode: str
    """``processes`` or ``simulated``, as in the report."""
    seed: int
    roster: tuple[int, ...]
    process: str
    """What wrote the file: ``sim``, ``world``, ``robots-4``, ``launcher``; ``joined`` of several files joined."""
    run: str = ""
    """Tells the runs of one lab apart: the number of the world's session. Empty for a simulated run, and where it is
    not known."""
    format: str = FORMAT
    rmr: str = __version__
    python: str = ""
    platform: str = ""
    """Operating system and C library: floats of another one may differ."""
    machine: str = ""
    compiled: bool = False
    """Whether the compiled modules were used."""

    def to_metadata(self) -> dict[str, str]:
        """Return the fields as strings."""
        values = asdict(self) | {"roster": spelled(self.roster), "compiled": "true" if self.compiled else "false"}
        return {name: str(value) for name, value in values.items()}

    @classmethod
    def from_metadata(cls, values: Mapping[str, str]) -> "RunAbout":
        """Return the fields from strings. Raises AboutError."""
        if values.get("format") != FORMAT:
            raise AboutError(
                f"it is a recording of format {values.get('format', 'unknown')!r:.20}; this version of rmr reads "
                f"format {FORMAT}"
            )
        if missing := [field.name for field in fields(cls) if field.name not in values]:
            raise AboutError(f"its metadata lacks {', '.join(missing)}")
        known = {field.name: values[field.name] for field in fields(cls)}
        try:
            seed = int(values["seed"])
            roster = listed(values["roster"]) if values["roster"] else ()
        except ValueError as error:
            raise AboutError(f"its metadata is damaged: {error}") from None
        return cls(**known | {"seed": seed, "roster": roster, "compiled": values["compiled"] == "true"})  # type: ignore[arg-type]

    def same_run(self, other: "RunAbout") -> bool:
        """Return whether both are of one run, as far as they tell: the launcher does not know the world's number."""
        if self.run and other.run and self.run != other.run:
            return False
        return (self.lab, self.mode, self.seed, self.roster) == (other.lab, other.mode, other.seed, other.roster)


def about_run(lab: str, mode: str, seed: int, roster: tuple[int, ...], process: str, run: str = "") -> RunAbout:
    """Return a run as recorded by this process."""
    return RunAbout(
        lab=lab,
        mode=mode,
        seed=seed,
        roster=tuple(sorted(roster)),
        process=process,
        run=run,
        python=platform.python_version(),
        platform=f"{sys.platform} {_c_library()}".strip(),
        machine=platform.machine(),
        compiled=not (time.__file__ or "").endswith(".py"),
    )


def _c_library() -> str:
    try:
        return os.confstr("CS_GNU_LIBC_VERSION") or ""
    except (AttributeError, OSError, ValueError):
        return ""
