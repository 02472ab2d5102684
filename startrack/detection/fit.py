"""Windows and a model of a star -> the most likely positions and fluxes of stars."""

import math
from typing import NamedTuple

import numpy as np

from startrack.core import Flags, Floats, Ints, Psf, PsfTable, kernel
from startrack.detection.gravity import (
    COLUMNS,
    FLUX,
    FLUX_SIGMA,
    WINDOW_X,
    WINDOW_Y,
    XX,
    XY,
    YY,
    Sample,
    X,
    Y,
    pixel_noise,
)
from startrack.detection.robust import around
from startrack.detection.star_model import StarModel, expected


@kernel
def information(
    data: Floats,
    star: Floats,
    value: Floats,
    noise: float,
    shot: float,
    matrix: Floats,
    right: Floats,
) -> int:
    """Fisher's information of the stars' shapes and fluxes, and of the background.

        mu = sum(flux p) + background,   var = noise^2 + shot sum(flux max(p, 0))
        matrix = sum(dmu dmu^T / var),   right = sum(dmu (data - mu) / var)

    A step `matrix^-1 right` is a step of Fisher's scoring. The variance follows from the model and
    not from the data, so that a pixel's weight does not depend on its noise.

    Source: Kay, Estimation Theory (1993), sections 3.6 and 7.7.

    data    (rows, columns) minus the known slopes; NaN in pixels that do not count
    star    (m, 1 + k, rows, columns) p of each star, and its derivatives by its k shape values
    value   (m (k + 1) + 1,) shape and flux of each star; last the background
    matrix  (n, n), right (n,) for n values: written here
    Returns the number of pixels that counted
    """
    stars, per_star, rows, columns = star.shape
    size, shapes = len(value), per_star - 1
    if stars == 1 and shapes == 2:
        return int(_information_of_one(data, star[0], value, noise, shot, matrix, right))
    matrix[:] = 0
    right[:] = 0
    slope = np.empty(size)
    slope[size - 1] = 1.0
    count = 0
    for j in range(rows):
        for i in range(columns):
            if np.isnan(data[j, i]):
                continue
            count += 1
            mean, variance = value[size - 1], noise * noise
            for s in range(stars):
                fraction, flux = star[s, 0, j, i], value[s * per_star + shapes]
                mean += flux * fraction
                variance += shot * flux * max(fraction, 0.0)
                for k in range(shapes):
                    slope[s * per_star + k] = flux * star[s, k + 1, j, i]
                slope[s * per_star + shapes] = fraction
            weight = 1 / variance
            rest = weight * (data[j, i] - mean)
            for k in range(size):
                right[k] += slope[k] * rest
                for m in range(k + 1):
                    matrix[k, m] += weight * slope[k] * slope[m]
    for k in range(size):
        for m in range(k):
            matrix[m, k] = matrix[k, m]
    return count


@kernel
def _information_of_one(
    data: Floats,
    star: Floats,
    value: Floats,
    noise: float,
    shot: float,
    matrix: Floats,
    right: Floats,
) -> int:
    """`information` of one star of known width, with all sums in registers: a quarter of the time.

    star  (3, rows, columns);  value  x, y, flux, background
    """
    flux, level, square, count = value[2], value[3], noise * noise, 0
    xx, xy, yy, xf, yf, ff = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    x1, y1, f1, b1, by_x, by_y, by_f, by_1 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(data.shape[0]):
        for i in range(data.shape[1]):
            if np.isnan(data[j, i]):
                continue
            count += 1
            f = star[0, j, i]
            x, y = flux * star[1, j, i], flux * star[2, j, i]
            weight = 1 / (square + shot * flux * max(f, 0.0))
            rest = weight * (data[j, i] - (level + flux * f))
            by_x += x * rest
            by_y += y * rest
            by_f += f * rest
            by_1 += rest
            wx, wy, wf = weight * x, weight * y, weight * f
            xx += wx * x
            xy += wy * x
            yy += wy * y
            xf += wf * x
            yf += wf * y
            ff += wf * f
            x1 += weight * x
            y1 += weight * y
            f1 += weight * f
            b1 += weight
    # Not row by row: numba would also compile the error message for rows that do not fit.
    matrix[0, 0], matrix[1, 1], matrix[2, 2], matrix[3, 3] = xx, yy, ff, b1
    matrix[0, 1] = matrix[1, 0] = xy
    matrix[0, 2] = matrix[2, 0] = xf
    matrix[0, 3] = matrix[3, 0] = x1
    matrix[1, 2] = matrix[2, 1] = yf
    matrix[1, 3] = matrix[3, 1] = y1
    matrix[2, 3] = matrix[3, 2] = f1
    right[0], right[1], right[2], right[3] = by_x, by_y, by_f, by_1
    return count


