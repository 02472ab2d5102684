"""Outcomes of trials -> the error that is minimised, and ratios of it."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from startrack.core import Floats, Refused, Rows, one_of
from startrack.metrics import Interval, ratio_of_levels, ratio_of_rms

AXES = {"across": [0, 1], "about": [2], "both": [0, 1, 2]}
KINDS = ("per axis", "radial")
MEANS = ("geometric", "arithmetic", "quadratic", "worst")
TERM = re.compile(r"\s*(?:(\d+\.?\d*|\.\d+)\s+)?(across|about)\s*")


@dataclass(frozen=True)
class Objective:
    """A statistic of the error over all trials with a correct attitude.

        rms per axis:  across = sqrt(mean (x^2 + y^2) / 2),   about = sqrt(mean z^2),
                       both = sqrt(mean (x^2 + y^2 + z^2) / 3)
        rms radial:    without the division

    axes      "across", "about" or "both"
    fraction  None for the root mean square; or the fraction, such as 0.9973, that does not exceed
              the result. Radial: fraction of the trials, by the length of their error, such as
              sqrt(x^2 + y^2) for across. Per axis: fraction of the errors about single axes
    kind      "per axis" or "radial"; "" is per axis for the rms, and radial with a fraction. About
              the boresight alone, both are the same
    terms     axes and weights of a sum of rms errors per axis, in place of the other fields; () for
              none
    mean      mean over conditions, by their weights w, of the errors e in them: "geometric",
              "arithmetic" (sum w e / sum w), "quadratic" (sqrt(sum w e^2 / sum w)), or "worst", the
              largest error in the conditions that have a weight
    """

    axes: str = "across"
    fraction: float | None = None
    kind: str = ""
    terms: tuple[tuple[str, float], ...] = ()
    mean: str = "geometric"

    def __post_init__(self) -> None:
        one_of(MEANS, mean=self.mean)
        one_of(AXES, axes=self.axes)
        one_of(("", *KINDS), kind=self.kind)
        if self.terms and (self.axes != "both" or self.fraction is not None):
            raise Refused(f"terms must be of all axes and of the rms, got {self.axes}")
        if self.fraction is not None and not 0 < self.fraction < 1:
            raise Refused(f"fraction must lie in (0, 1), got {self.fraction}")

    @classmethod
    def read(cls, text: str) -> Objective:
        """Objective from a text: "about-99.73", "across-99.73 per axis", "across + 0.1 about".

        Raises  ValueError if the text has none of these forms.
        """
        if "+" in text:
            return cls(axes="both", terms=_terms(text))
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
        over = "" if self.mean == MEANS[0] else f", {self.mean}"
        over += " mean over conditions" if self.mean in MEANS[1:3] else " condition" * bool(over)
        return self._of_axes() + over

    def _of_axes(self) -> str:
        if self.terms:
            each = (f"{weight:g} " * (weight != 1) + axes for axes, weight in self.terms)
            return f"rms errors {' + '.join(each)} the boresight"
        level = "rms" if self.fraction is None else f"{100 * self.fraction:g} %"
        where = "about all axes" if self.axes == "both" else f"{self.axes} the boresight"
        named = self.axes != "about" and (self.fraction is not None or self.radial)
        return f"{level} error {where}" + f", {KINDS[self.radial]}" * named

    @property
    def radial(self) -> bool:
        """Whether the error is the length of the error vector over all its axes."""
        return self.kind == "radial" if self.kind else self.fraction is not None

    def squares(self, outcomes: Rows) -> Floats:
        """Squared error (radian^2) of each trial; NaN without an attitude or with a false one.

        Returns  (n,) mean over the axes; (n, axes) for a level per axis of several axes, and for a
                 weighted sum
        """
        axes = np.stack([outcomes[f"error_{'xyz'[axis]}"] ** 2 for axis in AXES[self.axes]], -1)
        correct = outcomes["solved"] & ~outcomes["false"]
        if self.per_axis_level or self.terms:
            return np.where(correct[:, None], axes, np.nan)
        square = axes.sum(axis=1) / axes.shape[1]
        return np.where(correct, square, np.nan)

    @property
    def summed(self) -> list[int]:
        """Indices of the axes about which the errors are measured."""
        return AXES[self.axes]

    @property
    def per_axis_level(self) -> bool:
        """Whether it is a level of errors about single axes, for more than one axis."""
        return self.fraction is not None and not self.radial and self.axes != "about"

    @property
    def rms_per_axis(self) -> bool:
        """Whether it is the root mean square of the errors about single axes."""
        alone = not (self.radial and len(self.summed) > 1)
        return self.fraction is None and not self.terms and alone

    def of(self, squares: Floats) -> Floats:
        """The statistic (radian) over trials, by their `squares`; NaN without trials."""
        axes = len(AXES[self.axes])
        if self.terms:
            parts = [
                weight * Objective(name).of(squares[..., AXES[name]].mean(axis=-1))
                for name, weight in self.terms
            ]
            return np.asarray(np.sum(parts, axis=0))
        with warnings.catch_warnings():
            # If an axis has only NaN, its mean is NaN, as it should be.
            warnings.filterwarnings("ignore", "Mean of empty slice|All-NaN", RuntimeWarning)
            if self.fraction is None:
                return np.sqrt((axes if self.radial else 1) * np.nanmean(squares, axis=-1))
            # The function for NaN is slow: it takes rows one by one. The mean of no values is NaN,
            # too.
            complete = squares.size and not np.isnan(squares).any()
            quantile = np.quantile if complete else np.nanquantile
            if self.per_axis_level:
                return np.sqrt(quantile(squares, self.fraction, axis=(-2, -1)))
            return np.sqrt(axes * quantile(squares, self.fraction, axis=-1))

    def over(self, errors: Sequence[float], weights: Sequence[float]) -> float:
        """The mean of errors in conditions; NaN without errors, or if an error is NaN or zero."""
        if not errors or not all(error > 0 for error in errors):
            return math.nan
        if len(errors) == 1:
            return errors[0]
        pairs = list(zip(errors, weights, strict=True))
        total = math.fsum(weights)
        match self.mean:
            case "arithmetic":
                return math.fsum(weight * error for error, weight in pairs) / total
            case "quadratic":
                return math.sqrt(math.fsum(weight * error**2 for error, weight in pairs) / total)
            case "worst":
                return max(errors)
        return math.exp(math.fsum(weight * math.log(error) for error, weight in pairs) / total)

    def _shares(self, errors: Sequence[float], weights: Sequence[float]) -> Floats:
        """d ln(mean) / d ln(error) for the error in each condition; their sum is 1."""
        power = {"geometric": 0, "arithmetic": 1, "quadratic": 2}.get(self.mean)
        if power is None:
            return np.eye(len(errors))[int(np.argmax(errors))]
        share = np.asarray(weights, float) * np.asarray(errors) ** power
        return np.asarray(share / share.sum())

    def _columns(self, squares: Floats) -> tuple[list[Floats], Floats]:
        """Squares (n,) from whose rms the error is made, and d ln(error) / d ln(rms) for each."""
        if not self.terms:
            return [squares], np.ones(1)
        columns = [squares[:, AXES[name]].mean(axis=1) for name, _ in self.terms]
        errors = [
            weight * float(Objective(name).of(column))
            for (name, weight), column in zip(self.terms, columns, strict=True)
        ]
        return columns, np.array(errors) / sum(errors)

    def _all_columns(
        self, conditions: Sequence[Floats], shares: Floats
    ) -> tuple[list[Floats], Floats]:
        """`_columns` of all conditions, with d ln(mean) / d ln(rms) for each."""
        every = [self._columns(squares) for squares in conditions]
        own = [share * part for share, (_, part) in zip(shares, every, strict=True)]
        return [column for columns, _ in every for column in columns], np.concatenate(own)

    def as_one_square(self, squares: Floats) -> Floats:
        """A value (n,) for each trial; to first order, its mean varies as the squared error."""
        columns, shares = self._columns(squares)
        if len(columns) == 1:
            return columns[0]
        parts = [
            share * column / np.nanmean(column)
            for column, share in zip(columns, shares, strict=True)
        ]
        return np.asarray(np.sum(parts, axis=0))

    def ratio(
        self,
        first: Sequence[Floats],
        second: Sequence[Floats],
        weights: Sequence[float] = (1.0,),
        confidence: float = 0.95,
        paired: bool = True,
    ) -> Interval:
        """Ratio of the statistics of two sets of trials, with its interval.

        For several conditions, it is the ratio of the weighted means. A trial that one design did
        not solve counts for the other design alone.

        first, second  radian^2, squares of the trials in each condition, with the same skies in all
        paired         whether both sets are the same trials, in the same order
        Accuracy       NaN if one set has no solved trial; see `ratio_of_rms` and `ratio_of_levels`.
                       Sums, and means other than the geometric one, are linearised about the
                       measured values. The worst condition is the one with the largest measured
                       value.
        """
        if not all(np.isfinite(squares).any() for squares in (*first, *second)):
            return Interval(np.nan, np.nan, np.nan)
        errors = [[float(self.of(squares)) for squares in side] for side in (first, second)]
        value = self.over(errors[0], weights) / self.over(errors[1], weights)
        shares = [self._shares(side, weights) for side in errors]
        if self.fraction is not None:
            both = np.mean(shares, axis=0)
            found = ratio_of_levels(first, second, self.fraction, both, confidence, paired)
        else:
            (a, own_a), (b, own_b) = (
                self._all_columns(side, share)
                for side, share in zip((first, second), shares, strict=True)
            )
            found = ratio_of_rms(a, b, np.stack([own_a, own_b]), confidence, paired)
        if not self.terms and self.mean == MEANS[0]:
            return found
        return Interval(value, value * found.low / found.value, value * found.high / found.value)


def _terms(text: str) -> tuple[tuple[str, float], ...]:
    """Axes and weights of a sum."""
    terms = list[tuple[str, float]]()
    for part in text.split("+"):
        match = TERM.fullmatch(part)
        if not match or not (weight := float(match[1] or 1)) > 0:
            raise Refused(
                "objective must be a sum of rms errors across and about with positive weights, as "
                f"in across + 0.1 about, got {text!r}"
            )
        terms.append((match[2], weight))
    if len({axes for axes, _ in terms}) < len(terms):
        raise Refused(f"objective must not add the same axes twice, got {text!r}")
    return tuple(terms)
