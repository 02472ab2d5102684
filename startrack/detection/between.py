"""Image, peaks -> how far a star there stands out, wherever between the pixels it lies."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.detection.matched import Kernel
from startrack.detection.psf_table import expected
from startrack.values import Floats, Psf

Image = NDArray[np.float32]
# Places that are tried, pixel from a peak's. A star lies up to half a pixel off, and noise may
# carry its peak over to the next one; a quarter of a pixel costs 0.03 sigma of a sharp star.
PLACES = (-0.625, -0.375, -0.125, 0.125, 0.375, 0.625)
MORE = 2  # pixel; these filters see few pixels, and may see all that a star lights


@lru_cache(maxsize=64)
def bank(psf: Psf, kernel: Kernel) -> Floats:
    """Matched filters of stars between the pixels, each passing the kernel's share of noise.

    Returns  (36, rows, columns) about a peak, two more pixels than the kernel on each side
    """
    half_y, half_x = kernel.whole.shape[0] // 2 + MORE, kernel.whole.shape[1] // 2 + MORE
    filters = np.empty((len(PLACES) ** 2, 2 * half_y + 1, 2 * half_x + 1))
    star = np.empty((3, *filters.shape[1:]))
    for k in range(len(filters)):
        x, y = PLACES[k % len(PLACES)], PLACES[k // len(PLACES)]
        expected(psf.table, psf.oversampling, x, y, -half_x, -half_y, star)
        filters[k] = star[0] * (kernel.noise / np.linalg.norm(star[0]))
    return filters


@njit(cache=True, error_model="numpy")
def highest_between(image: Image, x: int, y: int, level: float, filters: Floats) -> float:
    """What the best of the filters makes of a peak, above a level; beyond the border is nothing."""
    count, height, width = filters.shape
    rows, columns = image.shape
    left, top = x - width // 2, y - height // 2
    best = -np.inf
    for k in range(count):
        total = 0.0
        for v in range(max(0, -top), min(height, rows - top)):
            for u in range(max(0, -left), min(width, columns - left)):
                total += filters[k, v, u] * (image[top + v, left + u] - level)
        best = max(best, total)
    return best
