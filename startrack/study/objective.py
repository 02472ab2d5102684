"""Outcomes of trials enter; the error that is to be made small leaves, and ratios of it."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from startrack.checks import one_of
from startrack.error import Interval

Floats = NDArray[np.float64]
AXES = ("across", "about", "both")
RESAMPLES = 4000
BOOTSTRAP = 1  # names the stream of the resampling


@dataclass(frozen=True)
class Objective:
    """A statistic of the error over the trials with a right attitude.

        across = sqrt((x^2 + y^2) / 2),   about = |z|,   both = sqrt((x^2 + y^2 + z^2) / 3)

    axes   "across", "about" or "both"
    share  None for the root mean square, or the share of trials, as in 0.9973, whose error is
           not larger
    """

    axes: str = "across"
    share: float | None = None

    def __post_init__(self) -> None:
        one_of(AXES, axes=self.axes)
        if self.share is not None and not 0 < self.share < 1:
            raise ValueError(f"share must lie in (0, 1), got {self.share}")

    @classmethod
    def read(cls, text: str) -> Objective:
        """From "across", "about-99.73" and the like, the share in percent.

        Errors  ValueError where the text is none of these.
        """
        axes, dash, percent = text.partition("-")
        try:
            return cls(axes, float(percent) / 100 if dash else None)
        except ValueError:
            raise ValueError(
                "objective must be across, about or both, alone for the rms or with a share in "
                f"percent as in across-99.73, got {text!r}"
            ) from None

    def __str__(self) -> str:
        level = "rms" if self.share is None else f"{100 * self.share:g} %"
        where = "about all axes" if self.axes == "both" else f"{self.axes} the boresight"
        return f"{level} error {where}"

    def squares(self, outcomes: NDArray[np.void]) -> Floats:
        """Radian^2 of each trial, NaN where there is no right attitude."""
        x, y, z = (outcomes[f"error_{axis}"] ** 2 for axis in "xyz")
        square = {"across": (x + y) / 2, "about": z, "both": (x + y + z) / 3}[self.axes]
        return np.where(outcomes["solved"] & ~outcomes["false"], square, np.nan)

    def of(self, squares: Floats) -> Floats:
        """Radian, over the last axis of squares; NaN where no trial has a right attitude."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # that an axis is all NaN
            if self.share is None:
                return np.sqrt(np.nanmean(squares, axis=-1))
            return np.sqrt(np.nanquantile(squares, self.share, axis=-1))

    def variances(self, outcomes: NDArray[np.void]) -> Floats:
        """What the tracker states of the squares of each trial, NaN as there."""
        x, y, z = (outcomes[f"sigma_{axis}"] ** 2 for axis in "xyz")
        variance = {"across": (x + y) / 2, "about": z, "both": (x + y + z) / 3}[self.axes]
        return np.where(np.isfinite(self.squares(outcomes)), variance, np.nan)

    def stated(self, variances: Floats) -> float:
        """Radian, the statistic of errors that are normal with the tracker's own variances.

            mean_i P(k / 2, k L^2 / (2 variance_i)) = share,   P the regularised incomplete gamma
            function, k = 2, 1, 3 the axes that are taken together

        Errors  NaN where no trial has a right attitude. model: equal variances of the axes.
        """
        right = variances[np.isfinite(variances)]
        if not len(right):
            return math.nan
        if self.share is None:
            return math.sqrt(float(right.mean()))
        half = {"across": 1.0, "about": 0.5, "both": 1.5}[self.axes]

        def excess(log_square: float) -> float:
            reached = special.gammainc(half, half * math.exp(log_square) / right)
            return float(reached.mean()) - self.share

        lowest, highest = math.log(right.min()) - 40, math.log(right.max()) + 10
        return math.exp(optimize.brentq(excess, lowest, highest) / 2)

    def ratio(
        self,
        first: Floats,
        second: Floats,
        seed: int,
        resamples: int = RESAMPLES,
        confidence: float = 0.95,
        paired: bool = True,
    ) -> Interval:
        """Statistic of the squares of some trials over that of others, with its interval.

        Trials are resampled (bootstrap percentiles), in pairs where both are on the same skies;
        one that a design did not solve counts for the other design alone.

        first, second  radian^2, squares or variances
        paired         whether the two are of the same trials, in the same order
        Errors  NaN where one solved none.
        """
        if not (np.isfinite(first).any() and np.isfinite(second).any()):
            return Interval(np.nan, np.nan, np.nan)
        rng = np.random.default_rng(np.random.SeedSequence((seed, BOOTSTRAP)))
        chosen = rng.integers(0, len(first), (resamples, len(first)))
        other_chosen = chosen if paired else rng.integers(0, len(second), (resamples, len(second)))
        ratios = self.of(first[chosen]) / self.of(second[other_chosen])
        tail = (1 - confidence) / 2
        low, high = np.nanquantile(ratios, [tail, 1 - tail])
        return Interval(float(self.of(first) / self.of(second)), float(low), float(high))
