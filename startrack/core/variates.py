"""Random variates for compiled code: bits of a counter, normal and Poisson quantiles."""

import math

import numpy as np
from scipy import special

from startrack.core.kernel import kernel

GOLDEN = np.uint64(0x9E3779B97F4A7C15)  # odd, next to 2^64 over the golden ratio
FIRST = np.uint64(0xBF58476D1CE4E5B9)
SECOND = np.uint64(0x94D049BB133111EB)
UNIT = 2.0**-53


@kernel(inline="always")
def bits(start, pixel):  # type: ignore[no-untyped-def]
    """64 random bits of a pixel.

    start  key as uint64
    pixel  number as uint64
    """
    return mixed(start + GOLDEN * (pixel + np.uint64(1)))


@kernel(inline="always")
def mixed(z):  # type: ignore[no-untyped-def]
    """64 random bits of a state, which grows by GOLDEN from one pixel to the next.

    Source: Steele, Lea and Flood (2014), Fast splittable pseudorandom number generators,
    OOPSLA, with the constants of Stafford's mix 13; it passes BigCrush.
    """
    z = (z ^ (z >> np.uint64(30))) * FIRST
    z = (z ^ (z >> np.uint64(27))) * SECOND
    return z ^ (z >> np.uint64(31))


@kernel(inline="always")
def uniform(random):  # type: ignore[no-untyped-def]
    """A number in (0, 1) from random bits: the middle of one of 2^52 cells; 1 minus it is exact."""
    return (np.float64(np.int64(random >> np.uint64(12))) + 0.5) * (2 * UNIT)


CELLS = 128  # per factor of two in the probability, so that the tail is as exact as the middle
SMALLEST = -56  # power of two
_node = np.arange((1 - SMALLEST) * CELLS + 1)
_power, _step = SMALLEST + _node // CELLS, _node % CELLS
_share = np.ldexp((CELLS + _step) / (2 * CELLS), _power)
_quantile = special.ndtri(np.minimum(_share, 0.75))
_slope = math.sqrt(2 * math.pi) * np.exp(_quantile**2 / 2)
# The interpolation data of each cell are contiguous: one access to distant memory.
_rise = np.diff(_quantile)
_left = _slope[:-1] * np.ldexp(0.5 / CELLS, _power[:-1]) - _rise
_right = _rise - _slope[1:] * np.diff(_share)
HERMITE = np.column_stack([_quantile[:-1], _rise, _left, _right])


@kernel
def inverse_normal(probability: float) -> float:
    """Phi^-1(probability), by cubic Hermite interpolation.

    probability  1, in [2^-54, 1 - 2^-54]
    Accuracy     numerical: 1e-10.
    """
    nearer = probability if probability <= 0.5 else 1.0 - probability
    mantissa, power = math.frexp(nearer)
    at = (mantissa - 0.5) * (2 * CELLS)
    i = int(at)
    t = at - i
    i += (power - SMALLEST) * CELLS
    start, rise, left, right = HERMITE[i, 0], HERMITE[i, 1], HERMITE[i, 2], HERMITE[i, 3]
    below = start + t * (rise + (1 - t) * (left * (1 - t) + right * t))
    return below if probability <= 0.5 else -below


SMALL = 3.0  # mean below which the distribution is summed from zero
UNSURE = 0.25  # error of the expansion above which only sums decide; chosen by hand: time alone
LARGEST_PROBABILITY = 1 - 1e-5  # above it, the sum from zero loses digits of the tail
FARTHEST = 8.2  # standard deviations; beyond, a double rounds the probability to one

# Cubic Hermite table of the normal distribution: 1e-13 of probability in 3 ns instead of 30.
STEPS = 512  # per standard deviation
NODES = np.arange(-9 * STEPS, 9 * STEPS + 1) / STEPS
PHI = special.ndtr(NODES)
SLOPE = np.exp(-(NODES**2) / 2) / math.sqrt(2 * math.pi) / STEPS
INVERSE = 1 / np.maximum(np.arange(200.0), 1.0)
LOG_FACTORIAL = special.gammaln(np.arange(200.0) + 1)


