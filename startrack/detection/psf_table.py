"""Psf -> the fraction of light in each pixel of a window, and how it moves with the star."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from startrack.core import Floats, Psf, kernel

TAPS = 6
# Row k holds the polynomial that is 1 at tap k of -2 ... 3 and 0 at the others, lowest power first.
LAGRANGE = np.ascontiguousarray(
    np.linalg.inv(np.vander(np.arange(-2.0, TAPS - 2), increasing=True)).T
)
OVERSAMPLING = 8
REACH = 6.0  # sigma
FRACTION = 0.996  # of the light along one axis that a window must hold to lose no accuracy
LARGEST = 15  # pixel, half side of a window


@lru_cache(maxsize=64)
def gaussian_psf(sigma: float) -> Psf:
    """A Gaussian star of `sigma` pixel, integrated over pixels; for trackers that know no more."""
    samples = OVERSAMPLING * max(1, math.ceil(0.5 / sigma))
    half = math.ceil((REACH * sigma + 1) * samples) + TAPS
    place = np.arange(-half, half + 1) / samples
    scale = sigma * math.sqrt(2)
    line = np.array([math.erf((p + 0.5) / scale) - math.erf((p - 0.5) / scale) for p in place]) / 2
    return Psf(np.outer(line, line), samples, 1.0)


def window_of(psf: Psf) -> tuple[int, int]:
    """Half sides (columns, rows) of the window that a fit needs, pixel."""
    middle = psf.table.shape[0] // 2
    halves = []
    for axis in (0, 1):
        line = np.cumsum(psf.table.sum(axis=axis)) / psf.table.sum()
        outside = (1 - FRACTION) / 2
        first, last = np.searchsorted(line, [outside, 1 - outside])
        widest = max(middle - first, last - middle) / psf.oversampling
        # Half a pixel for the star's place within its own, and one for the background.
        halves.append(min(math.ceil(widest + 0.5), LARGEST))
    return halves[0], halves[1]


@kernel
def expected(
    table: Floats, oversampling: int, x: float, y: float, left: int, top: int, star: Floats
) -> None:
    """Write the fraction of a star's light in the pixels of a window, and its slopes.

    Six-point Lagrange along x, then along y: a pixel is one stride of the table, so that all
    pixels of a star share their weights.

    x, y       pixel, of the star
    left, top  pixel, first column and row of the window
    star       (3, rows, columns) 1, slope by x, slope by y, written here; 0 beyond the table
    Accuracy   numerical: 1e-6 of the peak for a PSF with four samples a sigma.
    """
    middle, samples = table.shape[0] // 2, table.shape[0]
    _, rows, columns = star.shape
    at_x, at_y = middle + (left - x) * oversampling, middle + (top - y) * oversampling
    base_x, base_y = math.floor(at_x), math.floor(at_y)
    wx, sx = np.empty(TAPS), np.empty(TAPS)
    wy, sy = np.empty(TAPS), np.empty(TAPS)
    _weights(at_x - base_x, wx, sx)
    _weights(at_y - base_y, wy, sy)
    star[:] = 0
    for j in range(rows):
        for b in range(TAPS):
            row = base_y + j * oversampling + b - 2
            if row < 0 or row >= samples:
                continue
            line = table[row]
            for i in range(columns):
                start = base_x + i * oversampling - 2
                if start < 0 or start + TAPS > samples:
                    continue
                value, slope = 0.0, 0.0
                for a in range(TAPS):
                    value += wx[a] * line[start + a]
                    slope += sx[a] * line[start + a]
                star[0, j, i] += wy[b] * value
                star[1, j, i] -= wy[b] * slope * oversampling
                star[2, j, i] -= sy[b] * value * oversampling


@kernel
def _weights(t: float, value: Floats, slope: Floats) -> None:
    """Lagrange's weights at t in [0, 1), and their slopes, by Horner's scheme."""
    for k in range(TAPS):
        v, s = 0.0, 0.0
        for power in range(TAPS - 1, -1, -1):
            s = s * t + v
            v = v * t + LAGRANGE[k, power]
        value[k], slope[k] = v, s
