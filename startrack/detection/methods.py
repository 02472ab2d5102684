"""Sample and Psf -> a row per star, by each of the centroid methods that a design can name."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from startrack.core import Flags, Floats, Ints, Psf, call_code, is_code, returned
from startrack.detection.fit import gaussian, likelihood
from startrack.detection.gravity import (
    COLUMNS,
    WINDOW_X,
    WINDOW_Y,
    Sample,
    gravity,
    pixel_noise,
    weighted,
)
from startrack.detection.robust import around_each
from startrack.detection.star_model import StarModel, compensate

NARROWEST_WEIGHT = 1.0  # pixel
WIDEST = 6  # pixel, half side; light farther out does not change a centroid


class CentroidMethod(NamedTuple):
    """A centroid method, and which pixels it uses. A window is given by half its side, pixel.

    measure     Sample, StarModel, kernel_sigma in pixel, compensation -> rows as `gravity`
    reads       half of the key `window`, kernel_sigma, StarModel -> half side of the pixels read
    moved_by    the same for the pixels that are varied to compute its response to noise
    skips_dead  whether it leaves out dead pixels; else a star with a dead pixel near is dropped
    place       faster `measure` without the covariance; None: as `measure`
    """

    measure: Callable[[Sample, StarModel, float, str], Floats]
    reads: Callable[[int, float, StarModel], int]
    moved_by: Callable[[int, float, StarModel], int]
    skips_dead: bool = False
    place: Callable[[Sample, StarModel, float, str], Floats] | None = None


def compensated_gravity(stars: Sample, star: StarModel, sigma: float, compensation: str) -> Floats:
    """Centre of gravity, corrected for the light outside its window and for the pixel size."""
    table = gravity(stars, uncut=compensation == "gaussian")
    if compensation == "psf":
        compensate(table, star.s_curve)
    return table


def widened_weight(stars: Sample, star: StarModel, sigma: float, compensation: str) -> Floats:
    """Centre of gravity under a Gaussian weight as wide as the star is in the pixels."""
    # Pixels widen a star by their own variance; a narrower weight would show pixel effects.
    seen = math.hypot(sigma, 1 / math.sqrt(12))
    return weighted(stars, max(seen, NARROWEST_WEIGHT))


# By the value of the key `centroid`.
CENTROIDS: Mapping[str, CentroidMethod] = {
    "gravity": CentroidMethod(
        compensated_gravity,
        reads=lambda half, sigma, star: half,
        moved_by=lambda half, sigma, star: half,
    ),
    "weighted": CentroidMethod(
        widened_weight,
        reads=lambda half, sigma, star: half,
        moved_by=lambda half, sigma, star: min(half + 1, WIDEST),
    ),
    "gaussian": CentroidMethod(
        lambda stars, star, sigma, compensation: gaussian(stars, sigma),
        reads=lambda half, sigma, star: math.ceil(3 * sigma + 0.5),
        moved_by=lambda half, sigma, star: min(half + 1, WIDEST),
        skips_dead=True,
    ),
    "likelihood": CentroidMethod(
        lambda stars, star, sigma, compensation: likelihood(stars, star),
        reads=lambda half, sigma, star: max(star.fit_window),
        moved_by=lambda half, sigma, star: min(max(star.fit_window), WIDEST),
        skips_dead=True,
    ),
}


GROUP = "centroids"
FARTHEST = 1  # pixel along either axis: largest move of a window towards its star


@dataclass(frozen=True, eq=False)
class CentroidInput:
    """Windows around stars, in which a centroid measures positions.

    signal        (n, side, side) digital number above the local background, [row, column]
    noise         (n,) digital number, rms of an empty pixel
    shot          (n,) digital number, variance that each digital number of light adds
    unknown       (n, side, side) whether a pixel is dead or saturated
    kernel_sigma  pixel, sigma of the star's image that the tracker assumes
    psf           the star's image that the tracker assumes

    The function returns (n, 3): x and y in pixel from the middle of the window, flux in digital
    numbers; then startrack computes the covariance from the change of x and y with each pixel. Or
    (n, 6): xx, xy and yy of that covariance, pixel^2, too. A row with NaN is a star that cannot be
    measured; it gives no spot.
    """

    signal: Floats
    noise: Floats
    shot: Floats
    unknown: Flags
    kernel_sigma: float
    psf: Psf


def method_of(name: str) -> CentroidMethod:
    """The centroid method of a value of the key `centroid`."""
    if not is_code(name):
        return CENTROIDS[name]
    return CentroidMethod(
        partial(centroids_by_code, name),
        reads=lambda half, sigma, star: half + FARTHEST,
        moved_by=lambda half, sigma, star: half + FARTHEST,
        place=partial(centroids_by_code, name, stated=False),
    )


def centroids_by_code(
    name: str, sample: Sample, star: StarModel, sigma: float, compensation: str, stated: bool = True
) -> Floats:
    """One row per candidate, as `gravity` describes it; each window is re-centred once.

    stated  whether to state covariances; else they are zero
    Raises  ValueError if the function raises an error, or returns an invalid result.
    """
    table = np.full((len(sample.x), COLUMNS), np.nan)
    table[:, WINDOW_X], table[:, WINDOW_Y] = sample.x, sample.y
    if not len(sample.x):
        return table
    given = sample, star, sigma
    measured = _measured(name, *given, sample.x, sample.y, stated)
    rows, columns = sample.image.shape
    off = np.nan_to_num(np.clip(np.rint(measured[:, :2]), -FARTHEST, FARTHEST)).astype(np.int64)
    half = sample.half
    x = np.clip(sample.x + off[:, 0], half, columns - 1 - half)
    y = np.clip(sample.y + off[:, 1], half, rows - 1 - half)
    moved = (x != sample.x) | (y != sample.y)
    if moved.any():
        measured[moved] = _measured(name, *given, x[moved], y[moved], stated)
    # A centroid outside its window belongs to another star, or to none.
    good = np.isfinite(measured).all(axis=1) & (np.abs(measured[:, :2]) <= half).all(axis=1)
    good &= (measured[:, 2] > 0) & (measured[:, 3:] >= 0)[:, [0, 1, 3]].all(axis=1)
    measured[:, 0] += x
    measured[:, 1] += y
    table[:, WINDOW_X], table[:, WINDOW_Y] = x, y
    table[good, :WINDOW_X] = measured[good]
    return table


def _measured(
    name: str, sample: Sample, star: StarModel, sigma: float, x: Ints, y: Ints, stated: bool
) -> Floats:
    """Rows x, y, flux, its sigma, xx, xy, yy of the windows about pixels (n,)."""
    given = _windows(sample, star, sigma, x, y)
    answer = returned(GROUP, name, call_code(GROUP, name, given), (len(x), (3, 6)), finite=False)
    rows = np.zeros((len(x), 7))
    rows[:, :3] = answer[:, :3]
    if not stated:
        return rows
    variance = given.noise[:, None, None] ** 2 + given.shot[:, None, None] * given.signal.clip(0)
    if answer.shape[1] == 6:
        rows[:, 3] = np.sqrt(variance.sum(axis=(1, 2)))
        rows[:, 4:] = answer[:, 3:]
    else:
        rows[:, 3:] = _propagated(name, given, variance)
    return rows


def _windows(sample: Sample, star: StarModel, sigma: float, x: Ints, y: Ints) -> CentroidInput:
    """The windows around pixels, minus the plane through the ring of each."""
    step = np.arange(-sample.half, sample.half + 1)
    row, column = y[:, None, None] + step[:, None], x[:, None, None] + step
    value = sample.image[row, column].astype(float)
    unknown = value >= sample.saturation
    if sample.dead.size:
        unknown |= sample.dead[row, column] > 0
    noise, shot = np.empty((2, len(x)))
    ground = around_each(sample.image, x, y, sample.half, sample.floor)
    for k, (level, slope_x, slope_y, spread) in enumerate(ground.tolist()):
        value[k] -= level + slope_x * step + slope_y * step[:, None]
        noise[k], shot[k] = pixel_noise(sample, level, spread)
    return CentroidInput(value, noise, shot, unknown, sigma, star.psf)


def _propagated(name: str, given: CentroidInput, variance: Floats) -> Floats:
    """Sigma of the flux and covariance xx, xy, yy by the noise of each pixel alone.

        cov = sum_i slope_i slope_i^T var_i

    Source: linear propagation of independent pixel noise, slopes by central differences over two
    sigma of each pixel, all in one call.
    """
    count, side, _ = given.signal.shape
    size = side * side
    step = np.sqrt(variance).reshape(count, size)
    above = np.repeat(given.signal.reshape(count, 1, size), 2 * size, axis=1)
    pixel = np.arange(size)
    above[:, pixel, pixel] += step
    above[:, size + pixel, pixel] -= step
    changed = replace(
        given,
        signal=above.reshape(-1, side, side),
        noise=np.repeat(given.noise, 2 * size),
        shot=np.repeat(given.shot, 2 * size),
        unknown=np.repeat(given.unknown, 2 * size, axis=0),
    )
    shape = (len(changed.signal), (3, 6))
    answer = returned(GROUP, name, call_code(GROUP, name, changed), shape, finite=False)
    answer = answer[:, :3].reshape(count, 2, size, 3)
    by = (answer[:, 0] - answer[:, 1]) / 2  # slope times sigma
    rows = np.empty((count, 4))
    rows[:, 0] = np.sqrt((by[:, :, 2] ** 2).sum(axis=1))
    rows[:, 1:] = (by[:, :, [0, 0, 1]] * by[:, :, [0, 1, 1]]).sum(axis=1)
    return rows
