"""Build hook of the wheel: the provided labs and the manual pages always, compiled modules on demand.

The pure wheel is the default. With ``RMR_COMPILE=1`` mypyc's extension modules (`rmr.compiled.build`) go in beside
their sources, and Python prefers them there; such a wheel is for this platform and this Python alone. An editable
install has both in the tree.
"""

import os
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

LABS = "deploy/labs"
LABS_IN_WHEEL = "rmr_world/labs"


class WheelHook(BuildHookInterface):  # type: ignore[type-arg]
    """Adds to the wheel what is no module of its packages."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Put labs, manual pages, and compiled modules if they are asked for, into `build_data`."""
        if version != "standard":
            return
        root = Path(self.root)
        included = build_data["force_include"]
        for file in sorted((root / LABS).rglob("*")):
            if file.is_file() and file.suffix in {".yaml", ".rmr", ".py"}:
                included[str(file)] = f"{LABS_IN_WHEEL}/{file.relative_to(root / LABS).as_posix()}"
        for file in _manual_pages(root):
            build_data["shared_data"][str(file)] = f"share/man/man1/{file.name}"
        if os.environ.get("RMR_COMPILE") == "1":
            for file, place in _compiled(root).items():
                included[str(file)] = place
            build_data["pure_python"] = False
            build_data["infer_tag"] = True


def _manual_pages(root: Path) -> list[Path]:
    """Write what `rmr man` writes and return its files; the commands tell their help without any library."""
    sys.path[:0] = [str(root / folder) for folder in ("", "agents", "world", "deploy")]
    from rmr.commands.man_command import write_pages  # noqa: PLC0415 - the path was set above

    return write_pages(root / "build" / "man")


def _compiled(root: Path) -> dict[Path, str]:
    """Compile what is not up to date; return where in the wheel each extension module belongs."""
    from rmr.compiled import FOLDER, modules_in  # noqa: PLC0415 - the pure wheel needs no compiler
    from rmr.compiled.build import compile_into, look_for_a_compiler  # noqa: PLC0415

    os.chdir(root)
    look_for_a_compiler()
    if not modules_in(FOLDER):
        compile_into(FOLDER)
    made = [file for file in sorted(FOLDER.rglob("*")) if file.suffix in {".so", ".pyd"}]
    return {file: file.relative_to(FOLDER).as_posix() for file in made}
