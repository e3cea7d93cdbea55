"""Named random streams: every source of chance has a name of its own.

`stream("7/robot3/csma")` gives the same numbers on every machine and under every PYTHONHASHSEED (the name is
hashed with SHA-512 by `random.Random`), and drawing from one stream never disturbs another.
"""

import hashlib
from random import Random


def stream(name: str) -> Random:
    """Return the random stream called `name`, for example ``"7/robot3/vm"``."""
    return Random(name)


def stable_hash(text: str, octets: int = 8) -> int:
    """Return an unsigned hash of `text` that is the same in every process (BLAKE2b, `octets` long)."""
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=octets).digest(), "big")


def uniform(*parts: int | str) -> float:
    """Return a number in [0, 1) that depends on nothing but `parts`; two processes agree on it."""
    return stable_hash("/".join(map(str, parts)), 7) / (1 << 56)
