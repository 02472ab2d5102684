"""The log-evidence for a match, from positions and from brightness."""

import math

import numpy as np

from startrack.core import Floats, Ints, kernel, median, order
from startrack.identification.fit import cholesky

# Priors, chosen by hand. experiments/identification.py shows the success and the false solutions
# with them, but does not vary them.
OUTLIER_FRACTION = 0.1  # w: a larger one admits more variable and blended stars, a smaller decides
ZERO_POINTS = np.arange(-2.1, 2.11, 0.3)  # z, magnitude, about the difference of the medians
LEAST_SPREAD = 0.5  # magnitude, of q: spots of nearly equal brightness are weak evidence


@kernel
def log_brightness(
    magnitude: Floats,
    spot_blur: Floats,
    expected: Floats,
    star_blur: Floats,
    spot: Ints,
    star: Ints,
) -> float:
    """ln of the likelihood ratio of the brightness of matched spots, match over chance.

        R = mean over z  prod_matched ((1 - w) N(m - M - z; v) / q(m) + w),   ln((1 + R) / 2)

    for spots of magnitude m and stars of magnitude M. The flux of a star is known except for the
    camera's zero point z and for errors of variance v, by noise and by the passband for stars of
    other colours. In a chance match, the brightness of a spot is random, with the density q of the
    spots in this image. So is the brightness of a fraction w of the stars (variable, blended,
    saturated). Fluxes may also be useless, as in saturated photographs; this case has prior
    probability 1/2.

    magnitude  (n,) magnitudes of all spots; NaN if unknown: such a match has the factor 1
    spot_blur  (k,) magnitude, standard deviation of matched spots
    expected   (m,) magnitudes of all stars that the image should contain
    star_blur  (k,) magnitude, standard deviation of matched stars
    spot       (k,) indices into `magnitude` of the matches
    star       (k,) indices into `expected` of the matches
    """
    finite, n = np.empty(len(magnitude)), 0
    for i in range(len(magnitude)):
        if math.isfinite(magnitude[i]):
            finite[n] = magnitude[i]
            n += 1
    if n < 2:
        return 0.0
    finite = finite[:n]
    centre = _mean(finite)
    faintest, brightest, squares = finite[0], finite[0], 0.0
    for i in range(n):
        faintest, brightest = max(faintest, finite[i]), min(brightest, finite[i])
        squares += (finite[i] - centre) ** 2
    spread = max(math.sqrt(squares / n), LEAST_SPREAD)
    span = faintest - brightest + 1.0
    brightest_stars = order(expected)[: len(magnitude)]
    shift = median(finite) - median(expected[brightest_stars])
    product = np.empty(len(ZERO_POINTS))
    for z in range(len(ZERO_POINTS)):
        product[z] = 1.0
    for i in range(len(spot)):
        m = magnitude[spot[i]]
        if not math.isfinite(m) or not math.isfinite(spot_blur[i]):
            continue
        # A uniform part for heavy tails: one spot may be far brighter than all others.
        chance = 0.5 * _normal(m - centre, spread**2) + 0.5 / span
        variance = spot_blur[i] ** 2 + star_blur[i] ** 2
        for z in range(len(ZERO_POINTS)):
            difference = m - expected[star[i]] - shift - ZERO_POINTS[z]
            numerator = (1 - OUTLIER_FRACTION) * _normal(difference, variance)
            product[z] *= numerator / chance + OUTLIER_FRACTION
    return math.log((1 + _mean(product)) / 2)


@kernel
def _mean(values: Floats) -> float:
    total = 0.0
    for value in values:
        total += value
    return total / len(values)


@kernel
def _normal(difference: float, variance: float) -> float:
    return math.exp(-0.5 * difference * difference / variance) / math.sqrt(2 * math.pi * variance)


# Priors, chosen by hand. experiments/identification.py shows the success and the false solutions
# with them, but does not vary them. More values take more time; fewer values fit fewer cameras.
DEPTHS = np.array([4, 6, 9, 14, 20, 28, 40])  # number of the brightest stars that a camera detects
# Probability to detect a star whose rank in brightness is up to this depth, up to twice the depth,
# and beyond.
SEEN_BRIGHT, SEEN_FAINT, SEEN_DEEP = 0.85, 0.2, 0.01
EXCESSES = np.array([0.0, 1 / 16, 1 / 4])  # sigma of errors beyond the noise, over the match radius
LOG_ATTITUDES = math.log(8 * math.pi**2)  # volume of all rotations, radian^3