@kernel
def poisson_quantile(mean: float, normal: float) -> float:
    """The Poisson number that has the same cumulative probability as a standard normal one.

        n = min { n : P(N <= n) >= Phi(normal) }

    The expansion gives the quantile x of the continuous distribution Q(x, mean), whose whole
    part is the answer; if x is close to a whole number, the sum of probabilities decides.

    Source: the expansion is that of Giles (2016), ACM TOMS 42(1), 7, Algorithm 955, eq. for the
    normal asymptotic; the decision near whole numbers is exact.

    mean      expectation; zero or less gives zero
    Accuracy  numerical: exact within 7 standard deviations up to a mean of 1e5; beyond either,
              sometimes off by one. Beyond 8.2 standard deviations (probability 2e-16) it is
              clipped.
    """
    if mean <= 0.0:
        return 0.0
    w = min(max(normal, -FARTHEST), FARTHEST)
    square = w * w
    doubt = 1.5 * (1 / 40 + square / 80 + square * square / 160) / mean
    if mean < SMALL or doubt > UNSURE:
        return _from_zero(mean, w)
    root = math.sqrt(mean)
    x = (
        mean
        + root * w
        + (1 / 3 + square / 6)
        - w * (1 / 36 + square / 72) / root
        + (-8 / 405 + square * (7 / 810 + square / 270)) / mean
    )
    below = math.floor(x)
    if x - below > doubt and below + 1 - x > doubt:
        return max(below, 0.0)
    nearest = math.floor(x + 0.5)  # the answer is this or the number before
    if nearest < 1:
        return 0.0
    return nearest if _exceeds(mean, nearest - 1.0, w) else nearest - 1.0


@kernel
def _from_zero(mean: float, w: float) -> float:
    """Quantile by the sum of probabilities from zero, or of the upper tail where it is smaller."""
    if w < 4.0:
        target = _phi(w)
        probability = math.exp(-mean)
        total, k = probability, 0
        while total < target:
            k += 1
            probability *= mean * INVERSE[k]
            total += probability
        return float(k)
    number = float(math.floor(mean))
    while _exceeds(mean, number, w):
        number += 1.0
    return number


@kernel
def _phi(w: float) -> float:
    at = (w + 9.0) * STEPS
    i = int(at)
    t = at - i
    rise = PHI[i + 1] - PHI[i]
    left, right = SLOPE[i] - rise, rise - SLOPE[i + 1]
    return PHI[i] + t * (rise + (1 - t) * (left * (1 - t) + right * t))


@kernel
def _exceeds(mean: float, k: float, w: float) -> bool:
    """Whether the quantile lies above k: P(N <= k) < Phi(w), compared in the smaller tail."""
    if w < 0:
        term = _probability(mean, k)
        total, i = term, k
        while i > 0 and term > 1e-17 * total:
            term *= i / mean
            total += term
            i -= 1
        return total < 0.5 * math.erfc(-w / math.sqrt(2.0))
    i = k + 1
    term = _probability(mean, i)
    total = term
    while term > 1e-17 * total:
        i += 1
        term *= mean / i
        total += term
    return total > 0.5 * math.erfc(w / math.sqrt(2.0))


@kernel
def _probability(mean: float, k: float) -> float:
    """P(N = k)."""
    n = int(k)
    log_factorial = LOG_FACTORIAL[n] if n < 200 else math.lgamma(k + 1)
    return math.exp(k * math.log(mean) - mean - log_factorial)


@kernel
def poisson_of_uniform(mean: float, uniform_number: float) -> float:
    """The Poisson number of a uniform number in (0, 1): the quantile of that probability."""
    if mean >= SMALL or uniform_number > LARGEST_PROBABILITY:
        return poisson_quantile(mean, inverse_normal(uniform_number))
    term = math.exp(-mean) if mean > 0.0 else 1.0
    total, k = term, 0
    while total < uniform_number:
        k += 1
        term *= mean * INVERSE[k]
        total += term
    return float(k)
