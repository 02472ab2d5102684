"""Size of the error that is not exceeded at a confidence level, and the error indices of ECSS."""

import math
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache

import numpy as np
import scipy

from startrack.core import Floats, Refused, positive
from startrack.metrics.summary import Interval

# The usual confidence levels of specifications: 1, 2 and 3 sigma of a normal error.
LEVELS: tuple[float, ...] = (0.68, 0.9545, 0.9973)


class Interpretation(StrEnum):
    """Population that the fraction of a confidence level counts (ECSS-E-ST-60-10C, 4.2.1).

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
    Raises    ValueError if the fraction is not in (0, 1) or there is no error.
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
    confidence  in (0, 1), least confidence of the interval; the upper bound alone has (1 +
                confidence) / 2
    Returns     Interval; without an upper bound where there are too few errors
    Raises      ValueError if the fraction is not in (0, 1) or there is no error.
    """
    size = np.sort(_sizes(np.atleast_2d(error), fraction)[0])
    tail = (1 - confidence) / 2
    low, high = level_ranks(len(size), fraction, tail, tail)
    return Interval(
        float(np.quantile(size, fraction)),
        float(size[low - 1]) if low > 0 else 0.0,
        float(size[high - 1]) if high <= len(size) else math.inf,
    )


@lru_cache
def level_ranks(n: int, fraction: float, low_tail: float, high_tail: float) -> tuple[int, int]:
    """Ranks, counted from one, of n sorted errors that bound a level; 0 and n + 1 mean no bound.

    low_tail, high_tail  probabilities that each bound does not hold
    """
    low = int(
        scipy.stats.binom.ppf(low_tail, n, fraction)
    )  # at least this number lies below the level
    return low, int(scipy.stats.binom.isf(high_tail, n, fraction)) + 1


def level_bounds(
    squares: Floats, fraction: float, low_tail: float, high_tail: float, number: int | None = None
) -> tuple[float, float]:
    """Bounds of a level of squares by order statistics, as for `level_interval`.

    squares  (n,), or (n, m) with m dependent values (axes, frames), which count as one of n
    low_tail, high_tail  probabilities that each bound does not hold
    number   of independent groups of equal size; None: n
    Returns  squares; 0 and infinity where the values are too few
    """
    ordered, n = np.sort(squares, axis=None), len(squares) if number is None else number
    each = ordered.size / n if n else 1
    low, high = level_ranks(n, fraction, low_tail, high_tail)
    return (
        float(ordered[math.floor(each * low) - 1]) if low > 0 else 0.0,
        float(ordered[math.ceil(each * high) - 1]) if high <= n else math.inf,
    )


def resampled_interval(
    values: Floats, freedom: float, model: float = 0.0, confidence: float = 0.95
) -> Interval:
    """Bootstrap interval of a statistic that depends on the few largest of many values.

        value -+ t(freedom) sqrt(s^2 + model^2)

    with the standard deviation s over the resamples and the quantile t of Student's law.
    Percentiles of the resamples would be too low: no resample exceeds the largest value.

    values   (1 + resamples,) the statistic of all, and of each resample
    freedom  of s: for a level, twice the expected number of values beyond it
    model    a further standard error, not contained in the resamples
    Returns  NaN for an unknown statistic; without bounds where the freedom is less than 2, which
             means less than one value beyond a level
    """
    value = float(values[0])
    if not math.isfinite(value):
        return Interval(value, math.nan, math.nan)
    if freedom < 2 - 1e-9:
        return Interval(value, -math.inf, math.inf)
    spread = math.hypot(float(np.nanstd(values[1:])), model)
    half = float(scipy.special.stdtrit(freedom, (1 + confidence) / 2)) * spread
    return Interval(value, value - half, value + half)


def quantile_of_few(values: Floats, fraction: float) -> Floats:
    """Quantile over the last axis of values (..., n), a smooth function of all of them.

        Q = sum_i w_i x_(i),   w_i = I_(i/n)(a, b) - I_((i-1)/n)(a, b),
        a = fraction (n + 1),   b = (1 - fraction) (n + 1)

    with the sorted values x_(i) and the regularised incomplete beta function I. For few values it
    scatters less than the nearest order statistic, and it has no steps.

    Source: Harrell and Davis (1982), Biometrika 69, 635.

    fraction  in (0, 1)
    Accuracy  statistical: for a fraction above 1 - 1 / n, it hardly exceeds the largest of n
              values.
    """
    _proper(fraction)
    n = values.shape[-1]
    a, b = fraction * (n + 1), (1 - fraction) * (n + 1)
    weight = np.diff(scipy.special.betainc(a, b, np.linspace(0, 1, n + 1)))
    ordered = np.sort(values, axis=-1)
    # An infinite value counts only where its weight is not zero.
    return np.asarray(np.where(weight > 0, ordered, 0.0) @ weight)


def _sizes(error: Floats, fraction: float) -> Floats:
    _proper(fraction)
    if error.ndim != 2 or error.size == 0:
        raise Refused(f"error must have members and times, got shape {error.shape}")
    return np.abs(error)


def _proper(fraction: float) -> None:
    if not 0 < fraction < 1:
        raise Refused(f"fraction and confidence must lie in (0, 1), got {fraction}")


@dataclass(frozen=True, eq=False)
class Indices:
    """The error indices of one sequence.

    Pointing errors are called APE, MPE, RPE and PDE; knowledge errors, such as those of a star
    tracker, AKE, MKE, RKE and KDE.

    absolute  (m, ...) error
    mean      (k, ...) its mean over each window
    relative  (j, ...) error minus the mean of its window, for the times in whole windows
    drift     (k - lag, ...) mean of a window minus that of the window `lag` before
    """

    absolute: Floats
    mean: Floats
    relative: Floats
    drift: Floats


def indices(error: Floats, step: float, window: float, lag: int = 1) -> Indices:
    """Compute the error indices of a sequence over consecutive windows.

        APE(t) = e(t),  MPE = mean e over a window,  RPE(t) = e(t) - MPE,  PDE = MPE_2 - MPE_1

    Source: ECSS-E-ST-60-10C (2008), 3.2.

    error    (m, ...) error at equal steps of time, usually (m, 3) radian
    step     second
    window   second, rounded to a whole number of steps
    lag      number of windows between both windows of a drift
    Returns  Indices; errors after the last whole window are in `absolute` alone
    Raises   ValueError if the step or the lag is not positive, or a window holds less than one
             step or more than the sequence.
    """
    positive(step=step, window=window)
    steps = round(window / step)
    count = len(error) // steps if steps else 0
    if count < 1:
        raise Refused(
            f"window must last from one step ({step} s) to the sequence ({len(error) * step} s), "
            f"got {window} s"
        )
    if lag < 1:
        raise Refused(f"lag must be at least one window, got {lag}")
    windows = error[: count * steps].reshape(count, steps, *error.shape[1:])
    mean = windows.mean(axis=1)
    relative = (windows - mean[:, None]).reshape(count * steps, *error.shape[1:])
    return Indices(error, mean, relative, mean[lag:] - mean[:-lag])


def reproducibility(first: Floats, second: Floats) -> Floats:
    """Difference between the mean errors of two observation periods: PRE for pointing, KRE for
    knowledge.

    Source: ECSS-E-ST-60-10C (2008), 3.2.

    first, second  (m, ...) and (n, ...) errors
    Returns        (...) mean of the second minus mean of the first
    """
    return np.asarray(second.mean(axis=0) - first.mean(axis=0))
