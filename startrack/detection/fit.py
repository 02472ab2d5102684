"""Sample, model of a star -> most likely places and fluxes of stars, together where they touch."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.detection.gaussian_star import gaussian_star
from startrack.detection.psf_table import expected
from startrack.detection.robust import around
from startrack.detection.sample import ROW, Sample, pixel_noise
from startrack.detection.scoring import brightness, information, solved
from startrack.values import Floats, Ints

ROUNDS = 30
CLOSE = 3e-3  # sigma of the place; a last step of that length changes nothing
LONGEST = 0.5  # pixel
FASTEST = 0.3  # of the width; one that is to change by more is far from its place yet
NARROWEST, WIDEST = 0.15, 8.0  # pixel
SPARE = 4  # pixels more than there are parameters, or the fit tells nothing
MOST = 8  # stars that are fitted together
TOUCH = 1.5  # half sides of a window; a star farther off hardly shines into it


class Model(NamedTuple):
    """What a star looks like.

    table           of a PSF, where `width` is 0
    oversampling    of the table
    half_x, half_y  pixel, half sides of a star's window
    ring            pixel, half side of the square that the ring about a star leaves free
    width           pixel, first guess of the sigma of a Gaussian star
    """

    table: Floats
    oversampling: int
    half_x: int
    half_y: int
    ring: int
    width: float


@njit(cache=True, error_model="numpy")
def fitted(sample: Sample, model: Model) -> Floats:
    """Fit the stars that touch together, and each on its own where that runs away.

    Returns  (n, 9) as `gravity`; NaN where the fit runs away
    """
    count = len(sample.x)
    table = np.full((count, ROW), np.nan)
    table[:, 7], table[:, 8] = sample.x, sample.y
    waiting = np.ones(count, np.bool_)
    for i in range(count):
        if not waiting[i]:
            continue
        group = _touching(sample, model, i, waiting)
        if not _fit(sample, model, group, table) and len(group) > 1:
            for k in range(len(group)):
                _fit(sample, model, group[k : k + 1], table)
    return table


@njit(cache=True, error_model="numpy")
def _touching(sample: Sample, model: Model, first: int, waiting: NDArray[np.bool_]) -> Ints:
    """The stars that wait no more from here on: one, and what touches it or what it touches."""
    group = np.empty(MOST, np.int64)
    group[0], size, done = first, 1, 0
    waiting[first] = False
    while done < size:
        here = group[done]
        done += 1
        for other in range(first + 1, len(sample.x)):
            if not waiting[other] or size == MOST:
                continue
            far_x, far_y = sample.x[other] - sample.x[here], sample.y[other] - sample.y[here]
            if abs(far_x) <= TOUCH * model.half_x and abs(far_y) <= TOUCH * model.half_y:
                waiting[other] = False
                group[size] = other
                size += 1
    return group[:size]


@njit(cache=True, error_model="numpy")
def _fit(sample: Sample, model: Model, group: Ints, table: Floats) -> bool:
    """Write what a group of stars is found to be into their rows; False where it runs away."""
    x, y = sample.x[group], sample.y[group]
    u, v = (x.min() + x.max()) // 2, (y.min() + y.max()) // 2
    ring = model.ring + max(x.max() - u, y.max() - v)
    level, slope_x, slope_y, spread, _ = around(sample.image, u, v, ring, sample.floor)
    noise, shot = pixel_noise(
        level, spread, sample.floor, sample.electrons_per_dn, sample.offset, sample.read_noise
    )
    if not noise > 0:
        return False
    data, left, top = _cut(sample, model, x, y, slope_x, slope_y)
    shapes = 3 if model.width > 0 else 2
    each, size = shapes + 1, len(group) * (shapes + 1) + 1
    # Of each star x, y, sigma if it is not known, and flux; of all of them the background.
    value = np.empty(size)
    for k in range(len(group)):
        value[k * each], value[k * each + 1] = x[k], y[k]
        if model.width > 0:
            value[k * each + 2] = model.width
    star = np.empty((len(group), each, data.shape[0], data.shape[1]))
    matrix, step = np.empty((size, size)), np.empty(size)
    _shine(model, value, left, top, star)
    brightness(data, star, value)
    for _ in range(ROUNDS):
        for k in range(len(group)):
            # A negative star would repel its own place.
            value[k * each + shapes] = max(value[k * each + shapes], noise)
        count = information(data, star, value, noise, shot, matrix, step)
        if count < size + SPARE or not solved(matrix, step):
            return False
        slower, settled = _slower(value, step, matrix, each, shapes)
        value += slower * step
        if not _near(value, x, y, model, each):
            return False
        if settled:
            return _written(value, matrix, group, each, shapes, table)
        _shine(model, value, left, top, star)
    return False


@njit(cache=True, error_model="numpy")
def _cut(
    sample: Sample, model: Model, x: Ints, y: Ints, slope_x: float, slope_y: float
) -> tuple[Floats, int, int]:
    """The windows about some pixels as far as the image reaches, less the background's slopes.

    Returns  (rows, columns), NaN between the windows and where saturated or dead; its first
             column and row
    """
    image, (rows, columns) = sample.image, sample.image.shape
    left, top = max(x.min() - model.half_x, 0), max(y.min() - model.half_y, 0)
    right = min(x.max() + model.half_x + 1, columns)
    bottom = min(y.max() + model.half_y + 1, rows)
    data = np.full((bottom - top, right - left), np.nan)
    for k in range(len(x)):
        for v in range(max(y[k] - model.half_y, top), min(y[k] + model.half_y + 1, bottom)):
            for u in range(max(x[k] - model.half_x, left), min(x[k] + model.half_x + 1, right)):
                dead = sample.dead.size > 0 and sample.dead[v, u] != 0
                if not dead and image[v, u] < sample.saturation:
                    plane = slope_x * (u - x[0]) + slope_y * (v - y[0])
                    data[v - top, u - left] = image[v, u] - plane
    return data, left, top


@njit(cache=True, error_model="numpy")
def _shine(model: Model, value: Floats, left: int, top: int, star: Floats) -> None:
    """Share of each star's light in each pixel, and its slopes: (stars, 1 + k, rows, columns)."""
    each = star.shape[1]
    for k in range(len(star)):
        x, y = value[k * each], value[k * each + 1]
        if model.width > 0:
            gaussian_star(x - left, y - top, value[k * each + 2], star[k])
        else:
            expected(model.table, model.oversampling, x, y, left, top, star[k])


