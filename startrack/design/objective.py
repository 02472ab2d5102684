"""Outcomes of trials -> the error that is minimised, and ratios of it."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, one_of
from startrack.metrics import Interval

AXES = {"across": [0, 1], "about": [2], "both": [0, 1, 2]}
RESAMPLES = 4000
BOOTSTRAP = 1  # names the stream of the resampling


@dataclass(frozen=True)
class Objective:
    """A statistic of the error over the trials with a right attitude.

        across = sqrt((x^2 + y^2) / 2),   about = |z|,   both = sqrt((x^2 + y^2 + z^2) / 3)

    axes      "across", "about" or "both"
    fraction  None for the root mean square per axis, as above; or the fraction of trials, as in
              0.9973, whose error is not longer than the result: sqrt(x^2 + y^2) for across
    """

    axes: str = "across"
    fraction: float | None = None

    def __post_init__(self) -> None:
        one_of(AXES, axes=self.axes)
        if self.fraction is not None and not 0 < self.fraction < 1:
            raise ValueError(f"fraction must lie in (0, 1), got {self.fraction}")

    @classmethod
    def read(cls, text: str) -> Objective:
        """From "across", "about-99.73" and the like, the fraction in percent.

        Raises  ValueError where the text is none of these.
        """
        axes, dash, percent = text.partition("-")
        try:
            return cls(axes, float(percent) / 100 if dash else None)
        except ValueError:
            raise ValueError(
                "objective must be across, about or both, alone for the rms or with a fraction in "
                f"percent as in across-99.73, got {text!r}"
            ) from None

    def __str__(self) -> str:
        level = "rms" if self.fraction is None else f"{100 * self.fraction:g} %"
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
            if self.fraction is None:
                return np.sqrt(np.nanmean(squares, axis=-1))
            return np.sqrt(len(AXES[self.axes]) * np.nanquantile(squares, self.fraction, axis=-1))

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

        first, second  radian^2, of trials
        paired         whether the two are of the same trials, in the same order
        Accuracy  NaN where one solved none.
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
