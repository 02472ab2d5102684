"""Values of trials, and control variates -> a mean with its standard error."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from startrack.core import Floats, Refused
from startrack.metrics import Interval

FOLDS = 8  # parts, each corrected with coefficients from the others; chosen by hand


class Mean(NamedTuple):
    """An unbiased estimate of a mean.

    value    in the unit of the values
    error    its standard error, likewise
    freedom  degrees of freedom of the error
    """

    value: float
    error: float
    freedom: float

    def interval(self, confidence: float = 0.95) -> Interval:
        """Student's interval."""
        half = float(special.stdtrit(self.freedom, (1 + confidence) / 2)) * self.error
        return Interval(self.value, self.value - half, self.value + half)

    def root(self, confidence: float = 0.95) -> Interval:
        """The interval of the root: of an rms, where the mean is one of squares.

        Few values with a control may estimate a square below zero; its root is taken as zero.
        """
        square = self.interval(confidence)
        value, low, high = (
            math.sqrt(max(each, 0.0)) for each in (square.value, square.low, square.high)
        )
        return Interval(value, low, high)


def plain(values: Floats) -> Mean:
    """Mean of independent values (n,)."""
    n = len(values)
    return Mean(float(values.mean()), float(values.std(ddof=1)) / math.sqrt(n), n - 1)


def replicated(values: Floats, replicate: NDArray[np.int64]) -> Mean:
    """Mean of values that are independent only between replicates (n,), all equally many.

    The scatter of the replicates' means is valid however their points depend on each other.
    """
    count = np.bincount(replicate)
    if len(np.unique(count[count > 0])) != 1:
        raise Refused("replicates must have equally many values")
    return plain(np.bincount(replicate, values)[count > 0] / count.max())


def stratified(values: Floats, stratum: NDArray[np.int64]) -> Mean:
    """Mean of values drawn independently in strata (n,) of equal probability.

        mean = mean_k m_k,   error^2 = sum_k s_k^2 / n_k / K^2

    Source: Cochran (1977), Sampling Techniques, eq. (5.11).

    Raises  ValueError where a stratum has fewer than two values.
    """
    count = np.bincount(stratum)
    if count.min() < 2:
        raise Refused(f"each stratum must have at least 2 values, got {count.min()}")
    mean = np.bincount(stratum, values) / count
    square = np.bincount(stratum, (values - mean[stratum]) ** 2) / (count - 1)
    error = math.sqrt(float((square / count).sum())) / len(count)
    # Welch and Satterthwaite's degrees of freedom.
    fraction = square / count
    freedom = fraction.sum() ** 2 / max((fraction**2 / (count - 1)).sum(), 1e-300)
    return Mean(float(mean.mean()), error, float(freedom))


def controlled(values: Floats, controls: Floats) -> Mean:
    """Of values (n,) with the help of controls (n, k) whose expectation is zero.

        mean of v - c b,   b by least squares from the other folds

    With b from the same values the mean would have a bias of about 1 / n; with b from the others
    it has none, whatever b is.

    Source: Glasserman (2004), Monte Carlo Methods in Financial Engineering, section 4.1.
    """
    return plain(values - explained(values, controls))


def explained(values: Floats, controls: Floats) -> Floats:
    """The part (n,) of each value that the controls explain, with b from the other folds."""
    fold = np.arange(len(values)) % FOLDS
    part = np.empty(len(values))
    for one in range(FOLDS):
        mine = fold == one
        part[mine] = controls[mine] @ _slope(values[~mine], controls[~mine])
    return part


def two_levels(fine: Floats, coarse: Floats, rest: Mean, controls: Floats | None = None) -> Mean:
    """Mean of fine values (n,), by coarse ones of the same trials and the coarse mean of others.

        mean(fine - b (coarse - rest)),   b from the other folds

    Source: Giles (2015), Acta Numerica 24, 259; Peherstorfer, Willcox and Gunzburger (2016), SIAM
    J. Sci. Comput. 38, A3163, for the weight b.

    rest      the mean of coarse values over other trials
    controls  (n, k) of the fine values, whose expectation is zero
    """
    beside = coarse[:, None] - rest.value
    if controls is not None:
        beside = np.column_stack([beside, controls])
    first = controlled(fine, beside)
    # All folds use the same rest, whose error is common to them.
    second = float(_slope(fine, beside)[0]) * rest.error
    error = math.hypot(first.error, second)
    freedom = error**4 / max(first.error**4 / first.freedom + second**4 / rest.freedom, 1e-300)
    return Mean(first.value, error, freedom)


def best_ratio(correlation: float, cost_ratio: float) -> float:
    """Best number of coarse values for each fine one.

        m / n = sqrt(cost_fine / cost_coarse  rho^2 / (1 - rho^2))

    Source: Peherstorfer et al. (2016), eq. (3.11), for two models.

    cost_ratio  of a fine value over a coarse one
    """
    return math.sqrt(cost_ratio * correlation**2 / max(1 - correlation**2, 1e-12))


def _slope(values: Floats, controls: Floats) -> Floats:
    centred = controls - controls.mean(axis=0)
    return np.asarray(np.linalg.lstsq(centred, values - values.mean(), rcond=None)[0], float)