@njit(cache=True, error_model="numpy")
def _slower(
    value: Floats, step: Floats, matrix: Floats, each: int, shapes: int
) -> tuple[float, bool]:
    """Share of a step that leads not too far, and whether it is the last one.

    matrix  covariance of the values
    """
    slower, settled = 1.0, True
    for k in range(0, len(value) - 1, each):
        length = max(abs(step[k]), abs(step[k + 1]))
        slower = min(slower, LONGEST / max(length, 1e-30))
        if shapes == 3:
            slower = min(slower, FASTEST * value[k + 2] / max(abs(step[k + 2]), 1e-30))
        if not length < CLOSE * math.sqrt(min(matrix[k, k], matrix[k + 1, k + 1])):
            settled = False
    return slower, settled and slower == 1


@njit(cache=True, error_model="numpy")
def _near(value: Floats, x: Ints, y: Ints, model: Model, each: int) -> bool:
    """Whether all stars are still in their windows, and no Gaussian has lost its width."""
    for k in range(len(x)):
        if (
            abs(value[k * each] - x[k]) > model.half_x
            or abs(value[k * each + 1] - y[k]) > model.half_y
        ):
            return False
        if model.width > 0 and not NARROWEST < value[k * each + 2] < WIDEST:
            return False
    return True


@njit(cache=True, error_model="numpy")
def _written(
    value: Floats, matrix: Floats, group: Ints, each: int, shapes: int, table: Floats
) -> bool:
    """Write the stars' rows; False where a star has no light."""
    for k in range(len(group)):
        if not value[k * each + shapes] > 0:
            return False
    for k in range(len(group)):
        a, f, row = k * each, k * each + shapes, table[group[k]]
        row[0], row[1], row[2], row[3] = value[a], value[a + 1], value[f], math.sqrt(matrix[f, f])
        row[4], row[5], row[6] = matrix[a, a], matrix[a, a + 1], matrix[a + 1, a + 1]
    return True
