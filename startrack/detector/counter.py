"""(key, pixel) -> 64 random bits, in any order: the draw of a pixel is the same in every window.

The generator is SplitMix64, entered at the pixel's number. It has no state that a loop would have
to carry along, so that a compiler can compute eight pixels at once.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from startrack.streams import Streams

GOLDEN = np.uint64(0x9E3779B97F4A7C15)  # odd, next to 2^64 over the golden ratio
FIRST = np.uint64(0xBF58476D1CE4E5B9)
SECOND = np.uint64(0x94D049BB133111EB)
UNIT = 2.0**-53


def key(streams: Streams, cause: str) -> np.uint64:
    """The key of one cause in one trial."""
    return np.uint64(streams(cause).bit_generator.random_raw())


@njit(cache=True, error_model="numpy", inline="always")
def bits(start, pixel):  # type: ignore[no-untyped-def]
    """64 random bits of a pixel.

    Source: Steele, Lea and Flood (2014), Fast splittable pseudorandom number generators,
    OOPSLA, with the constants of Stafford's mix 13; it passes BigCrush.

    start  key as uint64
    pixel  number as uint64
    """
    z = start + GOLDEN * (pixel + np.uint64(1))
    z = (z ^ (z >> np.uint64(30))) * FIRST
    z = (z ^ (z >> np.uint64(27))) * SECOND
    return z ^ (z >> np.uint64(31))


@njit(cache=True, error_model="numpy", inline="always")
def uniform(random):  # type: ignore[no-untyped-def]
    """The middle of one of 2^52 cells of (0, 1), so that one minus it is exact as well."""
    return (np.float64(np.int64(random >> np.uint64(12))) + 0.5) * (2 * UNIT)
