"""Rms errors and availability of many outcomes, each with its interval."""

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from scipy import special

from startrack.core import Flags, Floats, Ints, Rows, arcsec, printed
from startrack.metrics.judge import STATED_ALONE, ErrorLimits, correct


@dataclass(frozen=True)
class Interval:
    """A statistic, and the interval that contains its true value with 95 % confidence."""

    value: float
    low: float
    high: float


# Mean normalised error squared outside of which a stated covariance is not to be trusted: errors
# are then 1.2 times smaller or larger than stated. Chosen by hand.
NEES_LIMITS = (2.0, 4.5)
BEYOND = 10.0  # stated standard deviations about an axis, by which no noise moves an attitude
CHANCE = 1e-3  # probability below which a mean so far from 3 is no chance


@printed
@dataclass(frozen=True)
class Summary:
    """Statistics of many trials.

    across        radian, rms per axis of the error across the boresight
    about         radian, rms of the error about the boresight
    availability  fraction of trials with a correct attitude, see `correct`
    false         fraction of trials with an attitude that is off by more than half a degree
    nees          1, mean normalised estimation error squared; 3 where the stated covariance is
                  correct
    stars         mean number of matched stars in the solved trials
    trials        number of trials
    beyond        number of attitudes, false ones too, that are off by more than ten of their
                  stated standard deviations about an axis
    inaccurate    fraction of trials with an attitude that is not false, but off by more than is
                  required of it, or by more than five standard deviations that the tracker states
                  where nothing is
    units         number of units of the trials, from which the intervals are; 0: all trials are of
                  the unit as designed
    """

    across: Interval
    about: Interval
    availability: Interval
    false: Interval
    nees: float
    stars: float
    trials: int
    beyond: int
    inaccurate: Interval
    units: int = 0

    @property
    def table(self) -> Rows:
        """One row: each field, and the ends of its interval as NAME_low and NAME_high."""
        return interval_table(self)

    @property
    def _rows(self) -> list[tuple[str, str]]:
        sizes = (
            ("across", self.across, arcsec, "arcsec"),
            ("about", self.about, arcsec, "arcsec"),
            ("available", self.availability, 0.01, "%"),
            ("false", self.false, 0.01, "%"),
        )
        rows = [(name, interval_text(size, unit, text)) for name, size, unit, text in sizes]
        rows += [("stars", f"{self.stars:.1f}"), ("trials", str(self.trials))]
        return [*rows, ("intervals", "95 %")]

    @property
    def doubt(self) -> str:
        """Why the stated covariance is not to be trusted, one sentence; empty where it may be.

        Where the mean normalised error squared lies outside of [2, 4.5], and a sum of chi-squares
        of three degrees of freedom does so by chance in less than one of a thousand campaigns; or
        where attitudes are off by more than ten stated standard deviations.
        """
        reasons = []
        kept = self.availability.value + self.inaccurate.value
        judged = round(self.trials * kept) if self.trials else 0
        low, high = NEES_LIMITS
        if judged and not low <= self.nees <= high:
            tail = special.chdtrc if self.nees > high else special.chdtr
            if tail(3 * judged, judged * self.nees) < CHANCE:
                reasons.append(f"the normalised error squared is {self.nees:.3g} (3 expected)")
        if self.beyond:
            solved = round(self.trials * (kept + self.false.value))
            reasons.append(
                f"{self.beyond} of {solved} attitudes are off by more than ten of their stated "
                "sigma"
            )
        return f"covariance not trustworthy: {' and '.join(reasons)}" if reasons else ""


def interval_text(size: Interval, unit: float, name: str) -> str:
    """A value and its interval in a unit, by the unit's name: '2.1 arcsec [1.9, 2.4]'."""
    value, low, high = (f"{end / unit:.3g}" for end in vars(size).values())
    return f"{value} {name} [{low}, {high}]"


def interval_table(statistics: Any) -> Rows:
    """One row of a dataclass of statistics: each field, and NAME_low and NAME_high of intervals."""
    columns = dict[str, float]()
    for field in fields(statistics):
        value = getattr(statistics, field.name)
        if isinstance(value, Interval):
            name = field.name
            columns |= {name: value.value, f"{name}_low": value.low, f"{name}_high": value.high}
        else:
            columns[field.name] = value
    kind = [(name, np.int64 if isinstance(v, int) else float) for name, v in columns.items()]
    return np.array([tuple(columns.values())], kind)


