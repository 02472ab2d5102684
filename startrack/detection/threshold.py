"""A detection threshold enters; the number of false spots to expect leaves, and the inverse."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import scipy
from numba import njit
from numpy.typing import NDArray

from startrack.core import Floats, Psf
from startrack.detection.matched import Kernel, kernel_of
from startrack.detection.parameters import Detection
from startrack.detection.pixels import Gain
from startrack.detection.psf_table import expected
from startrack.detection.smear import star_image

Grid = NDArray[np.float32]
MILD = 0.5  # skewness up to which the expansion's second-order terms are small beside the first
# Kurtosis over skewness^2 is 9/8 for a Gaussian kernel on photons alone, and grows as one over
# the photons' fraction of the variance. Where the gain is unknown, they may have three fifths.
HEAVINESS = 9 / 8 / 0.6


def modelled(level: Grid, gain: Gain, step: float, kernel: Kernel) -> tuple[Grid, Grid, Grid]:
    """Noise of a filtered image by the gain model: Poisson's photons and normal read noise.

        rms^2 = v K2,   skewness = l K3 / (v K2)^1.5,   kurtosis = l K4 / (v K2)^2,
        v = l + read_noise^2 + step^2 / 12,   Kn = sum(kernel^n),   l in electron

    Source: the cumulants of a sum of independent variables add.

    level    digital number, background
    step     digital number between two neighbouring values
    Returns  rms in digital number, skewness, excess kurtosis
    """
    light = np.maximum(level - gain.offset, 0) * gain.electrons_per_dn
    squares, cubes, fourths = (float(np.sum(kernel.whole.astype(float) ** n)) for n in (2, 3, 4))
    variance = light + (gain.read_noise**2 + step**2 / 12) * gain.electrons_per_dn**2
    variance = np.maximum(squares * variance, 1e-30)
    rms = np.sqrt(variance) / gain.electrons_per_dn
    return rms, light * cubes / variance**1.5, light * fourths / variance**2


def sigmas(threshold: float, skewness: Grid, kurtosis: Grid) -> Grid:
    """How many sigma this noise passes as often as normal noise passes `threshold`.

        z + skewness (z^2 - 1) / 6 + kurtosis (z^3 - 3 z) / 24 - skewness^2 (2 z^3 - 5 z) / 36

    Source: Cornish and Fisher (1937), z = threshold; no less than z.

    The terms of second order stay what they are at a skewness of 0.5, beyond which the next
    ones would have to be told too.

    Accuracy  numerical: too much by 0.08 sigma at 5.5 sigma and a skewness of 0.24, by 0.6 at 0.46.
    """
    z = threshold
    more = skewness * (z**2 - 1) / 6
    more = more + np.minimum(kurtosis, HEAVINESS * MILD**2) * (z**3 - 3 * z) / 24
    more = more - np.minimum(skewness, MILD) ** 2 * (2 * z**3 - 5 * z) / 36
    return np.asarray(z + np.maximum(more, 0), np.float32)


Image = NDArray[np.float32]
# Places that are tried, pixel from a peak's. A star lies up to half a pixel off, and noise may
# carry its peak over to the next one; a quarter of a pixel costs 0.03 sigma of a sharp star.
PLACES = (-0.625, -0.375, -0.125, 0.125, 0.375, 0.625)
MORE = 2  # pixel; these filters see few pixels, and may see all that a star lights


@lru_cache(maxsize=64)
def bank(psf: Psf, kernel: Kernel) -> Floats:
    """Matched filters of stars between the pixels, each passing the kernel's fraction of noise.

    Returns  (36, rows, columns) about a peak, two more pixels than the kernel on each side
    """
    half_y, half_x = kernel.whole.shape[0] // 2 + MORE, kernel.whole.shape[1] // 2 + MORE
    filters = np.empty((len(PLACES) ** 2, 2 * half_y + 1, 2 * half_x + 1))
    star = np.empty((3, *filters.shape[1:]))
    for k in range(len(filters)):
        x, y = PLACES[k % len(PLACES)], PLACES[k // len(PLACES)]
        expected(psf.table, psf.oversampling, x, y, -half_x, -half_y, star)
        filters[k] = star[0] * (kernel.noise / np.linalg.norm(star[0]))
    return filters


@njit(cache=True, error_model="numpy")
def highest_between(image: Image, x: int, y: int, level: float, filters: Floats) -> float:
    """What the best of the filters makes of a peak, above a level; beyond the border is nothing."""
    count, height, width = filters.shape
    rows, columns = image.shape
    left, top = x - width // 2, y - height // 2
    best = -np.inf
    for k in range(count):
        total = 0.0
        for v in range(max(0, -top), min(height, rows - top)):
            for u in range(max(0, -left), min(width, columns - left)):
                total += filters[k, v, u] * (image[top + v, left + u] - level)
        best = max(best, total)
    return best


LOWEST, HIGHEST = 1.5, 12.0  # sigma; the density falls from 1 on, and nothing passes 12


def false_alarms(settings: Detection, columns: int, rows: int, psf: Psf | None = None) -> float:
    """Expected number of noise peaks that pass the threshold.

        n = area Lambda^(1/2) (2 pi)^(-3/2) z exp(-z^2 / 2)

    z is the threshold, Lambda the determinant of the covariance of the filtered noise's slopes
    over its variance, here from what the filters of neighbouring places have in common.

    Source: Adler (1981), The geometry of random fields, theorem 6.9.3.

    Returns  1, per frame
    Accuracy  model: 5 % for thresholds from 4 on where the gain is known, a factor of 2 where the
              tiles alone tell the noise.
    """
    star, area = star_image(settings, psf), columns * rows
    bumps = _bumps(star, kernel_of(settings, star))
    return area * bumps * _density(threshold_over(settings, area, star))


def threshold_of(settings: Detection, columns: int, rows: int, psf: Psf | None = None) -> float:
    """Sigma of normal noise that a spot must exceed in a frame, as `false_alarms` takes it."""
    return threshold_over(settings, columns * rows, star_image(settings, psf))


def threshold_over(settings: Detection, area: int, star: Psf) -> float:
    """The same for an area of pixels and a star's image: the setting, or what keeps the wish."""
    if settings.false_per_frame is None:
        return settings.threshold
    return _threshold(settings.false_per_frame, area, star, kernel_of(settings, star))


@lru_cache(maxsize=64)
def _threshold(wanted: float, area: int, star: Psf, kernel: Kernel) -> float:
    fraction = wanted / (area * _bumps(star, kernel))
    if fraction >= _density(LOWEST):
        return LOWEST
    return float(scipy.optimize.brentq(lambda z: math.log(_density(z) / fraction), LOWEST, HIGHEST))


def _density(z: float) -> float:
    return (2 * math.pi) ** -1.5 * z * math.exp(-z * z / 2)


@lru_cache(maxsize=64)
def _bumps(star: Psf, kernel: Kernel) -> float:
    """Lambda^(1/2): bumps of the filtered noise per pixel."""
    filters = bank(star, kernel)
    middle, step = len(PLACES) // 2, PLACES[1] - PLACES[0]
    here = middle * len(PLACES) + middle
    slope = 1.0
    for other in (here - 1, here - len(PLACES)):
        common = float((filters[here] * filters[other]).sum()) / kernel.noise**2
        slope *= -2 * math.log(common) / step**2
    return math.sqrt(slope)
