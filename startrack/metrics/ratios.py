"""Squared errors of two designs -> the ratio of their rms or levels, with its interval."""

import math
from collections.abc import Sequence

import numpy as np
import scipy.special

from startrack.core import Floats
from startrack.metrics.levels import level_bounds
from startrack.metrics.summary import Interval

ALLOWANCE = 4.0  # for the variance of few values, as for `mean_bounds`; chosen by hand


def ratio_of_rms(
    first: Sequence[Floats],
    second: Sequence[Floats],
    weights: Sequence[float] | Floats,
    confidence: float = 0.95,
    paired: bool = True,
) -> Interval:
    """Rms of some trials over the rms of others, as a geometric mean over conditions.

        ln R = sum_k w_k (ln a_k - ln b_k) / 2 / sum_k w_k
        variance = s^2 (1 + 4 r / n) / n

    with the means a and b of the squares, the variance s^2 of each trial's contribution to ln R,
    and the largest (s / mean)^2 of the squares, r, which allows for variances of few values. The
    interval has Student's quantile.

    first, second  (n,) squares of each condition, the same trials in all of them; NaN where there
                   is no attitude
    weights        w; (2, k) for weights of the first and of the second
    paired         whether both are of the same trials, in the same order
    Returns        NaN where one has no attitude; without bounds of fewer than three trials
    Accuracy       statistical: 95 % intervals hold 0.93 to 0.97 from 20 trials on, paired or not,
                   where errors are normal, and where their sigma varies by exp(0.5) over the sky.
    """
    sides = [[_influences(squares) for squares in side] for side in (first, second)]
    shares = np.broadcast_to(np.asarray(weights, float), (2, len(first)))
    shares = shares / shares.sum(axis=1, keepdims=True)
    logs = [np.array([log for log, *_ in side]) for side in sides]
    value = math.exp(float(shares[0] @ logs[0] - shares[1] @ logs[1]) / 2)
    parts = [
        share @ np.stack([influence for _, influence, _ in side]) / 2
        for share, side in zip(shares, sides, strict=True)
    ]
    counts = [min(int(np.isfinite(squares).sum()) for squares in side) for side in (first, second)]
    if min(counts) < 3 or not math.isfinite(value):
        return Interval(value, 0.0, math.inf) if value >= 0 else Interval(*[math.nan] * 3)
    spreads = [max(spread for *_, spread in side) for side in sides]
    n = min(counts)
    if paired:
        variance = _variance(parts[0] - parts[1], n, max(spreads))
    else:
        variance = sum(
            _variance(part, count, spread)
            for part, count, spread in zip(parts, counts, spreads, strict=True)
        )
    half = float(scipy.special.stdtrit(n - 1, (1 + confidence) / 2)) * math.sqrt(variance)
    return Interval(value, value * math.exp(-half), value * math.exp(half))


def _influences(squares: Floats) -> tuple[float, Floats, float]:
    """Logarithm of the mean, the contribution of each trial, and (s / mean)^2."""
    known = np.isfinite(squares)
    if not known.any():
        return math.nan, np.zeros(len(squares)), 0.0
    mean = float(squares[known].mean())
    if not mean:
        return -math.inf, np.zeros(len(squares)), 0.0
    influence = np.where(known, squares / mean - 1, 0.0) * (len(squares) / known.sum())
    return math.log(mean), influence, float(squares[known].var()) / mean**2


def _variance(influence: Floats, count: int, spread: float) -> float:
    """Variance of the mean of the trials' contributions."""
    return float(influence.var(ddof=1)) / len(influence) * (1 + ALLOWANCE * spread / count)


def ratio_of_levels(
    first: Sequence[Floats],
    second: Sequence[Floats],
    fraction: float,
    weights: Sequence[float],
    confidence: float = 0.95,
    paired: bool = True,
) -> Interval:
    """Level of some trials over the level of others, as a geometric mean over conditions.

    The interval of the logarithm of the ratio follows from the exact intervals of both levels. Its
    squared half width is the sum of both squared half widths, minus twice their product times a
    correlation: the correlation of exceeding both levels in the same trial. Conditions are taken as
    fully correlated.

    Source: Zou and Donner (2008), Statist. Med. 27, 1693, for the combination.

    first, second  (n,) or (n, axes) squares of each condition; NaN where there is no attitude
    fraction       in (0, 1)
    Returns        NaN where one has no attitude; without bounds where the trials are too few to
                   bound a level, see `trials_for_level`
    """
    share = np.asarray(weights, float) / sum(weights)
    total = np.zeros(3)
    for weight, a, b in zip(share, first, second, strict=True):
        bounds = [_level(squares, fraction, confidence) for squares in (a, b)]
        if not all(bound[0] > 0 for bound in bounds):
            return Interval(math.nan, math.nan, math.nan)
        (va, la, ha), (vb, lb, hb) = bounds
        together = _together(a, b, va, vb) if paired else 0.0
        down = _combined(math.log(va / la) if la else math.inf, math.log(hb / vb), together)
        up = _combined(math.log(ha / va), math.log(vb / lb) if lb else math.inf, together)
        total += weight / 2 * np.array([math.log(va / vb), down, up])
    value, down, up = total.tolist()
    return Interval(
        math.exp(value),
        math.exp(value - down),
        math.exp(min(value + up, 700)) if math.isfinite(up) else math.inf,
    )


def trials_for_level(fraction: float, confidence: float = 0.95) -> int:
    """The least number of trials that bound a level above."""
    return math.ceil(math.log((1 - confidence) / 2) / math.log(fraction))


def _combined(first: float, second: float, correlation: float) -> float:
    if not (math.isfinite(first) and math.isfinite(second)):
        return math.inf
    square = first**2 + second**2 - 2 * correlation * first * second
    return math.sqrt(max(square, 0.0))


def _level(squares: Floats, fraction: float, confidence: float) -> tuple[float, float, float]:
    """A level of squares, with bounds by order statistics; the axes of a trial count as one
    value."""
    known = squares[np.isfinite(squares).reshape(len(squares), -1).all(axis=1)]
    if not len(known):
        return math.nan, math.nan, math.nan
    tail = (1 - confidence) / 2
    return float(np.quantile(known, fraction)), *level_bounds(known, fraction, tail, tail)


def _together(first: Floats, second: Floats, level: float, other: float) -> float:
    """Correlation of exceeding two levels in the same trial, in [0, 1]."""
    one, two = (first > level).reshape(-1), (second > other).reshape(-1)
    variance = float(one.var() * two.var())
    if not variance:
        return 0.0
    return max(float((one & two).mean() - one.mean() * two.mean()) / math.sqrt(variance), 0.0)