@kernel
def log_evidence(
    square: Floats,
    variance: Floats,
    brighter: Ints,
    rows: Floats,
    prior: Floats,
    log_prior: float,
    spots: int,
    stars: int,
    area: float,
    radius: float,
) -> float:
    """ln of the Bayes factor of a match over chance, from the positions of the spots.

        L = e^(n - c) (c / n)^(n - k) min(sqrt(s / n), 1)
            prod_matched (p_j A / n) N(d; v)  prod_missed (1 - p_j)
        B = L prior(unknowns) (2 pi)^(d / 2) det(H)^(-1/2)

    In a chance match, n spots lie anywhere in the image, each with the density 1 / A. Under the
    hypothesis, each predicted star j is detected with a probability p_j, and displaced by Gaussian
    noise of variance v. In addition c false spots are expected; s is the variance of the number of
    spots. L is the likelihood ratio for k matches. B is its integral over attitude and focal length
    (Laplace's method, H the information matrix, d its size), averaged over a few depths to which
    the camera may detect stars and a few errors of the believed distortion.

    The mean of B over chance matches is 1. Therefore B exceeds 1 / P with a probability of at most
    P (Markov's inequality), whatever the number of hypotheses. By the Neyman-Pearson lemma, no
    other test finds more at the same P, if the model holds.

    Source: Laplace's method for Bayes factors: Kass and Raftery (1995), J. Am. Stat. Assoc. 90,
    773.

    square     (k,) squared distances of the matches, in the image plane
    variance   (k,) variance of the spots' noise along each axis, in the same unit squared
    brighter   (k,) number of brighter stars that the image should contain
    rows       (k, 2, d) derivatives of the positions by the unknowns
    prior      (d, d) prior information on the unknowns
    log_prior  ln of the prior density of the unknowns at their solution
    spots      n
    stars      number of stars predicted in the image
    area       A
    radius     1, match radius in the image plane, without its part for noise
    """
    unknowns = len(prior)
    information = np.empty((unknowns, unknowns))
    near_all = np.empty(len(EXCESSES))
    for e, excess in enumerate(EXCESSES):
        near = 0.0
        for a in range(unknowns):
            for b in range(unknowns):
                information[a, b] = prior[a, b]
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


@kernel
def _log_mean(logarithm: Floats) -> float:
    """ln of the mean of numbers whose logarithms are given."""
    most, total = -np.inf, 0.0
    for value in logarithm:
        most = max(most, value)
    for value in logarithm:
        total += math.exp(value - most)
    return most + math.log(total / len(logarithm))


@kernel
def _log_seen(brighter: Ints, depth: int, spots: int, stars: int) -> float:
    """ln of the factors of L by detected and missed stars, given the depth of the camera."""
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
    clutter = max(spots - SEEN_BRIGHT * bright - SEEN_FAINT * faint - SEEN_DEEP * deep, 1.0)
    # The number of spots is given. With fewer false spots its variance is smaller, and the
    # probability
    # of just this number is larger.
    spread = (
        clutter + SEEN_BRIGHT * (1 - SEEN_BRIGHT) * bright + SEEN_FAINT * (1 - SEEN_FAINT) * faint
    )
    return (
        0.5 * min(math.log(spread / spots), 0.0)
        + spots
        - clutter
        + (spots - len(brighter)) * math.log(clutter / spots)
        + _log_found(found_bright, bright, SEEN_BRIGHT)
        + _log_found(found_faint, faint, SEEN_FAINT)
        + _log_found(found_deep, deep, SEEN_DEEP)
    )


@kernel
def _log_determinant(matrix: Floats) -> float:
    """ln det of a positive definite matrix from its lower half, which is overwritten."""
    cholesky(matrix, len(matrix))
    total = 0.0
    for j in range(len(matrix)):
        total += 2 * math.log(matrix[j, j])
    return total


@kernel
def _log_found(seen: int, of: int, p: float) -> float:
    """ln of the probability that just these stars are detected, each with a probability p."""
    return seen * math.log(p) + (of - seen) * math.log(1 - p)