@kernel
def brightness(data: Floats, star: Floats, value: Floats) -> None:
    """Write fluxes and background of stars of known shapes, by least squares, into the values."""
    stars, per_star, rows, columns = star.shape
    matrix, right = np.zeros((stars + 1, stars + 1)), np.zeros(stars + 1)
    part = np.ones(stars + 1)
    for j in range(rows):
        for i in range(columns):
            if np.isnan(data[j, i]):
                continue
            for s in range(stars):
                part[s] = star[s, 0, j, i]
            for k in range(stars + 1):
                right[k] += part[k] * data[j, i]
                for m in range(stars + 1):
                    matrix[k, m] += part[k] * part[m]
    if not solved(matrix, right):
        right[:] = 0
    for s in range(stars):
        value[s * per_star + per_star - 1] = right[s]
    value[len(value) - 1] = right[stars]


@kernel
def solved(matrix: Floats, right: Floats) -> bool:
    """Overwrite a symmetric positive matrix by its inverse and `right` by the solution.

    By Gauss and Jordan, scaled to a unit diagonal, because fluxes and places differ in size.

    Returns  False where the matrix is singular
    """
    n = len(right)
    scale = np.empty(n)
    for k in range(n):
        if not matrix[k, k] > 0:
            return False
        scale[k] = 1 / np.sqrt(matrix[k, k])
    for k in range(n):
        right[k] *= scale[k]
        for m in range(n):
            matrix[k, m] *= scale[k] * scale[m]
    for k in range(n):
        pivot = matrix[k, k]
        if not pivot > 1e-10:
            return False
        matrix[k, k] = 1.0
        right[k] /= pivot
        for i in range(n):
            matrix[k, i] /= pivot
        for m in range(n):
            if m != k:
                factor = matrix[m, k]
                matrix[m, k] = 0.0
                for i in range(n):
                    matrix[m, i] -= factor * matrix[k, i]
                right[m] -= factor * right[k]
    for k in range(n):
        right[k] *= scale[k]
        for m in range(n):
            matrix[k, m] *= scale[k] * scale[m]
    return True


@kernel
def gaussian_star(x: float, y: float, sigma: float, star: Floats) -> None:
    """Fraction of the light in each pixel, and its derivatives by x, y and sigma: (4, rows,
    columns)."""
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


@kernel
def _line(centre: float, sigma: float, line: Floats) -> None:
    """One axis: integral of the normal law over each pixel, and its derivatives by centre and
    sigma."""
    for i in range(line.shape[1]):
        a, b = (i - 0.5 - centre) / sigma, (i + 0.5 - centre) / sigma
        pa = math.exp(-a * a / 2) / math.sqrt(2 * math.pi)
        pb = math.exp(-b * b / 2) / math.sqrt(2 * math.pi)
        line[0, i] = (math.erf(b / math.sqrt(2)) - math.erf(a / math.sqrt(2))) / 2
        line[1, i] = (pa - pb) / sigma
        line[2, i] = (a * pa - b * pb) / sigma


ROUNDS = 30
CLOSE = 3e-3  # sigma of the place; a last step of that length changes nothing
LONGEST = 0.5  # pixel
FASTEST = 0.3  # of the width; a star whose width changes by more is not yet at its place
NARROWEST, WIDEST = 0.15, 8.0  # pixel
SPARE = 4  # least excess of pixels over parameters, for a determined fit
MOST = 8  # most stars that are fitted together
TOUCH = 1.5  # half sides of a window; a star farther off adds little light to it


class Model(NamedTuple):
    """Model of a star's image.

    table           of a PSF, if `width` is 0
    half_x, half_y  pixel, half sides of a star's window
    ring            pixel, half side of the square inside the ring around a star
    width           pixel, first guess of the sigma of a Gaussian star
    """

    table: PsfTable
    half_x: int
    half_y: int
    ring: int
    width: float


@kernel
def fitted(sample: Sample, model: Model) -> Floats:
    """Fit touching stars together; if that diverges, fit each of them alone.

    Returns  (n, COLUMNS) as `gravity`; NaN where the fit diverges
    """
    count = len(sample.x)
    table = np.full((count, COLUMNS), np.nan)
    for i in range(count):
        table[i, WINDOW_X], table[i, WINDOW_Y] = sample.x[i], sample.y[i]
    guess, waiting = _first_guess(model), np.ones(count, np.bool_)
    for i in range(count):
        if not waiting[i]:
            continue
        group = _touching(sample, model, i, waiting)
        if not _fit(sample, model, group, guess, table) and len(group) > 1:
            for k in range(len(group)):
                _fit(sample, model, group[k : k + 1], guess, table)
    return table


