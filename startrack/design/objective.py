"""Outcomes of trials -> the error that is minimised, and ratios of it."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from startrack.core import Floats, Refused, Rows, one_of
from startrack.metrics import Interval, ratio_of_levels, ratio_of_rms

AXES = {"across": [0, 1], "about": [2], "both": [0, 1, 2]}
KINDS = ("per axis", "radial")


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
        self,
        first: Sequence[Floats],
        second: Sequence[Floats],
        weights: Sequence[float] = (1.0,),
        confidence: float = 0.95,
        paired: bool = True,
    ) -> Interval:
        """Statistic of the squares of some trials over that of others, with its interval.

        Over several conditions, the ratio of the geometric means by their weights. A trial that a
        design did not solve counts for the other design alone.

        first, second  radian^2, of trials of each condition, on the same skies in all of them
        paired         whether both are of the same trials, in the same order
        Accuracy       NaN where one solved none; see `ratio_of_rms` and `ratio_of_levels`.
        """
        if not all(np.isfinite(squares).any() for squares in (*first, *second)):
            return Interval(np.nan, np.nan, np.nan)
        if self.fraction is None:
            return ratio_of_rms(first, second, weights, confidence, paired)
        return ratio_of_levels(first, second, self.fraction, weights, confidence, paired)
