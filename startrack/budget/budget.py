"""Causes of error, and the case without each; Budget: a line for each cause, and the total."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Generic, Protocol, TypeVar

import numpy as np
import scipy
from scipy.special import ndtr

from startrack.core import Floats, Refused, Rows, Unit, arcsec, html_table, printed
from startrack.design import Accuracy, Case
from startrack.metrics import Interpretation, Interval, level, level_bounds, rms_interval
from startrack.response import METHOD, READ, SHOT
from startrack.trial import Term, present


@dataclass(frozen=True)
class Cause:
    """One cause of error.

    name     name of the cause
    term     class of error to which it belongs
    without  function that returns the case without the cause; the sky and all other draws stay the
             same
    """

    name: str
    term: Term
    without: Callable[[Case], Case]


# Causes that every case has: no case can be made without them.
NEIGHBOURS = "neighbours"
ALWAYS = ((SHOT, Term.NOISE), (READ, Term.NOISE), (METHOD, Term.PIXEL), (NEIGHBOURS, Term.FIELD))


def causes(case: Case) -> tuple[Cause, ...]:
    """The causes of a case in the order from pixels to spacecraft, except those of every case."""
    return tuple(
        Cause(effect.cause, effect.term, effect.without)
        for effect in present("cause", case)
        if effect.without
    )


def refuse_scans(case: Case) -> None:
    """Refuse a detector that scans: its frame has no single time to which an attitude refers."""
    if case.instrument.detector.scan:
        raise Refused("detector.scan must be absent for an error budget, got one")


def bare(case: Case) -> Case:
    """The case without any of its causes."""
    for cause in causes(case):
        case = cause.without(case)
    return case


class Spread(Protocol):
    """Distribution of an error about the camera's three axes."""

    def rms(self) -> Floats:
        """(3,) radian."""

    def level(self, axes: Sequence[int], fraction: float, interpretation: Interpretation) -> float:
        """Radian per axis: the level that errors do not exceed in a fraction of the cases."""


S = TypeVar("S", bound=Spread, covariant=True)


@printed
@dataclass(frozen=True, eq=False)
class ErrorLaw:
    """Error predicted by the analytic budget: a normal distribution in each of m fields.

    mean, sigma  (m, 3) radian
    weight       (m,) 1, fraction of each field; sums to 1
    """

    mean: Annotated[Floats, Unit("rad", "arcsec")]
    sigma: Annotated[Floats, Unit("rad", "arcsec")]
    weight: Floats

    def rms(self) -> Floats:
        """(3,) radian."""
        return np.sqrt(self.weight @ (self.mean**2 + self.sigma**2))

    def level(self, axes: Sequence[int], fraction: float, interpretation: Interpretation) -> float:
        """Level of the mixture of all fields.

        Only the mixed interpretation applies, because time and field are not separate.

        Raises  ValueError for another interpretation.
        """
        if interpretation is not Interpretation.MIXED:
            raise Refused(
                "interpretation must be mixed where nothing is simulated, got "
                f"{interpretation.value}"
            )
        mean, sigma = self._normal(axes)
        most = float((mean + 9 * sigma).max())

        def excess(size: float) -> float:
            return self._share(size, mean, sigma) - fraction

        return float(scipy.optimize.brentq(excess, 0.0, most, rtol=1e-9))

    def share_within(self, size: float, axes: Sequence[int]) -> float:
        """Fraction of the errors about some axes that are at most `size`, radian."""
        return self._share(size, *self._normal(axes))

    def _share(self, size: float, mean: Floats, sigma: Floats) -> float:
        inside = ndtr((size - mean) / sigma) - ndtr((-size - mean) / sigma)
        return float(self.weight @ inside.mean(axis=1))

    def _normal(self, axes: Sequence[int]) -> tuple[Floats, Floats]:
        """Absolute mean, and sigma with a tiny lower limit; both (m, axes) radian."""
        return np.abs(self.mean[:, axes]), np.maximum(self.sigma[:, axes], 1e-15)


@printed
@dataclass(frozen=True, eq=False)
class SkySample:
    """Errors from simulated trials.

    error  (members, times, 3) radian
    """

    error: Annotated[Floats, Unit("rad", "arcsec")]

    def rms(self) -> Floats:
        """(3,) radian."""
        return np.sqrt((self.error**2).mean(axis=(0, 1)))

    def level(self, axes: Sequence[int], fraction: float, interpretation: Interpretation) -> float:
        """As `startrack.metrics.level`; the errors about each axis count as separate members."""
        chosen = np.concatenate([self.error[..., axis] for axis in axes])
        return level(chosen, fraction, interpretation)

    def rms_interval(self, axes: Sequence[int]) -> Interval:
        """Rms per axis, radian, with its 95 % interval; each member counts as one sample."""
        return rms_interval((self.error[..., list(axes)] ** 2).mean(axis=(1, 2)))

    def level_interval(self, axes: Sequence[int], fraction: float) -> Interval:
        """Mixed level, radian, with its 95 % interval.

        It has no upper bound if there are too few members.
        """
        squares = self.error[..., list(axes)].reshape(len(self.error), -1) ** 2
        low, high = level_bounds(squares, fraction, 0.025, 0.025)
        value = self.level(axes, fraction, Interpretation.MIXED)
        return Interval(value, low**0.5, high**0.5)


