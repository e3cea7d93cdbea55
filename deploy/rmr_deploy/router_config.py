"""The configuration with which zenohd stands in for `rmr router`: the settings of that, as one JSON document.

Under a secret the id of the router proves that it knows it (`rmr.bus.secret`). It follows from lab and host, so that
the same words print the same octets, and no two hosts have one id.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rmr.bus.certificates import CertificateError, check_keys, secret_file
from rmr.bus.listening import secret_of_listener
from rmr.bus.middleware import router_settings
from rmr.bus.secret import SecretError
from rmr.entry import ExitCode
from rmr.entry.files import unreadable
from rmr_world.finding import LabError
from rmr_world.lab_file import lab_path, load_lab
from rmr_world.provided_labs import missing, resolve


def show(path: Path, host: str, listen: str, connect: Sequence[str], file: Path | None) -> int:
    """Print the configuration of the router on `host` for the lab in `path`; return the exit code."""
    problems = [] if resolve(path).exists() else [missing(path)]
    problems += unreadable([] if problems else [lab_path(path)]) + unreadable([secret_file(file)])
    if problems:
        print("\n".join(f"rmr router: {problem}" for problem in problems), file=sys.stderr)
        return ExitCode.USAGE
    try:
        lab = load_lab(path)
        secret = secret_of_listener(None if file is None else file.absolute(), makes=False)
        check_keys(secret, "router", of=lab.name if lab.mtls else None)
    except (LabError, SecretError, CertificateError) as error:
        print(error, file=sys.stderr)
        return ExitCode.INVALID
    settings = router_settings(listen, connect, secret, f"{lab.name}/{host}")
    print(json.dumps(_nested({"metadata": {"lab": lab.name, "host": host}, **settings}), indent=2))
    return ExitCode.OK


def _nested(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings whose keys are paths as objects within objects, as a configuration file of zenoh has them."""
    document: dict[str, Any] = {}
    for path, value in settings.items():
        *above, name = path.split("/")
        place = document
        for each in above:
            place = place.setdefault(each, {})
        place[name] = value
    return document
