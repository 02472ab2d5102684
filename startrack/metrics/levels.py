"""Size of the error that is not exceeded at a stated confidence level."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import StrEnum
from functools import lru_cache

import numpy as np
import scipy

from startrack.core import Floats, Refused
from startrack.metrics.summary import Interval

# The usual confidence levels of specifications: 1, 2 and 3 sigma of a normal error.
LEVELS: tuple[float, ...] = (0.68, 0.9545, 0.9973)


class Interpretation(StrEnum):
    """What the fraction of a confidence level counts (ECSS-E-ST-60-10C, 4.2.1).

    temporal  times, for the worst member of the ensemble
    ensemble  members of the ensemble, at the worst time
    mixed     members and times together, drawn at random
    """

    TEMPORAL = "temporal"
    ENSEMBLE = "ensemble"
    MIXED = "mixed"


def level(error: Floats, fraction: float, interpretation: Interpretation) -> float:
    """Size of the error that is not exceeded in a fraction of the cases.

    error     (members, times) of one axis
    fraction  in (0, 1)
    Returns   in the error's unit
    Raises    ValueError where the fraction is not in (0, 1) or there is no error.
    Accuracy  statistical: the worst of few members or times is too small; `level_interval` gives
              the interval of the mixed interpretation.
    """
    size = _sizes(error, fraction)
    if interpretation is Interpretation.TEMPORAL:
        return float(np.quantile(size, fraction, axis=1).max())
    if interpretation is Interpretation.ENSEMBLE:
        return float(np.quantile(size, fraction, axis=0).max())
    return float(np.quantile(size, fraction))


def level_interval(error: Floats, fraction: float, confidence: float = 0.95) -> Interval:
    """Level of independent errors with a distribution-free interval.

    Of n errors, the number below the true level is binomial, so that two of the sorted errors
    bound the level.
    Source: Conover (1999), Practical Nonparametric Statistics, 3.2.

    error       (n,) independent errors of one axis
    fraction    in (0, 1)
    confidence  in (0, 1), lower limit of that of the interval; the upper bound alone has
                (1 + confidence) / 2
    Returns     Interval; without an upper bound where there are too few errors
    Raises      ValueError where the fraction is not in (0, 1) or there is no error.
    """
    size = np.sort(_sizes(np.atleast_2d(error), fraction)[0])
    low, high = _ranks(len(size), fraction, (1 - confidence) / 2)
    return Interval(
        float(np.quantile(size, fraction)),
        float(size[low - 1]) if low > 0 else 0.0,
        float(size[high - 1]) if high <= len(size) else math.inf,
    )


@lru_cache
def _ranks(n: int, fraction: float, tail: float) -> tuple[int, int]:
    """Which of n sorted errors, counted from one, bound a level; 0 and n + 1 are none."""
    low = int(scipy.stats.binom.ppf(tail, n, fraction))  # at least so many lie below the level
    return low, int(scipy.stats.binom.isf(tail, n, fraction)) + 1


def quantile_of_few(values: Floats, fraction: float) -> Floats:
    """Quantile over the last axis of values (..., n), a smooth function of all of them.

        Q = sum_i w_i x_(i),   w_i = I_(i/n)(a, b) - I_((i-1)/n)(a, b),
        a = fraction (n + 1),   b = (1 - fraction) (n + 1)

    with the sorted values x_(i) and the regularised incomplete beta function I. Of few values it
    scatters less than the nearest of them, and it has no steps.

    Source: Harrell and Davis (1982), Biometrika 69, 635.

    fraction  in (0, 1)
    Accuracy  statistical: of n values, a fraction beyond 1 - 1 / n is hardly more than the largest.
    """
    _proper(fraction)
    n = values.shape[-1]
    ends = scipy.special.betainc(
        fraction * (n + 1), (1 - fraction) * (n + 1), np.linspace(0, 1, n + 1)
    )
    weight = np.diff(ends)
    ordered = np.sort(values, axis=-1)
    # A value that is infinite counts only where it has a weight.
    return np.asarray(np.where(weight > 0, ordered, 0.0) @ weight)


def fewest_trials(fraction: float, confidence: float) -> int:
    """Fewest trials whose largest error is an upper bound of a level.

        n >= log(1 - confidence) / log(fraction)

    Source: Wilks (1941), Ann. Math. Statist. 12, 91.

    >>> fewest_trials(0.95, 0.95)
    59
    """
    _proper(fraction)
    _proper(confidence)
    return math.ceil(math.log1p(-confidence) / math.log(fraction))


def levels(error: Floats, fractions: Sequence[float] = LEVELS) -> tuple[Interval, ...]:
    """Levels of independent errors (n,) of one axis, each with its 95 % interval."""
    return tuple(level_interval(error, fraction) for fraction in fractions)


def _sizes(error: Floats, fraction: float) -> Floats:
    _proper(fraction)
    if error.ndim != 2 or error.size == 0:
        raise Refused(f"error must have members and times, got shape {error.shape}")
    return np.abs(error)


def _proper(fraction: float) -> None:
    if not 0 < fraction < 1:
        raise Refused(f"fraction and confidence must lie in (0, 1), got {fraction}")
