"""The stream of `rmr.base.streams.Choices` for a column of robots: SplitMix64 on unsigned 64-bit integers."""

from collections.abc import Sequence

import numpy as np

from rmr.base.streams import Choices, stable_hash
from rmr.columns.numbers import Array

_GAMMA = np.uint64(Choices.GAMMA)
_ONE, _OTHER = (np.uint64(each) for each in Choices.MULTIPLIERS)
_27, _30, _31, _32 = (np.uint64(each) for each in (27, 30, 31, 32))


def streams(names: Sequence[str]) -> Array:
    """Return the states of the streams with these names."""
    return np.fromiter(map(stable_hash, names), np.uint64, len(names))


def below(states: Array, bounds: Array) -> Array:
    """Return for each stream one of 0 .. bound - 1, and move the streams on in place."""
    states += _GAMMA
    mixed = states >> _30
    mixed ^= states
    mixed *= _ONE
    mixed ^= mixed >> _27
    mixed *= _OTHER
    mixed ^= mixed >> _31
    mixed >>= _32
    mixed *= bounds
    mixed >>= _32
    return mixed
