"""When the interval of a statistic is narrow enough; quantiles with exact intervals."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from startrack import metrics
from startrack.core import Parameters, Range
from startrack.montecarlo.estimate import mean_square

STATISTICS = ("across", "about", "availability", "across-99.73")
GROWTH = 1.2, 4.0  # least and largest factor from one test of the interval to the next; by hand


@dataclass(frozen=True)
class Precision(Parameters):
    """The precision that a statistic is to reach.

    relative    1, half-width of its interval over its value, at most
    statistic   across, about: rms error per axis across, or about the boresight;
                across-99.73: the angle that 99.73 % of the errors across do not exceed, radial;
                availability: fraction of trials with a correct attitude
    confidence  1, of the interval
    sobol       whether trials lie at Sobol's points. The intervals of an rms then come from the
                scatter of their scrambles; the others assume random trials and are too wide
    limits      of a correct attitude, for the availability
    """

    relative: Annotated[float, Range(1e-6, 1)]
    statistic: Annotated[str, Range(choices=STATISTICS)] = "across"
    confidence: Annotated[float, Range(0.5, 0.9999)] = 0.95
    sobol: bool = False
    limits: metrics.Limits = metrics.STATED_ALONE

    def interval(self, outcomes: NDArray[np.void]) -> metrics.Interval:
        """The statistic of structured outcomes; errors over solved trials that are not false.

        An rms uses the controls of its trials, where they have them.
        """
        solved = outcomes[outcomes["solved"] & ~outcomes["false"]]
        if self.statistic == "availability":
            hits = int(metrics.correct(outcomes, self.limits).sum())
            return metrics.fraction_interval(hits, len(outcomes), self.confidence)
        squares = solved["error_x"] ** 2 + solved["error_y"] ** 2
        if self.statistic == "across-99.73":
            return quantile_interval(np.sqrt(squares), 0.9973, self.confidence)
        about = self.statistic == "about"
        if self.sobol or "surplus_across" in (outcomes.dtype.names or ()):
            return mean_square(outcomes, about, self.sobol).root(self.confidence)
        return metrics.rms_interval(
            solved["error_z"] ** 2 if about else squares / 2, self.confidence
        )

    def reached(self, outcomes: NDArray[np.void]) -> bool:
        """Whether the interval is narrow enough."""
        return half_width(self.interval(outcomes)) <= self.relative

    def next_size(self, outcomes: NDArray[np.void], trials: int) -> int:
        """Number of trials at the next test of the interval, after one at the outcomes of `trials`.

        A function of outcomes alone, so that a campaign stops at the same trial however it was
        interrupted. Each test may stop too early by chance: there are few.
        """
        factor = (half_width(self.interval(outcomes)) / self.relative) ** 2
        factor = min(max(factor, GROWTH[0]), GROWTH[1]) if math.isfinite(factor) else GROWTH[1]
        return math.ceil(trials * factor)


def half_width(interval: metrics.Interval) -> float:
    """Half the width of an interval over its value; infinite where it is unbounded."""
    width = (interval.high - interval.low) / 2
    if not math.isfinite(width) or not interval.value > 0:
        return math.inf
    return width / interval.value


def quantile_interval(
    values: NDArray[np.float64], fraction: float, confidence: float = 0.95
) -> metrics.Interval:
    """A quantile of values that are not negative, with the interval of `level_interval`.

    fraction  in (0, 1)
    Returns  the least value that this fraction does not exceed; its interval is unbounded above
             where there are too few values
    Accuracy  NaN where there is no value. The coverage is at least the confidence.
    """
    if len(values) == 0:
        return metrics.Interval(math.nan, math.nan, math.nan)
    bounds = metrics.level_interval(values, fraction, confidence)
    rank = max(math.ceil(len(values) * fraction), 1) - 1
    return metrics.Interval(float(np.partition(values, rank)[rank]), bounds.low, bounds.high)
