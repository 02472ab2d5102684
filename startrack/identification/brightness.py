"""The brightness of spots and stars enters; how much it speaks for their match leaves.

The flux of a star is known but for the camera's zero point z, its own noise, and what the
passband does to stars of another colour, together of variance v. By chance a spot is as bright
as the spots of this image are, with the density q. For spots of magnitude m and stars of
magnitude M the ratio of both likelihoods is

    R = mean over z  prod_matched ((1 - w) N(m - M - z; v) / q(m) + w)

where the share w of stars, being variable, blended or saturated, may be as bright as any spot.
Fluxes that are worth nothing, as those of a saturated photograph, are as likely beforehand as
good ones, so that (1 + R) / 2 is the factor.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.values import Floats

WILD = 0.1  # w
ZERO_POINTS = np.arange(-2.1, 2.11, 0.3)  # magnitude, about what all spots and stars suggest
LEAST_SPREAD = 0.5  # magnitude, of q


@njit(cache=True, error_model="numpy")
def log_brightness(
    magnitude: Floats,
    spot_blur: Floats,
    expected: Floats,
    star_blur: Floats,
    spot: NDArray[np.int64],
    star: NDArray[np.int64],
) -> float:  # pragma: no cover
    """ln of the factor above.

    magnitude  (n,) of all spots, NaN where unknown: such a spot counts as wild
    spot_blur  (k,) standard deviation of those matched
    expected   (m,) magnitudes of all stars that the image should hold
    star_blur  (k,) of those matched
    spot       (k,) which spot
    star       (k,) is which star
    """
    known = magnitude[np.isfinite(magnitude)]
    if len(known) < 2:
        return 0.0
    centre, spread = np.mean(known), max(float(np.std(known)), LEAST_SPREAD)
    reach = np.max(known) - np.min(known) + 1.0
    seen = np.sort(expected)[: len(magnitude)]
    shift = np.median(known) - np.median(seen)
    product = np.ones(len(ZERO_POINTS))
    for i in range(len(spot)):
        m = magnitude[spot[i]]
        if not math.isfinite(m) or not math.isfinite(spot_blur[i]):
            continue
        # Heavy tails: a spot brighter than all others is no wonder.
        chance = 0.5 * _normal(m - centre, spread**2) + 0.5 / reach
        variance = spot_blur[i] ** 2 + star_blur[i] ** 2
        for z in range(len(ZERO_POINTS)):
            away = m - expected[star[i]] - shift - ZERO_POINTS[z]
            product[z] *= (1 - WILD) * _normal(away, variance) / chance + WILD
    return math.log((1 + np.mean(product)) / 2)


@njit(cache=True, error_model="numpy")
def _normal(away: float, variance: float) -> float:  # pragma: no cover
    return math.exp(-0.5 * away * away / variance) / math.sqrt(2 * math.pi * variance)
