"""Detection -> how many false spots to expect in a frame of nothing but noise, and back."""

from __future__ import annotations

import math
from functools import lru_cache

from scipy.optimize import brentq

from startrack.detection.matched import Kernel, kernel_of
from startrack.detection.parameters import Detection
from startrack.detection.smear import star_image
from startrack.values import Psf

LOWEST, HIGHEST = 1.5, 12.0  # sigma; the density falls from 1 on, and nothing passes 12


def false_alarms(settings: Detection, columns: int, rows: int, psf: Psf | None = None) -> float:
    """Expected number of noise peaks that pass the threshold.

        n = area Lambda^(1/2) (2 pi)^(-3/2) z exp(-z^2 / 2)

    z is the threshold, Lambda the determinant of the covariance of the filtered noise's slopes
    over its variance, here from the kernel's differences.

    Source: Adler (1981), The geometry of random fields, theorem 6.9.3.

    Returns  1, per frame
    Errors   model: holds for thresholds from 4 on, within a factor of 1.5, as a tile does not
             know its noise exactly.
    """
    kernel = kernel_of(settings, star_image(settings, psf))
    area = columns * rows
    return area * _bumps(kernel) * _density(threshold_over(settings, area, kernel))


def threshold_of(settings: Detection, columns: int, rows: int, psf: Psf | None = None) -> float:
    """Sigma of normal noise that a spot must exceed in a frame, as `false_alarms` takes it."""
    return threshold_over(settings, columns * rows, kernel_of(settings, star_image(settings, psf)))


def threshold_over(settings: Detection, area: int, kernel: Kernel) -> float:
    """The same for an area of pixels and a kernel: the setting, or what allows as many false."""
    if settings.false_per_frame is None:
        return settings.threshold
    return _threshold(settings.false_per_frame, area, kernel)


@lru_cache(maxsize=64)
def _threshold(wanted: float, area: int, kernel: Kernel) -> float:
    share = wanted / (area * _bumps(kernel))
    if share >= _density(LOWEST):
        return LOWEST
    return float(brentq(lambda z: math.log(_density(z) / share), LOWEST, HIGHEST))


def _density(z: float) -> float:
    return (2 * math.pi) ** -1.5 * z * math.exp(-z * z / 2)


@lru_cache(maxsize=64)
def _bumps(kernel: Kernel) -> float:
    """Lambda^(1/2): bumps of the filtered noise per pixel."""
    whole = kernel.whole.astype(float)
    slope = 1.0
    for axis in (0, 1):
        # The slope's variance from the correlation of neighbours, for a bell-shaped correlation.
        ahead = whole[1:] if axis == 0 else whole[:, 1:]
        behind = whole[:-1] if axis == 0 else whole[:, :-1]
        slope *= -2 * math.log(float((ahead * behind).sum() / (whole**2).sum()))
    return math.sqrt(slope)
