"""Stars onto pixels: each PSF at its sub-pixel place, read from the table by six-point Lagrange."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.values import Psf

Floats = NDArray[np.float64]


def stamp(image: Floats, psf: Psf, x: Floats, y: Floats, electrons: Floats) -> None:
    """Add the images of points to `image`, in place.

    image      (rows, columns) electron
    x, y       (n,) pixel; what falls outside the image is left out
    electrons  (n,) electron
    Errors     numerical: 1.5e-6 of the peak where the PSF's sigma is 0.25 pixel or more.
    """
    _stamp(image, psf.table, psf.oversampling, x, y, electrons)


@njit(cache=True, error_model="numpy")
def _stamp(image, table, oversampling, x, y, electrons):  # type: ignore[no-untyped-def]
    rows, columns = image.shape
    middle = table.shape[0] // 2
    reach = (middle - 3) // oversampling
    wx, wy = np.empty(6), np.empty(6)
    for n in range(len(x)):
        if not (-reach - 1 < x[n] < columns + reach and -reach - 1 < y[n] < rows + reach):
            continue
        column, row = int(np.floor(x[n] + 0.5)), int(np.floor(y[n] + 0.5))
        # Pixel (column, row) has its centre at this place of the table.
        at_x = middle + (column - x[n]) * oversampling
        at_y = middle + (row - y[n]) * oversampling
        base_x, base_y = int(np.floor(at_x)), int(np.floor(at_y))
        _lagrange(at_x - base_x, wx)
        _lagrange(at_y - base_y, wy)
        # One pixel is one stride of the table, so all pixels share the same twelve weights.
        lowest = max(-reach, -row, -((base_y - 2) // oversampling))
        highest = min(reach, rows - 1 - row, (table.shape[0] - 4 - base_y) // oversampling)
        left = max(-reach, -column, -((base_x - 2) // oversampling))
        right = min(reach, columns - 1 - column, (table.shape[1] - 4 - base_x) // oversampling)
        for j in range(lowest, highest + 1):
            top = base_y + j * oversampling - 2
            for i in range(left, right + 1):
                start = base_x + i * oversampling - 2
                total = 0.0
                for b in range(6):
                    line = 0.0
                    for a in range(6):
                        line += wx[a] * table[top + b, start + a]
                    total += wy[b] * line
                image[row + j, column + i] += electrons[n] * total


@njit(cache=True, error_model="numpy")
def _lagrange(t, weight):  # type: ignore[no-untyped-def]
    """Weights of the samples -2 ... 3 for a value at t in [0, 1)."""
    for k in range(6):
        product = 1.0
        for m in range(6):
            if m != k:
                product *= (t - (m - 2)) / (k - m)
        weight[k] = product
