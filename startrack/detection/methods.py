"""Centroid methods: each from a Sample and a StarModel to a row per star.

A new method is a file with a function of a Sample, and one entry in `CENTROIDS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from startrack.core import Floats
from startrack.detection.fit import gaussian, likelihood
from startrack.detection.gravity import gravity
from startrack.detection.s_curve import compensate
from startrack.detection.sample import Sample
from startrack.detection.star_model import StarModel
from startrack.detection.weighted import weighted

NARROWEST_WEIGHT = 1.0  # pixel
WIDEST = 6  # pixel, half side; light farther out moves no centroid


class CentroidMethod(NamedTuple):
    """A centroid method, and which pixels it uses. A window is given by half its side, pixel.

    measure     Sample, StarModel, kernel_sigma in pixel, compensation -> rows as `gravity`
    reads       half of the key `window`, kernel_sigma, StarModel -> half side of what it reads
    moved_by    the same of the pixels that are varied to compute its response to noise
    skips_dead  whether it leaves dead pixels out; else a star with one beside its peak is dropped
    place       as `measure`, without the covariance, where that is faster; None: as `measure`
    """

    measure: Callable[[Sample, StarModel, float, str], Floats]
    reads: Callable[[int, float, StarModel], int]
    moved_by: Callable[[int, float, StarModel], int]
    skips_dead: bool = False
    place: Callable[[Sample, StarModel, float, str], Floats] | None = None


def compensated_gravity(stars: Sample, star: StarModel, sigma: float, compensation: str) -> Floats:
    """Centre of gravity, corrected for what its window cuts off and what pixels average."""
    table = gravity(stars, uncut=compensation == "gaussian")
    if compensation == "psf":
        compensate(table, star.s_curve)
    return table


def widened_weight(stars: Sample, star: StarModel, sigma: float, compensation: str) -> Floats:
    """Centre of gravity under a Gaussian weight of the width that the pixels give the star."""
    # Pixels widen a star by their own variance, and show in a narrower weight.
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
