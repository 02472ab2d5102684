"""A match enters; the log-evidence for it leaves, by positions and by brightness."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.core import Floats

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


DEPTHS = np.array([4, 6, 9, 14, 20, 28, 40])  # how many stars of an image the camera may see
# Probability to see a star up to this depth, up to twice of it, and deeper.
SEEN, GLIMPSED, UNSEEN = 0.85, 0.2, 0.01
EXCESSES = np.array([0.0, 1 / 16, 1 / 4])  # of the match radius: what noise does not explain
LOG_ATTITUDES = math.log(8 * math.pi**2)  # volume of all rotations, radian^3


@njit(cache=True, error_model="numpy")
def log_evidence(
    square: Floats,
    variance: Floats,
    brighter: NDArray[np.int64],
    rows: Floats,
    prior: Floats,
    log_prior: float,
    spots: int,
    stars: int,
    area: float,
    radius: float,
) -> float:  # pragma: no cover
    """ln B of the equation above.

    square     (k,) squared distances of the matches, in the image plane
    variance   (k,) of the spots' noise along each axis, in the same units
    brighter   (k,) how many brighter stars the image should hold
    rows       (k, 2, d) derivatives of the places by the unknowns
    prior      (d, d) information on the unknowns beforehand
    log_prior  ln of the prior density of the unknowns, at the place found
    spots      n
    stars      how many stars are predicted in the image
    area       A
    radius     up to which matches are taken
    """
    unknowns = len(prior)
    information = np.empty((unknowns, unknowns))
    near_all = np.empty(len(EXCESSES))
    for e, excess in enumerate(EXCESSES):
        near = 0.0
        information[:] = prior
        for i in range(len(square)):
            v = variance[i] + (excess * radius) ** 2
            near += math.log(area / (2 * math.pi * v * spots)) - square[i] / (2 * v)
            for a in range(unknowns):
                for b in range(a + 1):
                    product = rows[i, 0, a] * rows[i, 0, b] + rows[i, 1, a] * rows[i, 1, b]
                    information[a, b] += product / v
        near_all[e] = near - 0.5 * _log_determinant(information)
    seen_all = np.empty(len(DEPTHS))
    for i in range(len(DEPTHS)):
        seen_all[i] = _log_seen(brighter, DEPTHS[i], spots, stars)
    laplace = log_prior + 0.5 * unknowns * math.log(2 * math.pi)
    return _log_mean(near_all) + _log_mean(seen_all) + laplace


@njit(cache=True, error_model="numpy")
def _log_mean(logarithm: Floats) -> float:  # pragma: no cover
    """ln of the mean of numbers whose logarithms are given."""
    most = np.max(logarithm)
    return most + math.log(np.mean(np.exp(logarithm - most)))


@njit(cache=True, error_model="numpy")
def _log_seen(
    brighter: NDArray[np.int64], depth: int, spots: int, stars: int
) -> float:  # pragma: no cover
    """ln of the factors of L that say which stars are seen, if the camera sees to this depth."""
    bright = min(stars, depth)
    faint = min(stars, 2 * depth) - bright
    deep = stars - bright - faint
    found_bright, found_faint, found_deep = 0, 0, 0
    for b in brighter:
        if b < depth:
            found_bright += 1
        elif b < 2 * depth:
            found_faint += 1
        else:
            found_deep += 1
    clutter = max(spots - SEEN * bright - GLIMPSED * faint - UNSEEN * deep, 1.0)
    # The number of spots is given, and likelier to be just this where fewer of them are clutter.
    spread = clutter + SEEN * (1 - SEEN) * bright + GLIMPSED * (1 - GLIMPSED) * faint
    return (
        0.5 * min(math.log(spread / spots), 0.0)
        + spots
        - clutter
        + (spots - len(brighter)) * math.log(clutter / spots)
        + _log_found(found_bright, bright, SEEN)
        + _log_found(found_faint, faint, GLIMPSED)
        + _log_found(found_deep, deep, UNSEEN)
    )


@njit(cache=True, error_model="numpy")
def _log_determinant(matrix: Floats) -> float:  # pragma: no cover
    """ln det of a positive matrix, of which the lower half is given and is used up (Cholesky)."""
    total = 0.0
    for j in range(len(matrix)):
        for k in range(j + 1):
            rest = matrix[j, k]
            for i in range(k):
                rest -= matrix[j, i] * matrix[k, i]
            matrix[j, k] = math.sqrt(rest) if j == k else rest / matrix[k, k]
        total += 2 * math.log(matrix[j, j])
    return total


@njit(cache=True, error_model="numpy")
def _log_found(found: int, of: int, p: float) -> float:  # pragma: no cover
    """ln of the probability that these stars, each seen with a probability p, are the seen ones."""
    return found * math.log(p) + (of - found) * math.log(1 - p)
