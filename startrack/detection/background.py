"""Filtered image -> the level that a spot must exceed, from background and noise tile by tile."""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.detection.robust import clipped

Image = NDArray[np.float32]
STRIDE = 3  # the filtered image is smooth: every third row and column tells nearly all of it


MOST_SKEWNESS = 1.0  # where one term of the expansion still orders the levels well
TAIL = 5.0  # sigma; what is farther out is a star, and no part of the noise's tail


def level(filtered: Image, mesh: int, threshold: float, floor: float) -> Image:
    """Background plus `threshold` times the noise, over the whole image.

        level = background + rms (z + skewness (z^2 - 1) / 6),   z = threshold

    Source: Cornish and Fisher (1937), to first order in the skewness: the level that skewed
    noise passes as often as normal noise passes z sigma.

    Background and noise are measured on the filtered image itself, in tiles, and interpolated
    between the tiles' centres. So a gradient, haze, a limb or correlated noise raises the level
    only where it is. One tile cannot tell its skewness; the median over all of them can.

    filtered   (rows, columns) digital number
    mesh       pixel, side of a tile
    threshold  sigma
    floor      digital number, least noise
    Returns    (rows, columns) digital number
    Errors     statistical: 0.1 sigma of the filtered image for 32-pixel tiles.
    """
    rows, columns = filtered.shape
    down, across = max(1, round(rows / mesh)), max(1, round(columns / mesh))
    mean, rms, skewness = _tiles(filtered, down, across, floor)
    # One tile knows its noise to 8 %, and at 5 sigma a level 8 % low lets ten times more noise
    # through: so no tile goes below the median of its neighbours.
    rms = np.maximum(rms, cv2.medianBlur(rms, 3))
    skew = min(max(float(np.median(skewness)), 0.0), MOST_SKEWNESS)
    sigmas = threshold + skew * max(threshold**2 - 1, 0.0) / 6
    high = (mean + sigmas * rms).astype(np.float32)
    return cv2.resize(high, (columns, rows), interpolation=cv2.INTER_LINEAR)


@njit(cache=True, error_model="numpy")
def _tiles(image: Image, down: int, across: int, floor: float) -> tuple[Image, Image, Image]:
    """Mean, noise and skewness of `down` by `across` tiles of equal size."""
    rows, columns = image.shape
    mean = np.empty((down, across), np.float32)
    rms = np.empty((down, across), np.float32)
    skewness = np.empty((down, across), np.float32)
    for i in range(down):
        top, bottom = i * rows // down, (i + 1) * rows // down
        for j in range(across):
            left, right = j * columns // across, (j + 1) * columns // across
            tile = image[top:bottom:STRIDE, left:right:STRIDE].copy().ravel()
            mean[i, j], rms[i, j] = clipped(tile, floor)
            skewness[i, j] = _skewness(tile, mean[i, j], rms[i, j])
    return mean, rms, skewness


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "nsz", "contract"})
def _skewness(values: Image, mean: np.float32, rms: np.float32) -> float:
    """Third standardised moment of the values that are noise; 0 where there is none."""
    if rms == 0:
        return 0.0
    total, count = np.float32(0), 0
    for i in range(len(values)):
        z = (values[i] - mean) / rms
        inside = np.float32(abs(z) <= np.float32(TAIL))
        total += inside * z * z * z
        count += int(inside)
    return total / max(count, 1)
