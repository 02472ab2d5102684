"""Mean and noise of pixels that stars may be among."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

CLIP = 3.0  # sigma
ROUNDS = 6
SAMPLE = 32  # pixels that the first guess is made from
DEVIATION_TO_SIGMA = 1.2533  # mean absolute deviation of a normal law: sqrt(pi / 2)
# A normal law cut at 3 sigma again and again settles at 0.984 of its sigma.
CLIPPED_TO_SIGMA = 1.016


# Sums may be taken in any order, which lets the processor add several pixels at once.
@njit(cache=True, error_model="numpy", fastmath={"reassoc", "nsz", "contract"})
def clipped(values: NDArray[np.float32], floor: float) -> tuple[float, float]:
    """Mean and standard deviation of the values that lie within 3 sigma of the mean.

    The first guess is the median and the mean deviation from it, which lead there while stars or
    hot pixels take less than a quarter of the values; where trees or a limb take more, the noise
    comes out as large as they are. The mean resolves fractions of a digital number, as the
    median of an 8-bit image does not.

    values   (n,) in any unit, n > 0
    floor    least standard deviation, in the same unit
    Returns  mean, standard deviation
    """
    sample = values[:: max(1, len(values) // SAMPLE)]
    mean = np.median(sample)
    rms = max(DEVIATION_TO_SIGMA * float(np.mean(np.abs(sample - mean))), floor)
    count = 0
    for _ in range(ROUNDS):
        # Offsets from the last mean are small, so float32 sums lose no digits.
        reach = np.float32(CLIP * rms)
        kept, first, second = 0, np.float32(0), np.float32(0)
        for i in range(len(values)):
            offset = values[i] - mean
            inside = np.float32(abs(offset) <= reach)
            offset *= inside
            kept += int(inside)
            first += offset
            second += offset * offset
        if kept == 0:
            break
        shift = first / kept
        mean += np.float32(shift)
        rms = max(CLIPPED_TO_SIGMA * np.sqrt(max(second / kept - shift**2, 0.0)), floor)
        if kept == count:
            break
        count = kept
    return float(mean), rms


@njit(cache=True, error_model="numpy")
def ring(
    image: NDArray[np.float32], x: int, y: int, inner: int, outer: int
) -> NDArray[np.float32]:
    """The pixels of a square ring about (x, y), as far as they lie on the image.

    inner, outer  pixel, half sides of the ring, both inside it
    Returns       (n,) the values
    """
    rows, columns = image.shape
    values = np.empty((2 * outer + 1) ** 2 - (2 * inner - 1) ** 2, np.float32)
    count = 0
    for row in range(max(0, y - outer), min(rows, y + outer + 1)):
        for column in range(max(0, x - outer), min(columns, x + outer + 1)):
            if abs(row - y) >= inner or abs(column - x) >= inner:
                values[count] = image[row, column]
                count += 1
    return values[:count]
