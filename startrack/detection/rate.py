"""Detection -> how many false spots to expect in a frame of nothing but noise, and back."""

from __future__ import annotations

import math
from functools import lru_cache

import scipy

from startrack.detection.between import PLACES, bank
from startrack.detection.matched import Kernel, kernel_of
from startrack.detection.parameters import Detection
from startrack.detection.smear import star_image
from startrack.values import Psf

LOWEST, HIGHEST = 1.5, 12.0  # sigma; the density falls from 1 on, and nothing passes 12


def false_alarms(settings: Detection, columns: int, rows: int, psf: Psf | None = None) -> float:
    """Expected number of noise peaks that pass the threshold.

        n = area Lambda^(1/2) (2 pi)^(-3/2) z exp(-z^2 / 2)

    z is the threshold, Lambda the determinant of the covariance of the filtered noise's slopes
    over its variance, here from what the filters of neighbouring places have in common.

    Source: Adler (1981), The geometry of random fields, theorem 6.9.3.

    Returns  1, per frame
    Errors   model: 5 % for thresholds from 4 on where the gain is known, a factor of 2 where the
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
    share = wanted / (area * _bumps(star, kernel))
    if share >= _density(LOWEST):
        return LOWEST
    return float(scipy.optimize.brentq(lambda z: math.log(_density(z) / share), LOWEST, HIGHEST))


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