@kernel
def _first_guess(model: Model) -> Floats:
    """A star in the middle of its window, as `_render_model` writes it: the first guess of all."""
    per_star = 4 if model.width > 0 else 3
    star = np.empty((1, per_star, 2 * model.half_y + 1, 2 * model.half_x + 1))
    value = np.array([float(model.half_x), float(model.half_y), model.width])
    _render_model(model, value, 0, 0, star)
    return star


@kernel
def _touching(sample: Sample, model: Model, first: int, waiting: Flags) -> Ints:
    """A star and all stars connected to it by touching; they are removed from the waiting stars."""
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


@kernel
def _fit(sample: Sample, model: Model, group: Ints, guess: Floats, table: Floats) -> bool:
    """Write the fit of a group of stars into their rows; False if it diverges.

    guess  from `_first_guess`
    """
    x, y = np.empty(len(group), np.int64), np.empty(len(group), np.int64)
    for k in range(len(group)):
        x[k], y[k] = sample.x[group[k]], sample.y[group[k]]
    (first_x, last_x), (first_y, last_y) = _span(x), _span(y)
    u, v = (first_x + last_x) // 2, (first_y + last_y) // 2
    ring = model.ring + max(last_x - u, last_y - v)
    level, slope_x, slope_y, spread, _ = around(sample.image, u, v, ring, sample.floor)
    noise, shot = pixel_noise(sample, level, spread)
    if not noise > 0:
        return False
    data, left, top = _cut(sample, model, x, y, slope_x, slope_y)
    shapes = 3 if model.width > 0 else 2
    per_star, size = shapes + 1, len(group) * (shapes + 1) + 1
    # For each star x, y, sigma if it is unknown, and flux; one background for all.
    value = np.empty(size)
    for k in range(len(group)):
        value[k * per_star], value[k * per_star + 1] = x[k], y[k]
        if model.width > 0:
            value[k * per_star + 2] = model.width
    star = np.empty((len(group), per_star, data.shape[0], data.shape[1]))
    matrix, step = np.empty((size, size)), np.empty(size)
    if star.shape == guess.shape:  # one star, whose window is whole
        star[:] = guess
    else:
        _render_model(model, value, left, top, star)
    brightness(data, star, value)
    for _ in range(ROUNDS):
        for k in range(len(group)):
            # A negative star would drive the fit away from its place.
            value[k * per_star + shapes] = max(value[k * per_star + shapes], noise)
        count = information(data, star, value, noise, shot, matrix, step)
        if count < size + SPARE or not solved(matrix, step):
            return False
        fraction_of_step, settled = _step_fraction(value, step, matrix, per_star, shapes)
        for k in range(size):
            value[k] += fraction_of_step * step[k]
        if not _inside_windows(value, x, y, model, per_star):
            return False
        if settled:
            return _written(value, matrix, group, per_star, shapes, table)
        _render_model(model, value, left, top, star)
    return False


@kernel
def _span(values: Ints) -> tuple[int, int]:
    """The least and the largest value; compiles faster than numba's functions."""
    least = most = values[0]
    for k in range(1, len(values)):
        least, most = min(least, values[k]), max(most, values[k])
    return least, most


@kernel
def _cut(
    sample: Sample, model: Model, x: Ints, y: Ints, slope_x: float, slope_y: float
) -> tuple[Floats, int, int]:
    """The windows around some pixels inside the image, minus the background's slopes.

    Returns  (rows, columns), NaN between windows and in saturated or dead pixels; its first column
             and row
    """
    image, (rows, columns) = sample.image, sample.image.shape
    (first_x, last_x), (first_y, last_y) = _span(x), _span(y)
    left, top = max(first_x - model.half_x, 0), max(first_y - model.half_y, 0)
    right = min(last_x + model.half_x + 1, columns)
    bottom = min(last_y + model.half_y + 1, rows)
    data = np.full((bottom - top, right - left), np.nan)
    for k in range(len(x)):
        for v in range(max(y[k] - model.half_y, top), min(y[k] + model.half_y + 1, bottom)):
            for u in range(max(x[k] - model.half_x, left), min(x[k] + model.half_x + 1, right)):
                dead = sample.dead.size > 0 and sample.dead[v, u] != 0
                if not dead and image[v, u] < sample.saturation:
                    plane = slope_x * (u - x[0]) + slope_y * (v - y[0])
                    data[v - top, u - left] = image[v, u] - plane
    return data, left, top


