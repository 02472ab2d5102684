"""Sample and Psf -> a row per star, by each of the centroid methods that a design can name.

A new method is a file with a function of a Sample, and one line in `CENTROIDS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from startrack.core import Floats, Psf
from startrack.detection.fit import gaussian, likelihood
from startrack.detection.gravity import gravity
from startrack.detection.s_curve import compensate, s_curve
from startrack.detection.sample import Sample
from startrack.detection.weighted import weighted

NARROWEST_WEIGHT = 1.0  # pixel


def compensated_gravity(stars: Sample, psf: Psf, sigma: float, compensation: str) -> Floats:
    """Centre of gravity, corrected for what its window cuts off and what pixels average."""
    table = gravity(stars, uncut=compensation == "gaussian")
    if compensation == "psf":
        compensate(table, s_curve(psf, stars.half))
    return table


def widened_weight(stars: Sample, psf: Psf, sigma: float, compensation: str) -> Floats:
    """Centre of gravity under a Gaussian weight of the width that the pixels give the star."""
    # Pixels widen a star by their own variance, and show in a narrower weight.
    seen = math.hypot(sigma, 1 / math.sqrt(12))
    return weighted(stars, max(seen, NARROWEST_WEIGHT))


# By the value of the key `centroid`. Each takes the Sample, the PSF that the tracker assumes,
# kernel_sigma in pixel and the value of the key `compensation`; it returns rows as `gravity` does.
CENTROIDS: Mapping[str, Callable[[Sample, Psf, float, str], Floats]] = {
    "gravity": compensated_gravity,
    "weighted": widened_weight,
    "gaussian": lambda stars, psf, sigma, compensation: gaussian(stars, sigma),
    "likelihood": lambda stars, psf, sigma, compensation: likelihood(stars, psf),
}