def summarise(outcomes: Rows, limits: ErrorLimits = STATED_ALONE) -> Summary:
    """Statistics of a structured array with the fields of `Outcome`.

    Errors, `nees` and `stars` are taken over all solved trials that are not false: those that are
    off by more than is required count, too.

    Trials of units are independent from unit to unit alone: see `independent`.

    limits  of a correct attitude
    """
    solved = outcomes[outcomes["solved"] & ~outcomes["false"]]
    across = (solved["error_x"] ** 2 + solved["error_y"] ** 2) / 2
    right, false = correct(outcomes, limits), outcomes["false"]
    inaccurate, unit = outcomes["solved"] & ~false & ~right, units_of(outcomes)
    nees, stars = (
        float(solved[name].mean()) if len(solved) else float("nan") for name in ("nees", "stars")
    )
    return Summary(
        across=rms_interval(independent(across, solved)),
        about=rms_interval(independent(solved["error_z"] ** 2, solved)),
        availability=fraction_of_trials(right, outcomes),
        false=fraction_of_trials(false, outcomes),
        nees=nees,
        stars=stars,
        trials=len(outcomes),
        beyond=beyond_ten_sigma(outcomes[outcomes["solved"]]),
        inaccurate=fraction_of_trials(inaccurate, outcomes),
        units=0 if unit is None else len(np.unique(unit)),
    )


def beyond_ten_sigma(solved: Rows) -> int:
    """`Summary.beyond`, of the trials with an attitude."""
    error, sigma = (
        np.column_stack([solved[f"{of}_{axis}"] for axis in "xyz"]) for of in ("error", "sigma")
    )
    return int((np.abs(error) > BEYOND * sigma).any(axis=1).sum())


def independent(values: Floats, outcomes: Rows) -> Floats:
    """Values (n,) of trials; of trials of units, a value for each unit, with the same mean.

    Trials of one unit share its bias, so that only its sum is independent of other units. The sums
    are divided by the mean number of trials of a unit.

    Accuracy  statistical: 95 % intervals of an rms over 5 to 200 units hold 0.94 to 0.96 where
              units have normal biases. Where the blur of units varies by a lognormal law, so that
              (s / mean)^2 of their mean squares is 2.5, they hold 0.81 to 0.87 with 5 to 50 units
              and 0.90 to 0.92 with 200; trials that are taken as independent hold 0.57 to 0.70.
    """
    unit = units_of(outcomes)
    if unit is None or not len(values):
        return values
    sums = np.bincount(unit, values)
    return np.asarray(sums * (len(sums) / len(values)), np.float64)


def units_of(outcomes: Rows) -> Ints | None:
    """(n,) numbers of the units of trials, counted from 0; None for the unit as designed."""
    if "unit" not in (outcomes.dtype.names or ()):
        return None
    return np.asarray(np.unique(outcomes["unit"], return_inverse=True)[1])


def fraction_of_trials(met: Flags, outcomes: Rows, confidence: float = 0.95) -> Interval:
    """Fraction of the trials, by `fraction_interval` of the effective number of trials."""
    part = effective_part(met, outcomes, confidence)
    return fraction_interval(part * int(met.sum()), part * len(met), confidence)


def effective_part(met: Flags, outcomes: Rows, confidence: float = 0.95) -> float:
    """Effective number of trials for a fraction p of trials, over their number; 1 without units.

        p (1 - p) / var(p) / n (t(n - 1) / t(u - 1))^2,   at most 1

    with n trials of u units, the variance of p by the scatter of its units, and Student's quantiles
    t. If p is 0 or 1, no unit differs, and all trials count.

    Source: Korn and Graubard (1998), Survey Methodology 24, 193.

    Accuracy  statistical: if a fifth of the units fail in all their trials, 95 % intervals hold
              0.97 with 40 units and 0.89 with 10. A kind of unit that fails and of which none is
              drawn is not seen; the yield of the units, with its own interval, counts it.
    """
    n, hits, unit = len(met), int(met.sum()), units_of(outcomes)
    if unit is None or hits in (0, n):
        return 1.0
    beyond, units = np.bincount(unit, met - hits / n), int(unit.max()) + 1
    if units < 2:
        return 1 / n
    variance = units / (units - 1) * float(beyond @ beyond) / n**2
    if not variance:
        return 1.0
    students = special.stdtrit(np.array([n - 1, units - 1]), (1 + confidence) / 2)
    part = hits / n * (1 - hits / n) / variance / n * (students[0] / students[1]) ** 2
    return float(min(part, 1.0))


