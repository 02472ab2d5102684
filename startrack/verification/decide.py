"""Outcomes and a requirement -> bounds of its statistic, and whether they decide it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, TypeVar

import numpy as np
import scipy

from startrack.core import Flags, Floats, Parameters, Range, Rows, parameter, whole
from startrack.design import Accuracy, Requirements
from startrack.metrics import (
    ErrorLimits,
    Interval,
    correct,
    effective_part,
    fraction_interval,
    independent,
    level_bounds,
    mean_bounds,
    units_of,
)
from startrack.verification.accuracy import REGIONS, measured_over

FEWEST = 10  # least number of solved trials in sky or region for bounds of an rms
MOST = 10**9  # trials; a larger required number is not stated


class Answer(StrEnum):
    """Whether a requirement is met."""

    PASS = "pass"
    FAIL = "fail"
    NOT_SHOWN = "not shown"

    @property
    def in_capitals(self) -> str:
        """The answer as a word, in capitals unless it is a pass."""
        return self.value if self is Answer.PASS else self.value.upper()


def answer_of(parts: Sequence[Answer], left: object) -> Answer:
    """Answer of several requirements: fail if one fails, pass if all pass."""
    if Answer.FAIL in parts:
        return Answer.FAIL
    shown = not left and all(answer is Answer.PASS for answer in parts)
    return Answer.PASS if shown else Answer.NOT_SHOWN


class Looks(Parameters):
    """Looks of a sequential test: numbers of trials, and the error probabilities of the tests.

        n_k = first 2^k,  k = 0 .. K - 1

    A test at one look may wrongly pass with the probability alpha / K, and wrongly fail with alpha
    / (K m). Therefore an unmet requirement passes at some look with a probability of at most alpha.
    The probability that one of m met requirements fails at some look is also at most alpha
    (Bonferroni). The whole verification passes only if all m requirements pass. Therefore its pass
    and its fail, too, are each wrong with a probability of at most alpha.

    first  number of trials at the first look
    most   number of trials at the last look
    alpha  1, one minus the confidence level
    """

    first: int = parameter(limit=Range(2, 10**9), default=256)
    most: int = parameter(limit=Range(high=10**9), default=8192)
    alpha: float = parameter(limit=Range(1e-6, 0.5), default=0.05)

    def __post_init__(self) -> None:
        super().__post_init__()
        whole(self.first, 10**9, most=self.most)

    @property
    def sizes(self) -> list[int]:
        """The numbers of trials."""
        sizes = [self.first]
        while sizes[-1] < self.most:
            sizes.append(min(2 * sizes[-1], self.most))
        return sizes

    @property
    def words(self) -> str:
        """Numbers of trials, and the probability of a wrong verdict."""
        *before, last = map(str, self.sizes)
        tested = (
            f"{', '.join(before)} and {last} trials until decided" if before else f"{last} trials"
        )
        return (
            f"tested at {tested}; a pass or a fail of the whole is wrong with a probability of at "
            f"most {100 * self.alpha:g} %"
        )

    def tails(self, claims: int) -> tuple[float, float]:
        """Probabilities of a wrong pass and of a wrong fail at one look, for one of m claims."""
        return tails(len(self.sizes), self.alpha, claims)


def tails(looks: int, alpha: float, claims: int) -> tuple[float, float]:
    """`Looks.tails` for a number of looks: alpha / K, and alpha / (K m)."""
    tail = alpha / looks
    return tail, tail / max(claims, 1)


class Decidable(Protocol):
    """A requirement that trials can show or refute."""

    @property
    def name(self) -> str:
        """Name of the requirement."""

    def answer(self, bounds: Interval) -> Answer:
        """Decision by the bounds."""


AnyClaim = TypeVar("AnyClaim", bound=Decidable)
Evidence = TypeVar("Evidence")


def decide(
    looks: Looks,
    claims: Sequence[AnyClaim],
    evidence: Callable[[int], Evidence],
    bounds: Callable[[AnyClaim, Evidence], Interval],
) -> tuple[dict[str, tuple[Interval, int]], Evidence]:
    """The bounds of each claim at the look that decides it, or at the last one.

    evidence  number of trials -> their outcomes
    bounds    claim -> its bounds
    Returns   bounds and number of trials, by the names of claims; the evidence at the last look
    """
    decided = dict[str, tuple[Interval, int]]()
    for size in looks.sizes:
        shown = evidence(size)
        for claim in claims:
            if claim.name in decided:
                continue
            found = bounds(claim, shown)
            if claim.answer(found) is not Answer.NOT_SHOWN or size == looks.sizes[-1]:
                decided[claim.name] = found, size
        if len(decided) == len(claims):
            break
    return decided, shown


@dataclass(frozen=True)
class Claim:
    """A requirement that trials can show.

    accuracy  the limit on an error; None for the availability
    least     required fraction of correct attitudes, for the availability
    limits    limits of the errors of a correct attitude
    sky       "whole", or "worst" for an error in the worst region
    """

    accuracy: Accuracy | None
    least: float
    limits: ErrorLimits
    sky: str = "whole"

    @property
    def name(self) -> str:
        """ "across", "about" or "availability"."""
        return self.accuracy.name if self.accuracy else "availability"

    @property
    def limit(self) -> float:
        """Radian, or a fraction."""
        return self.accuracy.most if self.accuracy else self.least

    def bounds(self, outcomes: Rows, boresight: Floats, passing: float, failing: float) -> Interval:
        """The value by trials, the bound that decides a pass, and the bound that decides a fail.

        passing, failing  probabilities that each bound does not hold
        Accuracy          availability and levels: exact for any distribution of independent trials,
                          for trials of units see `effective_part`; for a level per axis,
                          the two axes of a trial count as one. rms: by `mean_bounds`, with a third
                          of the probability for the bound that passes, and half for the bound that
                          fails. Measured in verifications with alpha = 5 % over 100 to 800 trials
                          (in brackets: 1,000 to 8,000): 1.6 % (1.3 %) wrong passes. If the size of
                          errors varies over the sky by a factor of e^0.5 (1 sigma), there are 5.0 %
                          (2.6 %); for e^0.8, 9.9 % (6.9 %). There are at most 2.1 % wrong fails.
        """
        if self.accuracy is None:
            met = correct(outcomes, self.limits)
            part = effective_part(met, outcomes)
            return YieldClaim(self.least).bounds(met, passing, failing, part)
        objective = self.accuracy.objective
        value = measured_over(objective, outcomes, boresight, self.sky)
        if self.sky == "whole":
            parts, failing_each = [outcomes], failing
        else:
            region = REGIONS.of(boresight)
            parts = [outcomes[region == number] for number in range(len(REGIONS))]
            failing_each = failing / len(REGIONS)
        # A pass needs all regions; a fail needs only one.
        ends = [_error_bounds(self.accuracy, part, passing, failing_each) for part in parts]
        return Interval(value, max(low for low, _ in ends), max(high for _, high in ends))

    def answer(self, bounds: Interval) -> Answer:
        """Decision by the bounds."""
        if self.accuracy is None:
            return YieldClaim(self.least).answer(bounds)
        passes, fails = bounds.high <= self.limit, bounds.low > self.limit
        return Answer.PASS if passes else Answer.FAIL if fails else Answer.NOT_SHOWN

    def margin(self, value: float) -> float:
        """Margin of an error as a fraction of its limit; for the availability, the difference."""
        return 1 - value / self.limit if self.accuracy else value - self.limit

    def needed(
        self, outcomes: Rows, boresight: Floats, passing: float, failing: float
    ) -> int | None:
        """Number of trials that would decide it, if further trials are like these.

        None if these do not tell: the value equals the limit, or there are too few errors.
        """
        if self.accuracy is None:
            hits = int(correct(outcomes, self.limits).sum())
            return _needed_hits(hits / len(outcomes), self.least, passing, failing)
        squares = self.accuracy.objective.squares(outcomes)
        if self.sky == "worst":
            region = REGIONS.of(boresight)
            value = [
                float(self.accuracy.objective.of(squares[region == number]))
                for number in range(len(REGIONS))
            ]
            inside = region == int(np.nanargmax(value)) if np.isfinite(value).any() else region < 0
            squares, failing = squares[inside], failing / len(REGIONS)
        finite = squares[_finite(squares)]
        if len(finite) < 2:
            return None
        more = len(outcomes) / len(finite)  # trials for each error that counts
        objective = self.accuracy.objective
        fraction = objective.fraction
        # The limit as a mean square per axis, like `Objective.squares`.
        limit = self.accuracy.most**2 / (len(objective.summed) if objective.radial else 1)
        if fraction is not None:
            enough = _needed_hits(float((finite <= limit).mean()), fraction, passing, failing)
        else:
            mean = float(finite.mean())
            if mean == limit:
                return None
            low, high = mean_bounds(finite, failing / 2, passing / 3)
            # The width of bounds is inversely proportional to the root of the number.
            beyond = ((high if mean < limit else low) - mean) / (limit - mean)
            if not math.isfinite(beyond):  # two errors have no upper bound
                return None
            enough = max(FEWEST, math.ceil(len(finite) * beyond**2))
        return None if enough is None or enough * more > MOST else math.ceil(enough * more)


@dataclass(frozen=True)
class YieldClaim:
    """Claim that a fraction of the units of a design meets a limit on an error.

    least  1, required fraction of the units
    """

    least: float

    def bounds(self, met: Flags, passing: float, failing: float, part: float = 1.0) -> Interval:
        """The yield of n units, the bound that decides a pass, and the bound that decides a fail.

        met               (n,) whether each unit meets the limit
        passing, failing  probabilities that each bound does not hold
        part              effective number of units over n; 1: each unit is known by many trials
        Accuracy          exact; if a unit's error is from few trials, exact for the yield of these
                          measured errors
        """
        hits, n = part * int(met.sum()), part * len(met)
        low = fraction_interval(hits, n, 1 - 2 * passing).low
        return Interval(hits / n, low, fraction_interval(hits, n, 1 - 2 * failing).high)

    def answer(self, bounds: Interval) -> Answer:
        """Decision by the bounds."""
        passes, fails = bounds.low >= self.least, bounds.high < self.least
        return Answer.PASS if passes else Answer.FAIL if fails else Answer.NOT_SHOWN

    def most_beyond(self, n: int, passing: float) -> int:
        """Largest number of n units that may exceed the limit while the yield is still shown."""
        return max(0, int(scipy.stats.binom.ppf(passing, n, 1 - self.least)) - 1)

    def margin(self, value: float) -> float:
        """A yield minus the required yield."""
        return value - self.least

    def needed(self, share: float, passing: float, failing: float) -> int | None:
        """Number of units that would decide it, if further units are like these; None: no
        number."""
        return _needed_hits(share, self.least, passing, failing)


def claims_of(needs: Requirements) -> list[Claim]:
    """Requirements that trials can show: limits of errors, and the availability."""
    errors = [Claim(accuracy, 0.0, needs.limits, needs.sky) for accuracy in needs.accuracy]
    return [*errors, Claim(None, needs.min_availability, needs.limits)]


def _finite(squares: Floats) -> Flags:
    """Whether values (n,) or (n, axes) are not missing; n may be 0."""
    return np.asarray(np.isfinite(squares).all(axis=tuple(range(1, squares.ndim))))


def _error_bounds(
    accuracy: Accuracy, outcomes: Rows, passing: float, failing: float
) -> tuple[float, float]:
    """Lower bound, which decides a fail, and upper bound, which decides a pass; radian."""
    objective = accuracy.objective
    squares = objective.squares(outcomes)
    known = _finite(squares)
    finite, outcomes = squares[known], outcomes[known]
    scale = math.sqrt(len(objective.summed) if objective.radial else 1)
    if objective.fraction is None:
        low, high, alone = 0.0, math.inf, independent(finite, outcomes)
        # Few trials may all lie in one part of the sky; a unit has trials over all of it.
        if len(alone) >= (FEWEST if units_of(outcomes) is None else 3):
            low, high = mean_bounds(alone, failing / 2, passing / 3)
    else:
        unit = units_of(outcomes)
        groups = None if unit is None else len(np.unique(unit))
        low, high = level_bounds(finite, objective.fraction, failing, passing, groups)
    return scale * math.sqrt(low), scale * math.sqrt(high)


def _needed_hits(share: float, required: float, passing: float, failing: float) -> int | None:
    """Number of trials that decide whether a fraction `share` of hits meets the required one."""

    def passes(n: int) -> bool:
        hits = math.floor(share * n)
        return fraction_interval(hits, n, 1 - 2 * passing).low >= required

    def fails(n: int) -> bool:
        hits = math.ceil(share * n)
        return fraction_interval(hits, n, 1 - 2 * failing).high < required

    return _least(passes if share >= required else fails)


def _least(shows: Callable[[int], bool]) -> int | None:
    """Approximate least number at which a condition begins to hold; None if it is above MOST."""
    high = 2
    while not shows(high):
        high *= 2
        if high > MOST:
            return None
    low = high // 2
    while high - low > max(1, low // 100):
        middle = (low + high) // 2
        low, high = (low, middle) if shows(middle) else (middle, high)
    return high
