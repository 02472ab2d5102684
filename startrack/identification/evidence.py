"""A match enters; a bound on the probability that chance alone makes such a match leaves.

By chance, spots lie anywhere in the image: n of them, each with the density 1 / A. If the
hypothesis is true, each predicted star j is seen with a probability p_j, displaced by Gaussian
noise of variance v, and the rest of the spots is clutter. The ratio of the two likelihoods, for
k matches, with c the clutter to expect, is

    L = e^(n - c) (c / n)^(n - k)  prod_matched (p_j A / n) N(d; v)  prod_missed (1 - p_j)

and, averaged over all attitudes and focal lengths that there may be (Laplace's method, H being
the information matrix and d its size),

    B = L prior(attitude, focal length) (2 pi)^(d / 2) det(H)^(-1/2)

The mean of B over chance is one, so that chance exceeds 1 / P with a probability of P at most
(Markov's inequality): no hypotheses need to be counted, and by Neyman and Pearson's lemma no
other test finds more at the same P, as far as the model holds. How deep the camera sees and how
far the believed distortion is wrong are not known: B is averaged over a few values of each, too.

Source: Laplace's method for Bayes factors: Kass & Raftery (1995), J. Am. Stat. Assoc. 90, 773.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.values import Floats

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