@kernel
def _render_model(model: Model, value: Floats, left: int, top: int, star: Floats) -> None:
    """Fraction of each star's light in each pixel, and its derivatives: (stars, 1 + k, rows,
    columns)."""
    per_star = star.shape[1]
    for k in range(len(star)):
        x, y = value[k * per_star], value[k * per_star + 1]
        if model.width > 0:
            gaussian_star(x - left, y - top, value[k * per_star + 2], star[k])
        else:
            expected(model.table, x, y, left, top, star[k])


@kernel
def _step_fraction(
    value: Floats, step: Floats, matrix: Floats, per_star: int, shapes: int
) -> tuple[float, bool]:
    """Fraction of a step that stays within the limits, and whether it is the last step.

    matrix  covariance of the values
    """
    fraction_of_step, settled = 1.0, True
    for k in range(0, len(value) - 1, per_star):
        length = max(abs(step[k]), abs(step[k + 1]))
        fraction_of_step = min(fraction_of_step, LONGEST / max(length, 1e-30))
        if shapes == 3:
            fraction_of_step = min(
                fraction_of_step, FASTEST * value[k + 2] / max(abs(step[k + 2]), 1e-30)
            )
        if not length < CLOSE * math.sqrt(min(matrix[k, k], matrix[k + 1, k + 1])):
            settled = False
    return fraction_of_step, settled and fraction_of_step == 1


@kernel
def _inside_windows(value: Floats, x: Ints, y: Ints, model: Model, per_star: int) -> bool:
    """Whether all stars are still in their windows, and all widths within their limits."""
    for k in range(len(x)):
        if (
            abs(value[k * per_star] - x[k]) > model.half_x
            or abs(value[k * per_star + 1] - y[k]) > model.half_y
        ):
            return False
        if model.width > 0 and not NARROWEST < value[k * per_star + 2] < WIDEST:
            return False
    return True


@kernel
def _written(
    value: Floats, matrix: Floats, group: Ints, per_star: int, shapes: int, table: Floats
) -> bool:
    """Write the stars' rows; False where a star has no light."""
    for k in range(len(group)):
        if not value[k * per_star + shapes] > 0:
            return False
    for k in range(len(group)):
        a, f, row = k * per_star, k * per_star + shapes, table[group[k]]
        row[X], row[Y], row[FLUX] = value[a], value[a + 1], value[f]
        row[FLUX_SIGMA] = math.sqrt(matrix[f, f])
        row[XX], row[XY], row[YY] = matrix[a, a], matrix[a, a + 1], matrix[a + 1, a + 1]
    return True


NO_TABLE = Psf(np.zeros((1, 1)), 1, 1.0).arranged


def gaussian(sample: Sample, sigma: float) -> Floats:
    """Fit x, y, flux, background and the star's sigma, by Fisher's scoring.

    It needs no PSF, and attains the Cramer-Rao bound for round Gaussian stars of any width.

    sigma    pixel, first guess, which also sets the window: 3 sigma and half a pixel
    Returns  as `gravity`; NaN where the fit diverges
    Accuracy  model: for a star that is not a Gaussian, the fit follows its core.
    """
    half = max(sample.half, math.ceil(3 * sigma + 0.5))
    return np.asarray(fitted(sample, Model(NO_TABLE, half, half, half, float(sigma))))


def likelihood(sample: Sample, star: StarModel) -> Floats:
    """Fit x, y, flux and background with the PSF of the design, by Fisher's scoring.

    Stars that touch are fitted together. Saturated and dead pixels are left
    out; a smeared star is fitted with a smeared PSF. The covariance is the inverse of Fisher's
    information, the Cramer-Rao bound of these stars.

    Source: Winick (1986), Cramer-Rao lower bounds on the performance of charge-coupled-device
    optical position estimators; `information` for the equations.

    star     as the tracker assumes it
    Returns  as `gravity`; NaN where the fit diverges
    Accuracy  statistical: attains the bound within 1 % for an SNR of 15 or more, and within 3 % at
              8, with the star's own shot noise included; no estimator attains it at lower SNR.
              model: a PSF that is too wide by 10 % adds 1 % to the error of the place, and 10 % to
              the flux. If the gain is unknown, the weights are those of a faint star.
    """
    psf, (half_x, half_y) = star.psf, star.fit_window
    ring = max(sample.half, half_x, half_y)
    return np.asarray(fitted(sample, Model(psf.arranged, half_x, half_y, ring, 0.0)))
