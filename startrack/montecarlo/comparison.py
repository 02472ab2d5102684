"""The same trials of two campaigns, or at each fidelity -> their statistics and the differences."""

import math
import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy import special

from startrack import metrics
from startrack.core import Advance, Refused, Rows
from startrack.design import Case, Fidelity, Objective
from startrack.trial import run_trials

STATISTICS = (
    Objective("across"),
    Objective("about"),
    Objective("across", 0.9973),
    Objective("across", 0.9973, "per axis"),
)


class Difference(NamedTuple):
    """One statistic of two campaigns, with the 95 % interval of their difference.

    name           in words
    first, second  its values: radian, or a fraction for the availability
    change         second over first of errors; second minus first of the availability
    """

    name: str
    first: float
    second: float
    change: metrics.Interval


def differences(
    first: Rows,
    second: Rows,
    limits: tuple[metrics.ErrorLimits, metrics.ErrorLimits] = (
        metrics.STATED_ALONE,
        metrics.STATED_ALONE,
    ),
    paired: bool = True,
) -> list[Difference]:
    """Errors and availability of two campaigns: ratios of errors, and difference of availability.

    Errors: if paired, over the trials that both solved; intervals as for `Objective.ratio`. Levels
    have unbounded intervals if there are too few trials, or if trials of units depend on each
    other. Trials of units count as one value of each unit. Availability: Agresti and Min (2005),
    Statist. Med. 24, 729, for pairs; else from the two exact intervals of independent fractions
    (Newcombe 1998, Statist. Med. 17, 873, method 10).

    first, second  outcomes; if paired, of the same trials in the same order
    limits         of a correct attitude, for each campaign
    """
    return [*_errors(first, second, paired), _availability((first, second), limits, paired)]


def _errors(first: Rows, second: Rows, paired: bool) -> Iterator[Difference]:
    solved = [outcomes["solved"] & ~outcomes["false"] for outcomes in (first, second)]
    if paired:
        solved = [solved[0] & solved[1]] * 2
    first, second = first[solved[0]], second[solved[1]]
    of_units = any(metrics.units_of(side) is not None for side in (first, second))
    for objective in STATISTICS:
        a, b = objective.squares(first), objective.squares(second)
        before, after = (
            float(objective.of(squares)) if len(squares) else math.nan for squares in (a, b)
        )
        if objective.fraction is None:
            a, b = metrics.independent(a, first), metrics.independent(b, second)
            ratio = objective.ratio([b], [a], paired=paired)
        elif of_units:
            ratio = metrics.Interval(after / before, 0.0, math.inf)
        else:
            ratio = objective.ratio([b], [a], paired=paired)
        yield Difference(str(objective), before, after, ratio)


def _availability(
    sides: tuple[Rows, Rows], limits: tuple[metrics.ErrorLimits, metrics.ErrorLimits], paired: bool
) -> Difference:
    first, second = (metrics.correct(*side) for side in zip(sides, limits, strict=True))
    before, after = float(first.mean()), float(second.mean())
    if paired:
        changed = second & ~first, first & ~second
        gains, losses = (metrics.independent(one.astype(np.float64), sides[0]) for one in changed)
        n = len(gains) + 2
        gained, lost = (float(gains.sum()) + 0.5) / n, (float(losses.sum()) + 0.5) / n
        variance = max(gained + lost - (gained - lost) ** 2, 0.0) / n
        half = float(special.ndtri(0.975)) * math.sqrt(variance)
        change = metrics.Interval(after - before, gained - lost - half, gained - lost + half)
    else:
        a, b = map(metrics.fraction_of_trials, (first, second), sides)
        low = after - before - math.hypot(after - b.low, a.high - before)
        high = after - before + math.hypot(b.high - after, before - a.low)
        change = metrics.Interval(after - before, low, high)
    return Difference("availability", before, after, change)


class FidelityResult(NamedTuple):
    """One fidelity, on some trials.

    fidelity    its name
    seconds     of CPU for a trial, without the first one, which fills the caches
    summary     of its trials; None if it cannot simulate the design
    difference  radian, rms per axis of its errors across minus those of the fidelity `frame`
    refusal     the reason, or empty
    """

    fidelity: Fidelity
    seconds: float
    summary: metrics.Summary | None
    difference: float
    refusal: str

    @property
    def across(self) -> metrics.Interval:
        """Radian, rms per axis."""
        return self.summary.across if self.summary else metrics.Interval(*[math.nan] * 3)


def fidelity_comparison(
    case: Case, seed: int, numbers: Sequence[int], advance: Advance
) -> list[FidelityResult]:
    """Every fidelity on the same trials; `frame`, the reference, is the first."""
    made: list[FidelityResult] = []
    frames: Rows | None = None
    for fidelity in Fidelity:
        try:
            run_trials(case, seed, numbers[:1], fidelity)
        except Refused as error:
            made.append(FidelityResult(fidelity, math.nan, None, math.nan, str(error)))
            advance(len(numbers))
            continue
        began = time.process_time()
        outcomes = run_trials(case, seed, numbers, fidelity)
        seconds = (time.process_time() - began) / len(numbers)
        if frames is None:
            frames = outcomes
        both = outcomes["solved"] & frames["solved"] & ~outcomes["false"] & ~frames["false"]
        between = [outcomes[name][both] - frames[name][both] for name in ("error_x", "error_y")]
        difference = float(np.sqrt(np.mean(np.square(between)))) if both.any() else math.nan
        made.append(FidelityResult(fidelity, seconds, metrics.summarise(outcomes), difference, ""))
        advance(len(numbers))
    return made
