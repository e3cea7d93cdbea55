"""JSON as the server sends it: compact, and null for what is no number in JSON."""

import json
from math import isfinite
from typing import Any


def json_text(value: Any) -> str:
    """Return `value` as compact JSON; infinities and NaN become null."""
    try:
        return json.dumps(value, separators=(",", ":"), allow_nan=False)
    except ValueError:
        return json.dumps(_finite(value), separators=(",", ":"), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(part) for part in value]
    return value