def rms_interval(squares: Floats, confidence: float = 0.95) -> Interval:
    """Root mean square, with the interval of `mean_bounds`.

    squares  (n,) squared errors
    Returns  Interval; NaN where n is 0, without bounds where n is less than 3
    """
    if len(squares) == 0:
        return Interval(float("nan"), float("nan"), float("nan"))
    tail = (1 - confidence) / 2
    low, high = mean_bounds(squares, tail, tail)
    return Interval(float(squares.mean()) ** 0.5, low**0.5, high**0.5)


def mean_bounds(values: Floats, low_tail: float, high_tail: float) -> tuple[float, float]:
    """`bounds_of_mean` of (n,) values that are not negative."""
    if len(values) < 3:
        return 0.0, math.inf
    mean, variance = float(values.mean()), float(values.var(ddof=1))
    return bounds_of_mean(len(values), mean, variance, low_tail, high_tail)


def bounds_of_mean(
    n: int, mean: float, variance: float, low_tail: float, high_tail: float
) -> tuple[float, float]:
    """Bounds of the mean of skew values that are not negative, each with its tail.

        nu mean / chi2(1 - low_tail', nu),   nu mean / chi2(high_tail', nu)
        nu = 2 n / v,   v = r (1 + 6 r / n),   r = (s / mean)^2

    of n values with the variance s^2: a mean of squares is nearly gamma-distributed with as many
    degrees of freedom as its variance says (Satterthwaite 1946, Biometrics Bulletin 2, 110). Few
    values give too small a variance, the more so the heavier their tail: v, chosen by hand, allows
    for that, and the tails are those of the normal distribution at the quantile of Student's t of
    n - 1 degrees of freedom. The density of chi2 is unbounded at zero for nu < 2: its tail there,
    and with it an upper bound, is the model's alone, so the interval is open.

    Returns   zero and infinity where there are fewer than three; infinity where nu < 2
    Accuracy  statistical: of squares of normal errors, of one or two axes, from 3 values on, 95 %
              intervals hold 0.95 to 0.97; where their sigma varies from trial to trial by a factor
              of exp(0.5) (one standard deviation), 0.93 to 0.96; by exp(0.8), 0.89 to 0.91.
    """
    if n < 3:
        return 0.0, math.inf
    if not variance:
        return mean, mean
    spread = variance / mean**2
    freedom = 2 * n / (spread * (1 + 6 * spread / n))
    # The tails of a normal distribution beyond the quantiles of Student's t.
    low_tail, high_tail = (
        float(special.ndtr(special.stdtrit(n - 1, tail))) for tail in (low_tail, high_tail)
    )
    low = mean * freedom / (2 * float(special.gammainccinv(freedom / 2, low_tail)))
    if freedom < 2:
        return low, math.inf
    return low, mean * freedom / (2 * float(special.gammaincinv(freedom / 2, high_tail)))


def fraction_interval(hits: float, trials: float, confidence: float = 0.95) -> Interval:
    """Fraction of trials with its exact binomial interval.

    Source: Clopper and Pearson (1934), Biometrika 26(4), 404.

    hits, trials  whole numbers; or both times the part of the trials that is as good as all of them
                  would be, were they independent
    """
    if trials == 0:
        return Interval(float("nan"), 0.0, 1.0)
    tail = (1 - confidence) / 2
    low = special.betaincinv(hits, trials - hits + 1, tail) if hits else 0.0
    high = special.betainccinv(hits + 1, trials - hits, tail) if hits < trials else 1.0
    return Interval(hits / trials, float(low), float(high))
