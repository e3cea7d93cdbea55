"""Instants and durations.

Lab time is integer nanoseconds from the lab's own zero; no module of the cores reads a clock, they are
handed `now`. The robots' executive divides lab time into frames of 1/60 s (paper V.B.3): frame k begins
at ``k * 10**9 // 60``, so that frames never drift against whole seconds.
"""

from typing import Final

Instant = int
"""A point of lab time in nanoseconds."""

Duration = int
"""A length of time in nanoseconds."""

NS_PER_S: Final = 1_000_000_000
NS_PER_MS: Final = 1_000_000
NS_PER_US: Final = 1_000

TICK_HZ: Final = 60
TICK_S: Final = 1.0 / TICK_HZ
FRAME: Final[Duration] = NS_PER_S // TICK_HZ
"""The length of a frame of the executive, rounded down."""

NEVER: Final[Instant] = (1 << 62) - 1
"""An instant after the end of any run: the greatest int that compiled code holds unboxed."""


def seconds(value: float) -> Duration:
    """Return `value` seconds as nanoseconds, rounded to the nearest."""
    return round(value * NS_PER_S)


def milliseconds(value: float) -> Duration:
    """Return `value` milliseconds as nanoseconds, rounded to the nearest."""
    return round(value * NS_PER_MS)


def in_seconds(value: Duration) -> float:
    """Return nanoseconds as seconds."""
    return value / NS_PER_S


def tick_start(index: int) -> Instant:
    """Return the instant at which frame `index` of the executive begins."""
    return index * NS_PER_S // TICK_HZ


def tick_index(now: Instant) -> int:
    """Return the index of the frame that contains `now`."""
    return ((now + 1) * TICK_HZ - 1) // NS_PER_S
