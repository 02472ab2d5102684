"""Psf -> how far the centre of gravity in a window is wrong, and its measurements set right."""

from __future__ import annotations

import numpy as np

from startrack.core import Floats, Psf, kernel
from startrack.detection.psf_table import expected
from startrack.detection.sample import FLUX, FLUX_SIGMA, WINDOW_X, WINDOW_Y, XX, XY, YY, X, Y

STEPS = 32  # per pixel; linear interpolation then errs by 1e-4 of the window's pull
SIDE = 2 * STEPS + 1  # from -1 to 1 pixel
ROUNDS = 20
FLATTEST = 0.1  # where the centre of gravity moves less than that with the star, it tells nothing


def s_curve(psf: Psf, half: int) -> Floats:
    """Centre of gravity, without noise, of a window of 2 half + 1 pixels.

    Source: Alexander and Ng (1991), who name the error of the centre of gravity over the place
    of the star within its pixel after its shape.

    Returns  (3, 65, 65) along x and along y, pixel, and the fraction of the light within the
             window; by the star's place [row, column] from -1 to 1 pixel from the window's centre
    """
    return _s_curve(psf.table, psf.oversampling, half)


@kernel
def _s_curve(table: Floats, oversampling: int, half: int) -> Floats:
    curve = np.empty((3, SIDE, SIDE))
    star = np.empty((3, 2 * half + 1, 2 * half + 1))
    for j in range(SIDE):
        for i in range(SIDE):
            x, y = i / STEPS - 1, j / STEPS - 1
            expected(table, oversampling, x, y, -half, -half, star)
            light, gx, gy = 0.0, 0.0, 0.0
            for v in range(2 * half + 1):
                for u in range(2 * half + 1):
                    light += star[0, v, u]
                    gx += star[0, v, u] * (u - half)
                    gy += star[0, v, u] * (v - half)
            curve[0, j, i], curve[1, j, i], curve[2, j, i] = gx / light, gy / light, light
    return curve


@kernel
def compensate(table: Floats, curve: Floats) -> None:
    """Take the S-curve off plain centres of gravity and the window's cut off fluxes, in place.

    The place that would give the centre measured is found by Newton's method, one slope an axis;
    noise grows by the inverse of the slopes. A centre that no star can give stays as it is.

    table  (n, COLUMNS) as `gravity` gives it
    curve  as `s_curve` gives it
    """
    step = 1 / STEPS
    for n in range(len(table)):
        if np.isnan(table[n, FLUX]):
            continue
        gx, gy = table[n, X] - table[n, WINDOW_X], table[n, Y] - table[n, WINDOW_Y]
        x, y = gx, gy
        slope_x, slope_y = 1.0, 1.0
        for _ in range(ROUNDS):
            here_x, here_y = _at(curve[0], x, y), _at(curve[1], x, y)
            slope_x = (_at(curve[0], x + step, y) - _at(curve[0], x - step, y)) / (2 * step)
            slope_y = (_at(curve[1], x, y + step) - _at(curve[1], x, y - step)) / (2 * step)
            slope_x, slope_y = max(slope_x, FLATTEST), max(slope_y, FLATTEST)
            x += (gx - here_x) / slope_x
            y += (gy - here_y) / slope_y
        if not (abs(x) < 1 - step and abs(y) < 1 - step):
            continue
        fraction = _at(curve[2], x, y)
        table[n, X], table[n, Y] = table[n, WINDOW_X] + x, table[n, WINDOW_Y] + y
        table[n, FLUX] /= fraction
        table[n, FLUX_SIGMA] /= fraction
        table[n, XX] /= slope_x * slope_x
        table[n, XY] /= slope_x * slope_y
        table[n, YY] /= slope_y * slope_y


@kernel
def _at(grid: Floats, x: float, y: float) -> float:
    """Bilinear, and beyond the grid as at its edge."""
    u = min(max((x + 1) * STEPS, 0.0), SIDE - 1.001)
    v = min(max((y + 1) * STEPS, 0.0), SIDE - 1.001)
    i, j = int(v), int(u)
    s, t = v - i, u - j
    upper = grid[i, j] + t * (grid[i, j + 1] - grid[i, j])
    lower = grid[i + 1, j] + t * (grid[i + 1, j + 1] - grid[i + 1, j])
    return upper + s * (lower - upper)
