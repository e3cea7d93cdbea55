"""What a run writes beside its report: its trace and, after an internal error, where that was."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rmr.base.file_errors import naming

BREAKDOWN_FILE = "breakdown.txt"


def write_trace(entries: Sequence[dict[str, Any]], path: Path) -> None:
    """Write a trace as JSON lines. Raises OSError with the name of the file."""
    with naming(path), path.open("w") as file:
        for entry in entries:
            file.write(json.dumps(entry) + "\n")
