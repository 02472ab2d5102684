"""Filtered image -> the level that a spot must exceed, from background and noise tile by tile."""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.detection.robust import plane

Image = NDArray[np.float32]
STRIDE = 3  # the filtered image is smooth: every third row and column tells nearly all of it
MOST_SKEWNESS = 1.0  # where one term of the expansion still orders the levels well
TAIL = 5.0  # sigma; what is farther out is a star, and no part of the noise's tail


def level(filtered: Image, mesh: int, threshold: float, floor: float) -> Image:
    """Background plus `threshold` times the noise, over the whole image.

        level = background + rms (z + skewness (z^2 - 1) / 6),   z = threshold

    Source: Cornish and Fisher (1937), to first order in the skewness: the level that skewed
    noise passes as often as normal noise passes z sigma.

    A plane and the noise about it are measured on the filtered image itself, in tiles, and
    interpolated between the tiles' centres. So haze, a limb or correlated noise raises the level
    only where it is, and a gradient nowhere. One tile cannot tell its skewness; the median over
    all of them can.

    filtered   (rows, columns) digital number
    mesh       pixel, side of a tile
    threshold  sigma
    floor      digital number, least noise
    Returns    (rows, columns) digital number
    Errors     statistical: 0.1 sigma of the filtered image for 32-pixel tiles.
    """
    rows, columns = filtered.shape
    mesh = min(mesh, max(rows, columns))
    mean, rms, skewness = _tiles(filtered, mesh, floor)
    # One tile knows its noise to 8 %, and at 5 sigma a level 8 % low lets ten times more noise
    # through: so no tile goes below the median of its neighbours.
    rms = np.maximum(rms, cv2.medianBlur(rms, 3))
    skew = min(max(float(np.median(skewness)), 0.0), MOST_SKEWNESS)
    sigmas = threshold + skew * max(threshold**2 - 1, 0.0) / 6
    high = mean + np.float32(sigmas) * np.pad(rms, 1, mode="edge")
    down, across = high.shape
    whole = cv2.resize(high, (across * mesh, down * mesh), interpolation=cv2.INTER_LINEAR)
    return np.asarray(whole[mesh : mesh + rows, mesh : mesh + columns], np.float32)


@njit(cache=True, error_model="numpy")
def _tiles(image: Image, mesh: int, floor: float) -> tuple[Image, Image, Image]:
    """Background, noise and skewness of square tiles.

    Returns  background at the centres of the tiles and of one more tile on each side, by the
             outer tiles' slopes; noise and skewness of the tiles alone
    """
    rows, columns = image.shape
    down, across = -(-rows // mesh), -(-columns // mesh)
    mean = np.empty((down + 2, across + 2), np.float32)
    rms = np.empty((down, across), np.float32)
    skewness = np.empty((down, across), np.float32)
    centre = (mesh - 1) / 2
    for i in range(down):
        # The last tile is moved inwards to be whole; its plane tells the rest.
        top = max(min(i * mesh, rows - mesh), 0)
        for j in range(across):
            left = max(min(j * mesh, columns - mesh), 0)
            cut = image[top : top + mesh : STRIDE, left : left + mesh : STRIDE]
            tile = cut.copy().ravel()
            dx, dy = _grid(cut.shape[0], cut.shape[1], left - j * mesh, top - i * mesh, centre)
            level, slope_x, slope_y, rms[i, j] = plane(tile, dx, dy, floor)
            skewness[i, j] = _skewness(tile, level, rms[i, j])
            # An outer tile also speaks for its neighbour beyond the border.
            for v in range(i if i == 0 else i + 1, i + 3 if i == down - 1 else i + 2):
                for u in range(j if j == 0 else j + 1, j + 3 if j == across - 1 else j + 2):
                    steps = slope_x * (u - 1 - j) + slope_y * (v - 1 - i)
                    mean[v, u] = level + mesh * steps
    return mean, rms, skewness


@njit(cache=True, error_model="numpy")
def _grid(down: int, across: int, left: int, top: int, centre: float) -> tuple[Image, Image]:
    """Where the pixels of a tile lie, (n,) columns and rows from its centre, pixel."""
    dx = np.empty(down * across, np.float32)
    dy = np.empty(down * across, np.float32)
    for i in range(down):
        for j in range(across):
            dx[i * across + j] = left + STRIDE * j - centre
            dy[i * across + j] = top + STRIDE * i - centre
    return dx, dy


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "nsz", "contract"})
def _skewness(values: Image, mean: float, rms: float) -> float:
    """Third standardised moment of the values that are noise; 0 where there is none."""
    if rms == 0:
        return 0.0
    total, count = np.float32(0), 0
    level, scale = np.float32(mean), np.float32(1 / rms)
    for i in range(len(values)):
        z = (values[i] - level) * scale
        inside = np.float32(abs(z) <= np.float32(TAIL))
        total += inside * z * z * z
        count += int(inside)
    return float(total / max(count, 1))
