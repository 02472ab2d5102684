"""Sample -> the Gaussian, integrated over pixels, that fits every star best, width and all."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from startrack.detection.robust import around
from startrack.detection.sample import ROW, Sample, pixel_noise
from startrack.detection.scoring import LEAST_PIXELS, brightness, cut, information, solved
from startrack.values import Floats

ROUNDS = 30
CLOSE = 3e-3  # sigma of the place
LONGEST = 0.5  # pixel
NARROWEST, WIDEST = 0.15, 8.0  # pixel


def gaussian(sample: Sample, sigma: float) -> Floats:
    """Fit x, y, flux, background and the star's sigma, by Fisher's scoring.

    It needs no PSF, and keeps the Cramer-Rao bound where stars are round and Gaussian, whatever
    their width.

    sigma    pixel, first guess, which also sets the window: 3 sigma and half a pixel
    Returns  as `gravity`; NaN where the fit runs away
    Errors   model: a star that is no Gaussian is fitted by its core.
    """
    half = max(sample.half, math.ceil(3 * sigma + 0.5))
    return _gaussian(*sample, sigma, half)


@njit(cache=True, error_model="numpy")
def _gaussian(  # type: ignore[no-untyped-def]
    image, x, y, half, floor, electrons_per_dn, offset, read_noise, saturation, first, reach
):
    table = np.full((len(x), ROW), np.nan)
    matrix, right = np.empty((5, 5)), np.empty(5)
    for i in range(len(x)):
        table[i, 7], table[i, 8] = x[i], y[i]
        level, slope_x, slope_y, spread, _ = around(image, x[i], y[i], reach, floor)
        noise, shot = pixel_noise(level, spread, floor, electrons_per_dn, offset, read_noise)
        if not noise > 0:
            continue
        data, left, top = cut(image, x[i], y[i], reach, reach, slope_x, slope_y, saturation)
        star = np.empty((4, data.shape[0], data.shape[1]))
        cx, cy, width = float(x[i]), float(y[i]), first
        _star(cx - left, cy - top, width, star)
        flux, background = brightness(data, star[0])
        for _ in range(ROUNDS):
            flux = max(flux, noise)
            count = information(data, star, flux, background, noise, shot, matrix, right)
            if count < LEAST_PIXELS or not solved(matrix, right):
                break
            step = max(abs(right[0]), abs(right[1]))
            # A width that is to change by half its size is far from its place yet.
            slower = min(1.0, LONGEST / max(step, 1e-30), 0.3 * width / max(abs(right[2]), 1e-30))
            cx, cy = cx + slower * right[0], cy + slower * right[1]
            width += slower * right[2]
            flux, background = flux + slower * right[3], background + slower * right[4]
            near = abs(cx - x[i]) <= reach and abs(cy - y[i]) <= reach
            if not (near and NARROWEST < width < WIDEST):
                break
            if slower == 1 and step < CLOSE * math.sqrt(min(matrix[0, 0], matrix[1, 1])):
                if flux > 0:
                    table[i, 0], table[i, 1], table[i, 2] = cx, cy, flux
                    table[i, 3] = math.sqrt(matrix[3, 3])
                    table[i, 4], table[i, 5], table[i, 6] = (
                        matrix[0, 0], matrix[0, 1], matrix[1, 1],
                    )  # fmt: skip
                break
            _star(cx - left, cy - top, width, star)
    return table


@njit(cache=True, error_model="numpy")
def _star(x: float, y: float, sigma: float, star: Floats) -> None:
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
