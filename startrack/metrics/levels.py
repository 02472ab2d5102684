"""Errors of many trials and times -> the size not exceeded at a stated confidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import StrEnum

import numpy as np
import scipy

from startrack.core import Floats
from startrack.metrics.summary import Interval

# What specifications ask for: 1, 2 and 3 sigma of a normal error.
LEVELS: tuple[float, ...] = (0.68, 0.9545, 0.9973)


class Interpretation(StrEnum):
    """What a level is a fraction of (ECSS-E-ST-60-10C, 4.2.1).

    temporal  of the time, for the worst member of the ensemble
    ensemble  of the ensemble, at the worst time
    mixed     of both at random
    """

    TEMPORAL = "temporal"
    ENSEMBLE = "ensemble"
    MIXED = "mixed"


def level(error: Floats, fraction: float, interpretation: Interpretation) -> float:
    """Size of the error that is not exceeded in a fraction of the cases.

    error    (members, times) of one axis
    fraction  in (0, 1)
    Returns  in the error's unit
    Raises    ValueError where the fraction is not in (0, 1) or there is no error.
    Accuracy  statistical: the worst of few members or times underestimates; `level_interval` gives
              the uncertainty of the mixed interpretation.
    """
    size = _sizes(error, fraction)
    if interpretation is Interpretation.TEMPORAL:
        return float(np.quantile(size, fraction, axis=1).max())
    if interpretation is Interpretation.ENSEMBLE:
        return float(np.quantile(size, fraction, axis=0).max())
    return float(np.quantile(size, fraction))


def level_interval(error: Floats, fraction: float, confidence: float = 0.95) -> Interval:
    """Level of independent errors with an interval that holds whatever their law.

    The number of n errors below the true level is binomial; so two of the sorted errors bound it.
    Source: Conover (1999), Practical Nonparametric Statistics, 3.2.

    error       (n,) independent errors of one axis
    fraction    in (0, 1)
    confidence  in (0, 1), at least; that of the upper bound alone is (1 + confidence) / 2
    Returns     Interval; without an upper bound where there are too few errors
    Raises      ValueError as in `level`.
    """
    size = np.sort(_sizes(np.atleast_2d(error), fraction)[0])
    n, tail = len(size), (1 - confidence) / 2
    low = int(scipy.stats.binom.ppf(tail, n, fraction))  # that many lie below, or more
    high = int(scipy.stats.binom.isf(tail, n, fraction)) + 1
    return Interval(
        float(np.quantile(size, fraction)),
        float(size[low - 1]) if low > 0 else 0.0,
        float(size[high - 1]) if high <= n else math.inf,
    )


def fewest_trials(fraction: float, confidence: float) -> int:
    """How many trials the largest error needs to bound a level from above.

    n >= log(1 - confidence) / log(share)   (Wilks 1941, Ann. Math. Statist. 12, 91)

    >>> fewest_trials(0.95, 0.95)
    59
    """
    _proper(fraction)
    _proper(confidence)
    return math.ceil(math.log1p(-confidence) / math.log(fraction))


def levels(error: Floats, fractions: Sequence[float] = LEVELS) -> tuple[Interval, ...]:
    """The levels of independent errors (n,) of one axis that specifications ask for."""
    return tuple(level_interval(error, fraction) for fraction in fractions)


def _sizes(error: Floats, fraction: float) -> Floats:
    _proper(fraction)
    if error.ndim != 2 or error.size == 0:
        raise ValueError(f"error must have members and times, got shape {error.shape}")
    return np.abs(error)


def _proper(fraction: float) -> None:
    if not 0 < fraction < 1:
        raise ValueError(f"share and confidence must lie in (0, 1), got {fraction}")
