"""Fresh units of a design -> the level that a fraction of them keeps, and their yields."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from scipy.special import polygamma

from startrack.budget import UnitBudgets, joined
from startrack.core import Advance, Floats, Ints, Rows, Unit, printed
from startrack.design import Accuracy, Campaign, Case, Judged, Objective, OverUnits
from startrack.metrics import Interval, quantile_of_few, resampled_interval
from startrack.optimise.budgets import budgets_of_units
from startrack.optimise.runner import FRESH_UNIT, TrialRunner
from startrack.population import Units, middle_of, unit_errors
from startrack.verification import units_expected, yield_of

ENVIRONMENTS = 4  # of each fresh unit; chosen by hand: time against the rms of a unit
RESAMPLES = 1000
# Standard errors of a variance of normal values, by which the noise of few trials may be less than
# is taken off; chosen by hand: intervals of levels, factors and yields then hold what they say.
NOT_KNOWN = 1.5
BOOTSTRAP = 3  # names the stream of the resampling


def how(units: OverUnits, campaign: Campaign) -> Units:
    """Order of the trials of fresh units."""
    trials = campaign.trials_per_unit
    return Units(trials, min(ENVIRONMENTS, trials), units.age)


def fresh_units(
    condition: Judged,
    campaign: Campaign,
    runner: TrialRunner,
    count: int | None = None,
    first: int = FRESH_UNIT,
    watch: Advance | None = None,
) -> Rows:
    """The outcomes of trials of units that no tuning used, in the campaign's fidelity.

    condition  which is judged over units
    count      units; None: those of the campaign
    first      number of the first unit
    watch      called with the number of trials that were just done
    """
    assert condition.units is not None
    order = how(condition.units, campaign)
    count = count or campaign.fresh_units
    many, begin = count * order.trials, first * order.trials
    return runner.run(condition.case, many, campaign.fidelity, begin, watch, order)


def errors_of(objective: Objective, outcomes: Rows, units: OverUnits, campaign: Campaign) -> Floats:
    """The objective (n,) of each fresh unit, radian; infinite where no trial is solved."""
    errors = unit_errors(objective, outcomes, outcomes["trial"] // how(units, campaign).trials)
    return np.where(np.isnan(errors), np.inf, errors)


def noise_of(objective: Objective, outcomes: Rows, units: OverUnits, campaign: Campaign) -> float:
    """Variance of ln(error) of a fresh unit, in the mean over these, by how few its trials are.

        x = sum over environments (sum of its (q_i - q))^2 / (n q)^2 g / (g - 1)
        variance = trigamma(1 / x - 1) / 4

    of the n squares q_i of a unit in g environments, whose trials have part of the error in common,
    and their mean q, which has a gamma distribution of the shape k: the mean of x is 1 / (k + 1).
    Zero for an error that a fraction of the trials does not exceed.
    """
    if objective.fraction is not None:
        return 0.0
    order = how(units, campaign)
    squares = objective.as_one_square(objective.squares(outcomes)).reshape(-1, order.trials)
    mean = np.nanmean(squares, axis=1, keepdims=True)
    apart = np.nan_to_num(squares / mean - 1)
    environment = np.arange(order.trials) * order.environments // order.trials
    begin = np.unique(environment, return_index=True)[1]
    sums = np.add.reduceat(apart, begin, axis=1)
    groups = sums.shape[1]
    if groups < 2:
        return 0.0
    part = float((sums**2).sum(axis=1).mean()) / order.trials**2 * groups / (groups - 1)
    return float(polygamma(1, 1 / part - 1)) / 4 if part else 0.0


@dataclass(frozen=True)
class UnitYield:
    """Share of the fresh units of start and best that keep a limit, with 95 % intervals."""

    accuracy: Accuracy
    start: Interval
    best: Interval


@printed
@dataclass(frozen=True)
class ComparedUnits:
    """Start and best over the same fresh units.

    over       which units
    count      fresh units
    trials     of each
    start, best  radian, level of the objective that the asked fraction does not exceed
    predicted  radian, that of the best by the search
    yields     of the limits that are required in the design's own condition; without any, of the
               predicted level of the best
    factor     level of the start over that of the best
    optimism   level of the best over the predicted one
    """

    over: OverUnits
    count: int
    trials: int
    start: Annotated[Interval, Unit("rad", "arcsec")]
    best: Annotated[Interval, Unit("rad", "arcsec")]
    predicted: Annotated[float, Unit("rad", "arcsec")]
    yields: tuple[UnitYield, ...]
    factor: Interval
    optimism: Interval


def compare_units(
    campaign: Campaign,
    start: tuple[Sequence[Judged], Sequence[Rows]],
    best: tuple[Sequence[Judged], Sequence[Rows]],
    predicted: float,
    runner: TrialRunner,
) -> ComparedUnits | None:
    """Start and best by their fresh units, in the conditions that have a weight; the own one first.

    Intervals of levels and of their ratio are those of `compared_levels`; those of yields are exact
    for as many units as `MeasuredUnits.part` says.

    Returns  None where they are judged as designed
    """
    over = best[0][0].units
    if over is None:
        return None
    objective = campaign.goal
    weights, n = [condition.weight for condition in best[0]], campaign.fresh_units
    chosen = resampled_units(n, runner.seed)
    before, after = (
        levels_of(
            objective, _measured(objective, *side, campaign, runner), weights, over.fraction, chosen
        )
        for side in (start, best)
    )
    found = compared_levels(before, after, n, over.fraction)
    limits = best[0][0].needs.accuracy or (Accuracy(objective, predicted),)
    yields = []
    for limit in limits:
        sides = (
            likely_units(limit.objective, conditions[0], rows[0], campaign, runner)
            for conditions, rows in (start, best)
        )
        shares = (
            yield_of(limit, units.likely, units.part(limit.most, runner.seed)) for units in sides
        )
        yields.append(UnitYield(limit, *shares))
    return ComparedUnits(
        over,
        n,
        campaign.trials_per_unit,
        found.start,
        found.best,
        predicted,
        tuple(yields),
        found.factor,
        Interval(*(bound / predicted for bound in vars(found.best).values())),
    )


class MeasuredUnits(NamedTuple):
    """An error of n units by few trials.

    error     (n,) radian, of each
    expected  (n,) radian, of each by its budget; ones where there are none
    noise     1, variance of ln(error) of a unit, by how few its trials are
    """

    error: Floats
    expected: Floats
    noise: float

    def freed(self, chosen: Ints) -> Floats:
        """`without_noise` of some choices (..., n) of units."""
        return without_noise(self.error[chosen], self.expected[chosen], self.noise)

    @property
    def likely(self) -> Floats:
        """The error (n,) of each, as spread as many trials would show."""
        return self.freed(np.arange(len(self.error)))

    @property
    def more_spread(self) -> Floats:
        """Like `likely`, with less noise: the least that its standard error allows."""
        if not self.noise or len(self.error) < 2:
            return self.likely
        variance = float(np.log(self.error / self.expected).var(ddof=1))
        apart = NOT_KNOWN * math.sqrt(2 / (len(self.error) - 1)) * max(variance, self.noise)
        # No noise at all would leave the errors as they are, whatever their scale.
        less = max(self.noise - apart, 1e-9 * self.noise)
        return without_noise(self.error, self.expected, less)

    def part(self, most: float, seed: int) -> float:
        """Part of the units that says as much of a yield, were each known by many trials.

            var_binomial / var,   at most 1

        with the variance of the yield over resamples of the units, and by what noise is not known.

        most  radian, the limit that they keep
        """
        n = len(self.error)
        if not self.noise:
            return 1.0
        shares = (self.freed(resampled_units(n, seed)) <= most).mean(axis=-1)
        apart = float((self.more_spread <= most).mean() - shares[0])
        some = min(max(float(shares[0]), 0.5 / n), 1 - 0.5 / n)
        return min(1.0, some * (1 - some) / n / max(float(shares[1:].var()) + apart**2, 1e-300))


def level_interval_of_units(
    objective: Objective,
    judged: Sequence[Judged],
    outcomes: Sequence[Rows],
    campaign: Campaign,
    runner: TrialRunner,
) -> Interval:
    """The level over units, radian, as the objective's mean over conditions, with its interval.

    judged, outcomes  conditions, and the outcomes of the fresh units in each
    """
    measured, units = _measured(objective, judged, outcomes, campaign, runner), judged[0].units
    assert units is not None
    weights = [condition.weight for condition in judged]
    chosen = resampled_units(len(measured[0].error), runner.seed)
    count = len(measured[0].error)
    level = levels_of(objective, measured, weights, units.fraction, chosen)
    return compared_levels(level, level, count, units.fraction).best


def likely_units(
    objective: Objective, condition: Judged, outcomes: Rows, campaign: Campaign, runner: TrialRunner
) -> MeasuredUnits:
    """The fresh units of a condition, by an objective.

    As `errors_of`, without noise, where some of their trials are left out.
    """
    assert condition.units is not None
    trials, each = outcomes["trial"], how(condition.units, campaign).trials
    if not len(trials) or len(trials) % each or (np.diff(trials) != 1).any():
        errors = errors_of(objective, outcomes, condition.units, campaign)
        return MeasuredUnits(errors, np.ones(len(errors)), 0.0)
    [units] = _measured(objective, [condition], [outcomes], campaign, runner)
    return units


def _measured(
    objective: Objective,
    judged: Sequence[Judged],
    outcomes: Sequence[Rows],
    campaign: Campaign,
    runner: TrialRunner,
) -> list[MeasuredUnits]:
    return [
        MeasuredUnits(
            errors_of(objective, rows, condition.units, campaign),
            _expected(objective, condition, rows, campaign, runner),
            noise_of(objective, rows, condition.units, campaign),
        )
        for condition, rows in zip(judged, outcomes, strict=True)
        if len(rows) and condition.units
    ]


def _expected(
    objective: Objective, condition: Judged, outcomes: Rows, campaign: Campaign, runner: TrialRunner
) -> Floats:
    """The objective (n,) that budgets expect of each unit; ones where each would take long."""
    assert condition.units is not None
    order, age = how(condition.units, campaign), condition.units.age
    count = len(outcomes) // order.trials
    if middle_of(condition.case, age) is None or objective.fraction is not None:
        return np.ones(count)
    first = int(outcomes["trial"][0]) // order.trials
    size = math.ceil(count / runner.workers)
    blocks = [
        (condition.case, runner.seed, age, first + at, min(size, count - at), order.environments)
        for at in range(0, count, size)
    ]
    parts = runner.recall(_budgets, blocks)
    solved = [part for part in parts if part is not None]
    some_lost = len(solved) < len(parts)
    return np.ones(count) if some_lost else units_expected(objective, joined(solved))


Block = tuple[Case, int, float, int, int, int]  # the arguments of `budgets_of_units`


def _budgets(block: Block) -> UnitBudgets | None:
    return budgets_of_units(*block)


def resampled_units(count: int, seed: int, stream: int = BOOTSTRAP) -> Ints:
    """(1 + RESAMPLES, n) all units, then units with repetition."""
    rng = np.random.default_rng(np.random.SeedSequence((seed, stream)))
    return np.vstack([np.arange(count), rng.integers(0, count, (RESAMPLES, count))])


class Compared(NamedTuple):
    """Levels of start and best over the same units, radian, and their ratio."""

    start: Interval
    best: Interval
    factor: Interval


class Levels(NamedTuple):
    """A level over units, as the objective's mean over conditions.

    logs   (1 + resamples,) ln(radian) of all units, and of each choice of them; NaN where a
           condition has no trials
    model  by how much it may be larger, as the noise of few trials is not known
    """

    logs: Floats
    model: float


def levels_of(
    objective: Objective,
    measured: Sequence[MeasuredUnits],
    weights: Sequence[float],
    fraction: float,
    chosen: Ints,
) -> Levels:
    """The level of some choices of units; the first is of all."""
    if len(measured) < len(weights):
        return Levels(np.full(len(chosen), np.nan), 0.0)
    levels = np.stack([quantile_of_few(units.freed(chosen), fraction) for units in measured], -1)
    over = [objective.over(each, weights) for each in levels.tolist()]
    logs, model = np.log(over), 0.0
    if math.isfinite(logs[0]) and any(units.noise for units in measured):
        more = [float(quantile_of_few(units.more_spread, fraction)) for units in measured]
        model = math.log(objective.over(more, weights)) - float(logs[0])
    return Levels(logs, model)


def compared_levels(before: Levels, after: Levels, count: int, fraction: float) -> Compared:
    """Levels of start and best, and their ratio, with 95 % intervals.

    count     units
    fraction  of them, which do not exceed the levels
    Returns   without bounds where less than one unit is expected beyond the levels
    Accuracy  statistical: of 20 to 200 units by 3 trials each, whose noise is up to four times what
              units differ by, intervals of levels and of ratios hold 0.92 to 1.
    """
    freedom = 2 * count * (1 - fraction)
    ratio = freedom + 1 if freedom >= 2 - 1e-9 else 0.0  # what both have in common does not count
    both = math.hypot(before.model, after.model)
    return Compared(
        interval_of(before.logs, freedom, before.model),
        interval_of(after.logs, freedom, after.model),
        interval_of(before.logs - after.logs, ratio, both),
    )


def without_noise(errors: Floats, expected: Floats, noise: float) -> Floats:
    """Errors (..., n) of units with the spread that they would have by many trials.

        r = ln(e / expected),   ln(e' / expected) = c + m + sqrt(max(1 - noise / v, 0)) (r - m)

    with the mean m and the variance v of the r, and c such that the mean square of the errors
    stays, which has no bias: the noise of few trials would make the level of a large fraction of
    the units too large. What budgets expect of the units needs no trials to be told from noise.

    expected  (..., n) of each unit, on any scale
    noise     1, variance of ln e that few trials make
    Accuracy  model: the law of the r keeps its shape. Of 75 units by 3 trials each, where budgets
              err by 10 % of a unit, the level is 1 % too large and scatters by 7.3 %; with 8 trials
              each 7.1 %, as that of the units themselves does.
    """
    if not (noise and np.isfinite(errors).all()):
        return errors
    logs = np.log(errors / expected)
    mean, variance = logs.mean(axis=-1, keepdims=True), logs.var(axis=-1, ddof=1, keepdims=True)
    part = np.sqrt(np.maximum(1 - noise / np.maximum(variance, 1e-300), 0.0))
    freed = expected * np.exp(part * (logs - mean))
    before, after = ((values**2).mean(axis=-1, keepdims=True) for values in (errors, freed))
    return np.asarray(freed * np.sqrt(before / after))


def interval_of(logs: Floats, freedom: float, model: float) -> Interval:
    """A positive statistic, by `resampled_interval` of its logarithms."""
    bounds = vars(resampled_interval(logs, freedom, model)).values()
    return Interval(*(math.exp(min(end, 700)) if end < math.inf else end for end in bounds))


def units_for_interval(fraction: float) -> int:
    """The least number of units that bound a level."""
    return math.ceil(1 / (1 - fraction) - 1e-9)
