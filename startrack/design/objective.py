"""Outcomes of trials -> the error that is minimised, and ratios of it."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from startrack.core import Floats, Refused, Rows, one_of
from startrack.metrics import Interval

AXES = {"across": [0, 1], "about": [2], "both": [0, 1, 2]}
KINDS = ("per axis", "radial")
RESAMPLES = 4000
BOOTSTRAP = 1  # names the stream of the resampling


@dataclass(frozen=True)
class Objective:
    """A statistic of the error over the solved trials without the false ones.

        rms per axis:  across = sqrt(mean (x^2 + y^2) / 2),   about = sqrt(mean z^2),
                       both = sqrt(mean (x^2 + y^2 + z^2) / 3)
        rms radial:    without the division

    axes      "across", "about" or "both"
    fraction  None for the root mean square; or the fraction, as in 0.9973, that does not exceed the
              result: of the trials by the length of their error where radial, such as
              sqrt(x^2 + y^2) for across; of the errors about single axes where per axis
    kind      "per axis" or "radial"; "" is per axis for the rms and radial with a fraction. About
              the boresight alone, both are the same
    """

    axes: str = "across"
    fraction: float | None = None
    kind: str = ""

    def __post_init__(self) -> None:
        one_of(AXES, axes=self.axes)
        one_of(("", *KINDS), kind=self.kind)
        if self.fraction is not None and not 0 < self.fraction < 1:
            raise Refused(f"fraction must lie in (0, 1), got {self.fraction}")

    @classmethod
    def read(cls, text: str) -> Objective:
        """From "across", "about-99.73", "across-99.73 per axis" and the like, in percent.

        Raises  ValueError where the text is none of these.
        """
        statistic, _, kind = text.partition(" ")
        axes, dash, percent = statistic.partition("-")
        try:
            return cls(axes, float(percent) / 100 if dash else None, kind)
        except ValueError:
            raise Refused(
                "objective must be across, about or both, alone for the rms or with a fraction in "
                "percent as in across-99.73, and may end with ' per axis' or ' radial', got "
                f"{text!r}"
            ) from None

    def __str__(self) -> str:
        level = "rms" if self.fraction is None else f"{100 * self.fraction:g} %"
        where = "about all axes" if self.axes == "both" else f"{self.axes} the boresight"
        named = self.axes != "about" and (self.fraction is not None or self.radial)
        return f"{level} error {where}" + f", {KINDS[self.radial]}" * named

    @property
    def radial(self) -> bool:
        """Whether it is of the length of the error over all its axes."""
        return self.kind == "radial" if self.kind else self.fraction is not None

    def squares(self, outcomes: Rows) -> Floats:
        """Radian^2 of each trial, NaN where there is no attitude or a false one.

        Returns  (n,), their mean over the axes; (n, axes) for a level per axis of several
        """
        axes = np.stack([outcomes[f"error_{'xyz'[axis]}"] ** 2 for axis in AXES[self.axes]], -1)
        correct = outcomes["solved"] & ~outcomes["false"]
        if self.per_axis_level:
            return np.where(correct[:, None], axes, np.nan)
        square = axes.sum(axis=1) / axes.shape[1]
        return np.where(correct, square, np.nan)

    @property
    def summed(self) -> list[int]:
        """The axes about which its errors are."""
        return AXES[self.axes]

    @property
    def per_axis_level(self) -> bool:
        """Whether it is a level of the errors about several single axes."""
        return self.fraction is not None and not self.radial and self.axes != "about"

    @property
    def rms_per_axis(self) -> bool:
        """Whether it is the root mean square of the errors about single axes."""
        return self.fraction is None and not (self.radial and len(self.summed) > 1)

    def of(self, squares: Floats) -> Floats:
        """Radian, over the last axis of squares (two for a level per axis); NaN without any."""
        axes = len(AXES[self.axes])
        with warnings.catch_warnings():
            # That an axis is all NaN, of which the mean is NaN, as it should be.
            warnings.filterwarnings("ignore", "Mean of empty slice|All-NaN", RuntimeWarning)
            if self.fraction is None:
                return np.sqrt((axes if self.radial else 1) * np.nanmean(squares, axis=-1))
            # That for NaN takes the rows one by one; that of no value at all is NaN, too.
            complete = squares.size and not np.isnan(squares).any()
            quantile = np.quantile if complete else np.nanquantile
            if self.per_axis_level:
                return np.sqrt(quantile(squares, self.fraction, axis=(-2, -1)))
            return np.sqrt(axes * quantile(squares, self.fraction, axis=-1))

    def ratio(
        self, first: Floats, second: Floats, seed: int, resamples: int = RESAMPLES,
        confidence: float = 0.95, paired: bool = True,
    ) -> Interval:  # fmt: skip
        """Statistic of the squares of some trials over that of others, with its interval.

        Trials are resampled (bootstrap percentiles), in pairs where both are on the same skies;
        one that a design did not solve counts for the other design alone.

        first, second  radian^2, of trials
        paired         whether the two are of the same trials, in the same order
        Accuracy  NaN where one solved none.
        """
        return self.ratio_of_means([first], [second], [1.0], seed, resamples, confidence, paired)

    def ratio_of_means(
        self, first: Sequence[Floats], second: Sequence[Floats], weights: Sequence[float],
        seed: int, resamples: int = RESAMPLES, confidence: float = 0.95, paired: bool = True,
    ) -> Interval:  # fmt: skip
        """`ratio` of the geometric means of the statistic over several conditions, by weights.

        first, second  of each condition, on the same skies in all of them
        """
        if not all(np.isfinite(squares).any() for squares in (*first, *second)):
            return Interval(np.nan, np.nan, np.nan)
        rng = np.random.default_rng(np.random.SeedSequence((seed, BOOTSTRAP)))
        n, m = len(first[0]), len(second[0])
        chosen = rng.integers(0, n, (resamples, n))
        other_chosen = chosen if paired else rng.integers(0, m, (resamples, m))
        pairs = list(zip(first, second, strict=True))
        resampled = [self.of(a[chosen]) / self.of(b[other_chosen]) for a, b in pairs]
        ratios = _weighted(resampled, weights)
        value = _weighted([self.of(a) / self.of(b) for a, b in pairs], weights)
        tail = (1 - confidence) / 2
        low, high = np.nanquantile(ratios, [tail, 1 - tail])
        return Interval(float(value), float(low), float(high))


def _weighted(ratios: Sequence[Floats], weights: Sequence[float]) -> Floats:
    """Geometric mean by weights."""
    if len(ratios) == 1:
        return ratios[0]
    logs = [weight * np.log(ratio) for ratio, weight in zip(ratios, weights, strict=True)]
    return np.exp(np.sum(logs, axis=0) / sum(weights))
