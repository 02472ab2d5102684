"""Place and sigma of a Gaussian star -> its share in each pixel of a window, and its slopes."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from startrack.values import Floats


@njit(cache=True, error_model="numpy")
def gaussian_star(x: float, y: float, sigma: float, star: Floats) -> None:
    """Share of the light in each pixel, and its slopes by x, y and sigma: (4, rows, columns)."""
    _, rows, columns = star.shape
    across, down = np.empty((3, columns)), np.empty((3, rows))
    _line(x, sigma, across)
    _line(y, sigma, down)
    for j in range(rows):
        for i in range(columns):
            star[0, j, i] = down[0, j] * across[0, i]
            star[1, j, i] = down[0, j] * across[1, i]
            star[2, j, i] = down[1, j] * across[0, i]
            star[3, j, i] = down[2, j] * across[0, i] + down[0, j] * across[2, i]


@njit(cache=True, error_model="numpy")
def _line(centre: float, sigma: float, line: Floats) -> None:
    """Along one axis: integral of the normal law over each pixel, its slopes by centre, sigma."""
    for i in range(line.shape[1]):
        a, b = (i - 0.5 - centre) / sigma, (i + 0.5 - centre) / sigma
        pa = math.exp(-a * a / 2) / math.sqrt(2 * math.pi)
        pb = math.exp(-b * b / 2) / math.sqrt(2 * math.pi)
        line[0, i] = (math.erf(b / math.sqrt(2)) - math.erf(a / math.sqrt(2))) / 2
        line[1, i] = (pa - pb) / sigma
        line[2, i] = (a * pa - b * pb) / sigma
