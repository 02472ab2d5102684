"""Image, peaks of the filtered image -> peaks, several where the image shows several stars."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.detection.background import between
from startrack.detection.connect import Peaks, highest

Image = NDArray[np.float32]
CERTAIN = 4.0  # sigma; a bright star has a few maxima by chance, one in 10 000 dips as far
BRIGHT = 20.0  # sigma of a pixel; of fainter stars the filter has to tell
REACH = 4  # pixel; a filter of a usual star merges no peaks that are farther apart
MOST = 4  # stars for one peak


@njit(cache=True, error_model="numpy")
def split(
    image: Image,
    found: Peaks,
    mean: Image,
    rms: Image,
    mesh: int,
    noise: float,
    shot: float,
    border: int,
) -> Peaks:
    """Take the peaks apart that the filter has merged.

    Two maxima of the image itself are two stars where the image dips between them by more than
    noise does.

    mean, rms  of the Sky, and its mesh
    noise      share of a pixel's noise that the filter leaves
    shot       digital number, variance for each digital number of light; NaN where unknown
    border     pixel, distance that a peak must keep from the border, at least 1
    """
    size = len(found.x)
    x, y, area = np.empty((3, MOST * size), np.int64)
    count = 0
    near_x, near_y = np.empty((2, MOST), np.int64)
    for i in range(size):
        u, v = found.x[i], found.y[i]
        level, sigma = between(mean, mesh, u, v), between(rms, mesh, u, v) / noise
        light = sigma**2 / max(level, sigma) if math.isnan(shot) else shot
        stars = _maxima(image, u, v, level, sigma, light, border, near_x, near_y)
        if stars < 2:
            near_x[0], near_y[0], stars = u, v, 1
        for k in range(stars):
            if not ((x[:count] == near_x[k]) & (y[:count] == near_y[k])).any():
                x[count], y[count], area[count] = near_x[k], near_y[k], found.area[i]
                count += 1
    return Peaks(x[:count], y[:count], area[:count])


@njit(cache=True, error_model="numpy")
def _maxima(  # type: ignore[no-untyped-def]
    image, x, y, level, sigma, shot, border, near_x, near_y
):
    """Write the brightest maxima about a pixel between which the image dips; how many."""
    rows, columns = image.shape
    count = 0
    if image[y, x] - level < BRIGHT * sigma:
        return 0
    while count < MOST:
        best, at_x, at_y = BRIGHT * sigma, -1, -1
        for v in range(max(y - REACH, border), min(y + REACH + 1, rows - border)):
            for u in range(max(x - REACH, border), min(x + REACH + 1, columns - border)):
                high = image[v, u] - level
                if high > best and highest(image, u, v, 1):
                    error = math.sqrt(2 * (sigma**2 + shot * high))
                    if _dips(image, u, v, near_x[:count], near_y[:count], CERTAIN * error):
                        best, at_x, at_y = high, u, v
        if at_x < 0:
            break
        near_x[count], near_y[count] = at_x, at_y
        count += 1
    return count


@njit(cache=True, error_model="numpy")
def _dips(image, x, y, others_x, others_y, depth):  # type: ignore[no-untyped-def]
    """Whether the image falls by some depth between a maximum and each of the others."""
    for k in range(len(others_x)):
        far_x, far_y = others_x[k] - x, others_y[k] - y
        steps = max(abs(far_x), abs(far_y))
        lowest = float(image[y, x])
        for s in range(1, steps):
            u, v = x + round(far_x * s / steps), y + round(far_y * s / steps)
            lowest = min(lowest, image[v, u])
        if not image[y, x] - lowest > depth:
            return False
    return True