@dataclass(frozen=True, eq=False)
class BudgetLine(Generic[S]):
    """The error by one cause, or by the sum of several causes.

    name    name of the cause or sum
    term    class of error to which the cause belongs; None for a sum
    spread  distribution of the error
    """

    name: str
    term: Term | None
    spread: S

    @property
    def across(self) -> float:
        """Radian, rms per axis across the boresight."""
        x, y, _ = self.spread.rms()
        return float(np.sqrt((x * x + y * y) / 2))

    @property
    def about(self) -> float:
        """Radian, rms about the boresight."""
        return float(self.spread.rms()[2])


@printed
@dataclass(frozen=True, eq=False)
class Budget(Generic[S]):
    """An error budget.

    lines         one for each cause
    whole         the error end to end, by all causes
    availability  1, fraction of the sky and time with a correct attitude. As in trials, an attitude
                  is correct if its error lies within five stated standard deviations. A budget by
                  trials counts every attitude
    stars         mean number of detected stars where there is an attitude
    left_out      phrases: effects of this design that the budget leaves out
    refused       1, fraction of the stars above the threshold that are rejected as hot pixels; in
                  analytic budgets only
    covered       (m, 2) 1, probability in each field of `whole` that the errors across and about
                  lie within the stated ones; None: the probability is 1
    solved        1, fraction of the sky with any attitude; None: every attitude is correct
    """

    lines: tuple[BudgetLine[S], ...]
    whole: BudgetLine[S]
    availability: float
    stars: float
    left_out: tuple[str, ...] = ()
    refused: float = 0.0
    covered: Floats | None = None
    solved: float | None = None

    @property
    def table(self) -> Rows:
        """A row for each line and for the whole: cause, term, rms across and about in radian."""
        kind = [("cause", "U64"), ("term", "U32"), ("across", float), ("about", float)]
        rows = [
            (line.name, line.term.value if line.term else "", line.across, line.about)
            for line in (*self.lines, self.whole)
        ]
        return np.array(rows, kind)

    @property
    def _rows(self) -> list[tuple[str, str]]:
        return [
            ("across", f"{self.across / arcsec:.3g} arcsec"),
            ("about", f"{self.about / arcsec:.3g} arcsec"),
            ("attitude", f"{100 * self.availability:.4g} %"),
            ("stars", f"{self.stars:.1f}"),
        ]

    def _repr_html_(self) -> str:
        rows = [
            (str(row["cause"]), f"{row['across'] / arcsec:.3f}", f"{row['about'] / arcsec:.3f}")
            for row in self.table
        ]
        title = (
            f"Error budget; attitude in {100 * self.availability:.4g} % of the sky and time, "
            f"{self.stars:.1f} stars"
        )
        head = ("cause", "across, arcsec rms per axis", "about, arcsec rms")
        return html_table(title, rows, head)

    @property
    def across(self) -> float:
        """Radian, rms per axis across the boresight, end to end."""
        return self.whole.across

    @property
    def about(self) -> float:
        """Radian, rms about the boresight, end to end."""
        return self.whole.about

    @property
    def sum(self) -> tuple[float, float]:
        """Radian, across and about: the root sum of squares of all lines."""
        across = sum(line.across**2 for line in self.lines)
        return across**0.5, sum(line.about**2 for line in self.lines) ** 0.5

    def term(self, term: Term) -> tuple[float, float]:
        """Radian, across and about: the root sum of squares of all lines of a term."""
        lines = [line for line in self.lines if line.term is term]
        across = sum(line.across**2 for line in lines)
        return across**0.5, sum(line.about**2 for line in lines) ** 0.5


def errors_text(across: float, about: float, required: Sequence[Accuracy], form: str) -> str:
    """Rms errors (radian) across and about the boresight, each with its required limit.

    form  format of the numbers, such as ".3f"
    """
    limits = {limit.name: limit.most for limit in required if limit.objective.rms_per_axis}
    allowed = {name: f" ({most / arcsec:g} allowed)" for name, most in limits.items()}
    errors = (
        f"{value / arcsec:{form}} arcsec {name}{allowed.get(name, '')}"
        for name, value in (("across", across), ("about", about))
    )
    return f"error {' and '.join(errors)} the boresight, rms per axis"


def answer(expected: Budget[ErrorLaw], required: Sequence[Accuracy]) -> str:
    """A sentence: the error with its limits, its largest cause, and the availability."""
    errors = errors_text(expected.across, expected.about, required, ".3f")
    largest = max(expected.lines, key=lambda line: line.across)
    return (
        f"{errors}, as designed; most of it across is {largest.name}; available in "
        f"{100 * expected.availability:.2f} % of the sky"
    )
