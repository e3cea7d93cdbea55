"""The bill of materials of the distribution as CycloneDX 1.6, from `pyproject.toml` and `requirements.lock`.

The lock knows each package with its version, its hashes, and what asks for it ("via"). From what the distribution
depends on these edges lead to what an installation brings (scope `required`), from its extras for users to `optional`;
everything else (tests, building) is `excluded`. Packages that only some platforms or versions of Python need are in it,
with the condition. There is no network and no clock in it: equal sources give equal octets. With SOURCE_DATE_EPOCH the
document has that time.

    python deploy/release/sbom.py [FILE]
"""

import json
import os
import re
import sys
import tomllib
import uuid
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
NAMESPACE = uuid.UUID("1d1c9d0e-3c0e-5b43-9f2e-6a3c1f4f7c11")
"""Of the serial numbers: a document's is made of its content."""
USERS_EXTRAS = ("cluster", "editor", "foxglove", "keys", "maps", "plot")
"""Extras for users that are in `requirements.lock`."""


@dataclass
class Package:
    """A pinned package: an entry of the lock."""

    name: str
    version: str
    marker: str
    hashes: list[str] = field(default_factory=list)
    via: list[str] = field(default_factory=list)

    @property
    def url(self) -> str:
        """Return its package URL, by which documents name it."""
        return f"pkg:pypi/{self.name}@{self.version}"


class LockError(Exception):
    """The lock cannot be read: what is wrong, and what to do."""


def read_lock(text: str) -> list[Package]:
    """Return the packages of a lock that `uv pip compile` has written. Raises LockError."""
    packages: list[Package] = []
    for number, line in enumerate(text.splitlines(), 1):
        if pin := re.fullmatch(r"([a-z0-9][a-z0-9.-]*)==(\S+?)(?: ; (.*?))?(?: \\)?", line):
            packages.append(Package(pin[1], pin[2], pin[3] or ""))
        elif packages and (digest := re.fullmatch(r"    --hash=sha256:([0-9a-f]{64})(?: \\)?", line)):
            packages[-1].hashes.append(digest[1])
        elif packages and (via := re.fullmatch(r"    #(?: via)? +(?:-r )?(\S+)(?: \(.*\))?", line)):
            packages[-1].via.append(via[1])
        elif line.strip() not in {"", "# via"}:
            raise LockError(f"line {number} is none of uv's: {line.strip()!r:.60}; write the lock anew with make lock")
    for package in packages:
        if not package.hashes:
            raise LockError(f"{package.name} has no hash: write the lock anew with make lock")
    if not packages:
        raise LockError("no package is in it: write the lock anew with make lock")
    return packages


def names_of(requirements: Iterable[str]) -> set[str]:
    """Return the names of `requirements`, as the lock has them."""
    return {re.sub("[._]", "-", re.split(r"[^\w.-]", each, maxsplit=1)[0].lower()) for each in requirements}


def reached(packages: list[Package], names: set[str]) -> set[str]:
    """Return `names` and all that they ask for."""
    found: set[str] = set()
    more = names
    while more:
        found |= more
        more = {package.name for package in packages if not found.isdisjoint(package.via)} - found
    return found


def document(project: dict[str, Any], packages: list[Package], epoch: str | None) -> dict[str, Any]:
    """Return the bill of materials of `project`."""
    required = reached(packages, names_of(project["dependencies"]))
    extras = project["optional-dependencies"]
    optional = reached(packages, names_of(each for name in USERS_EXTRAS for each in extras[name]))
    if missing := (required | optional) - {package.name for package in packages}:
        raise LockError(
            f"{', '.join(sorted(missing))}: in pyproject.toml, not in the lock; write it anew with make lock"
        )
    root = f"pkg:pypi/{project['name']}@{project['version']}"
    components = [
        {
            "type": "library",
            "bom-ref": package.url,
            "name": package.name,
            "version": package.version,
            "purl": package.url,
            "scope": "required" if package.name in required else "optional" if package.name in optional else "excluded",
            # One of several files of this version is installed, so that they are no hashes of the component itself.
            "externalReferences": [
                {
                    "type": "distribution",
                    "url": package.url,
                    "hashes": [{"alg": "SHA-256", "content": each} for each in package.hashes],
                }
            ],
            **({"properties": [{"name": "rmr:marker", "value": package.marker}]} if package.marker else {}),
        }
        for package in packages
    ]
    direct = names_of([*project["dependencies"], *(each for name in USERS_EXTRAS for each in extras[name])])
    made: dict[str, Any] = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "bom-ref": root,
                "name": project["name"],
                "version": project["version"],
                "description": project["description"],
                "licenses": [{"expression": project["license"]}],
                "purl": root,
            }
        },
        "components": components,
        "dependencies": [
            {"ref": root, "dependsOn": sorted(each.url for each in packages if each.name in direct)},
            *(
                {"ref": one.url, "dependsOn": sorted(each.url for each in packages if one.name in each.via)}
                for one in packages
            ),
        ],
    }
    if epoch is not None:
        made["metadata"]["timestamp"] = datetime.fromtimestamp(int(epoch), UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    serial = uuid.uuid5(NAMESPACE, json.dumps(made, sort_keys=True))
    return {"serialNumber": f"urn:uuid:{serial}", **made}


def main(words: list[str]) -> int:
    """Write the document to the file in `words`, or print it; return the exit code."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    if len(words) > 1 or (words and words[0].startswith("-")):
        print("usage: python deploy/release/sbom.py [FILE]", file=sys.stderr)
        return 2
    if epoch is not None and not re.fullmatch("[0-9]{1,11}", epoch):
        print(f"sbom: SOURCE_DATE_EPOCH is {epoch!r}: write seconds since 1970, or unset it", file=sys.stderr)
        return 2
    try:
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
        made = document(project, read_lock((ROOT / "requirements.lock").read_text()), epoch)
        text = json.dumps(made, indent=1) + "\n"
        if words:
            file = Path(words[0])
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
            print(f"{len(made['components'])} packages in {file}")
        else:
            print(text, end="")
    except LockError as error:
        print(f"sbom: requirements.lock: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"sbom: {error.filename}: {error.strerror}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
