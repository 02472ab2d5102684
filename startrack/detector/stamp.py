"""Stars onto pixels: each PSF at its sub-pixel place, read from the table by six-point Lagrange."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.values import Psf

Floats = NDArray[np.float64]

ONE = np.ones((1, 1))
ONE.flags.writeable = False
ALIKE = 1e-14  # of the peak, by which a table may differ from the product of its middle lines
_lines: WeakKeyDictionary[Psf, tuple[Floats, Floats] | None] = WeakKeyDictionary()


def stamp(
    image: Floats, psf: Psf, x: Floats, y: Floats, electrons: Floats, gain: Floats | None = None
) -> None:
    """Add the images of points to `image`, in place.

    A table that is the product of a line and a column, as a Gaussian's, costs two lines a star.

    image      (rows, columns) electron
    x, y       (n,) pixel; what falls outside the image is left out
    electrons  (n,) electron
    gain       (rows, columns) 1, response of each pixel, None where all are one
    Errors     numerical: 4e-6 of the peak, 1e-5 pixel in the centroid, with the sampling that
               optics gives its tables; Gaussians 4e-7 of the peak, 1e-7 pixel.
    """
    lines = _separate(psf)
    gain = ONE if gain is None else gain
    if lines is None:
        _stamp(image, psf.table, psf.oversampling, x, y, electrons, gain)
    else:
        _stamp_lines(image, *lines, psf.oversampling, x, y, electrons, gain)


def _separate(psf: Psf) -> tuple[Floats, Floats] | None:
    """The line (along x) and the column of which the table is the product, if it is one."""
    if psf not in _lines:
        middle = psf.table.shape[0] // 2
        line, column = psf.table[middle], psf.table[:, middle]
        peak = psf.table[middle, middle]
        product = np.outer(column, line)
        alike = peak > 0 and np.abs(product - psf.table * peak).max() <= ALIKE * peak**2
        _lines[psf] = (line / np.sqrt(peak), column / np.sqrt(peak)) if alike else None
    return _lines[psf]


@njit(cache=True, error_model="numpy")
def _place(centre, pixels, samples, oversampling, weight):  # type: ignore[no-untyped-def]
    """Along one axis: the nearest pixel, the first and last around it, and where they read.

    Pixel p + i reads the samples from `start` + i * oversampling on, with the six weights: one
    pixel is one stride of the table, so all pixels of a star share them.
    """
    middle = samples // 2
    reach = (middle - 3) // oversampling
    pixel = int(np.floor(centre + 0.5))
    at = middle + (pixel - centre) * oversampling
    base = int(np.floor(at))
    _lagrange(at - base, weight)
    first = max(-reach, -pixel, -((base - 2) // oversampling))
    last = min(reach, pixels - 1 - pixel, (samples - 4 - base) // oversampling)
    return pixel, first, last, base - 2


@njit(cache=True, error_model="numpy")
def _off(x, y, image, samples, oversampling):  # type: ignore[no-untyped-def]
    """Whether a star cannot reach the image. NaN, behind the camera, cannot."""
    rows, columns = image.shape
    reach = (samples // 2 - 3) // oversampling
    return not (-reach - 1 < x < columns + reach and -reach - 1 < y < rows + reach)


@njit(cache=True, error_model="numpy")
def _stamp(image, table, oversampling, x, y, electrons, gain):  # type: ignore[no-untyped-def]
    rows, columns = image.shape
    samples, even = table.shape[0], gain.size == 1
    wx, wy = np.empty(6), np.empty(6)
    for n in range(len(x)):
        if _off(x[n], y[n], image, samples, oversampling):
            continue
        column, left, right, start_x = _place(x[n], columns, samples, oversampling, wx)
        row, lowest, highest, start_y = _place(y[n], rows, samples, oversampling, wy)
        for j in range(lowest, highest + 1):
            top = start_y + j * oversampling
            for i in range(left, right + 1):
                start = start_x + i * oversampling
                total = 0.0
                for b in range(6):
                    line = 0.0
                    for a in range(6):
                        line += wx[a] * table[top + b, start + a]
                    total += wy[b] * line
                seen = 1.0 if even else gain[row + j, column + i]
                image[row + j, column + i] += electrons[n] * total * seen


@njit(cache=True, error_model="numpy")
def _stamp_lines(image, line, down, oversampling, x, y, electrons, gain):  # type: ignore[no-untyped-def]
    rows, columns = image.shape
    samples, even = len(line), gain.size == 1
    wx, wy = np.empty(6), np.empty(6)
    across = np.empty(samples // oversampling + 2)
    for n in range(len(x)):
        if _off(x[n], y[n], image, samples, oversampling):
            continue
        column, left, right, start_x = _place(x[n], columns, samples, oversampling, wx)
        row, lowest, highest, start_y = _place(y[n], rows, samples, oversampling, wy)
        for i in range(left, right + 1):
            start = start_x + i * oversampling
            across[i - left] = electrons[n] * _read(line, start, wx)
        for j in range(lowest, highest + 1):
            share = _read(down, start_y + j * oversampling, wy)
            for i in range(left, right + 1):
                seen = 1.0 if even else gain[row + j, column + i]
                image[row + j, column + i] += share * across[i - left] * seen


@njit(cache=True, error_model="numpy")
def _read(line, start, weight):  # type: ignore[no-untyped-def]
    total = 0.0
    for a in range(6):
        total += weight[a] * line[start + a]
    return total


@njit(cache=True, error_model="numpy")
def _lagrange(t, weight):  # type: ignore[no-untyped-def]
    """Weights of the samples -2 ... 3 for a value at t in [0, 1), product form written out."""
    a, b, c, d, e, f = t + 2, t + 1, t, t - 1, t - 2, t - 3
    weight[0] = -b * c * d * e * f / 120
    weight[1] = a * c * d * e * f / 24
    weight[2] = -a * b * d * e * f / 12
    weight[3] = a * b * c * e * f / 12
    weight[4] = -a * b * c * d * f / 24
    weight[5] = a * b * c * d * e / 120
