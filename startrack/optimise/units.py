"""Fresh units of a design -> error that a fraction of them does not exceed, and their yields."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from scipy.special import polygamma

from startrack.budget import UnitBudgets, joined
from startrack.core import Advance, Floats, Ints, Refused, Rows, Unit, printed
from startrack.design import Accuracy, Campaign, Case, Judged, Objective, OverUnits
from startrack.metrics import Interval, quantile_of_few, resampled_interval
from startrack.optimise.budgets import budgets_of_units
from startrack.optimise.runner import FRESH_UNIT, TrialRunner
from startrack.population import Units, middle_of, unit_errors
from startrack.verification import units_expected, yield_of

ENVIRONMENTS = 4  # of each fresh unit; chosen by hand: time against the error of the rms of a unit
RESAMPLES = 1000
# Number of standard errors by which the estimated noise variance of few trials may be too large.
# Chosen by hand: intervals of levels, factors and yields then have their coverage.
NOISE_ERROR = 1.5
BOOTSTRAP = 3  # number of the random stream of the resampling


def trial_order(units: OverUnits, campaign: Campaign) -> Units:
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
    """Outcomes of trials of units that no search has used, in the campaign's fidelity.

    condition  a condition that is judged over units
    count      number of units; None: that of the campaign
    first      number of the first unit
    watch      called with the number of trials that were just done
    """
    assert condition.units is not None
    order = trial_order(condition.units, campaign)
    count = count or campaign.fresh_units
    many, begin = count * order.trials, first * order.trials
    return runner.run(condition.case, many, campaign.fidelity, begin, watch, order)


def unit_objectives(
    objective: Objective, outcomes: Rows, units: OverUnits, campaign: Campaign
) -> Floats:
    """The objective (n,) of each fresh unit, radian; infinite where no trial is solved."""
    errors = unit_errors(
        objective, outcomes, outcomes["trial"] // trial_order(units, campaign).trials
    )
    return np.where(np.isnan(errors), np.inf, errors)


def trial_noise(
    objective: Objective, outcomes: Rows, units: OverUnits, campaign: Campaign
) -> float:
    """Mean variance of ln(error) of a fresh unit that the small number of its trials causes.

        x = sum over environments (sum of its (q_i - q))^2 / (n q)^2 g / (g - 1)
        variance = trigamma(1 / x - 1) / 4

    where q_i are the n squared errors of a unit in g environments, and q is their mean. The trials
    of an environment have part of the error in common. The mean q has a gamma distribution of
    shape k, with which the mean of x is 1 / (k + 1).

    Units without any attitude do not count.

    Returns  1; zero for an error that a fraction of the trials does not exceed, and without a unit
    """
    if objective.fraction is not None:
        return 0.0
    order = trial_order(units, campaign)
    squares = objective.as_one_square(objective.squares(outcomes)).reshape(-1, order.trials)
    squares = squares[np.isfinite(squares).any(axis=1)]
    if not len(squares):
        return 0.0
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
    """Fraction of the fresh units of start and best that keep a limit, with 95 % intervals."""

    accuracy: Accuracy
    start: Interval
    best: Interval


@printed
@dataclass(frozen=True)
class ComparedUnits:
    """Start and best over the same fresh units.

    over       age and fraction of the units
    count      number of fresh units
    trials     of each unit
    start, best  radian, level of the objective that the required fraction does not exceed
    predicted  radian, level of the best design as the search predicts it
    yields     for each limit in the design's own condition; without any limit, for the predicted
               level of the best design
    factor     1, level of the start over that of the best
    optimism   1, level of the best over the predicted level
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
    """Compare start and best by their fresh units.

    Intervals of levels and of their ratio are those of `compare_levels`. Intervals of yields are
    exact for the effective number of units, see `MeasuredUnits.effective_fraction`.

    start, best  conditions that have a weight, and the outcomes in each; the design's own first
    predicted    radian, level of the best design as the search predicts it
    Returns      None where the designs are judged as designed
    """
    over = best[0][0].units
    if over is None:
        return None
    objective = campaign.goal
    weights, n = [condition.weight for condition in best[0]], campaign.fresh_units
    chosen = resampled_units(n, runner.seed)
    before, after = (
        levels_of(
            objective,
            _measured_by_condition(objective, *side, campaign, runner),
            weights,
            over.fraction,
            chosen,
        )
        for side in (start, best)
    )
    found = compare_levels(before, after, n, over.fraction)
    limits = best[0][0].needs.accuracy or (Accuracy(objective, predicted),)
    yields = []
    for limit in limits:
        sides = (
            measured_units(limit.objective, conditions[0], rows[0], campaign, runner)
            for conditions, rows in (start, best)
        )
        shares = (
            yield_of(limit, units.denoised, units.effective_fraction(limit.most, runner.seed))
            for units in sides
        )
        yields.append(UnitYield(limit, *shares))
    return ComparedUnits(
        over=over,
        count=n,
        trials=campaign.trials_per_unit,
        start=found.start,
        best=found.best,
        predicted=predicted,
        yields=tuple(yields),
        factor=found.factor,
        optimism=Interval(*(bound / predicted for bound in vars(found.best).values())),
    )


class MeasuredUnits(NamedTuple):
    """Errors of n units, measured by few trials.

    error     (n,) radian, of each unit
    expected  (n,) radian, of each unit by its budget; ones where there is no budget
    noise     1, variance of ln(error) of a unit that the small number of its trials causes
    """

    error: Floats
    expected: Floats
    noise: float

    def noise_removed(self, chosen: Ints) -> Floats:
        """Errors (..., n) of choices of units without noise, see `without_noise`."""
        return without_noise(self.error[chosen], self.expected[chosen], self.noise)

    @property
    def denoised(self) -> Floats:
        """Error (n,) of each unit, with the spread that many trials would show."""
        return self.noise_removed(np.arange(len(self.error)))

    @property
    def least_denoised(self) -> Floats:
        """Like `denoised`, for the least noise variance that its standard error allows."""
        if not self.noise or len(self.error) < 2:
            return self.denoised
        variance = float(np.log(self.error / self.expected).var(ddof=1))
        apart = NOISE_ERROR * math.sqrt(2 / (len(self.error) - 1)) * max(variance, self.noise)
        # Without any noise, `without_noise` would return the errors unchanged.
        less = max(self.noise - apart, 1e-9 * self.noise)
        return without_noise(self.error, self.expected, less)

    def effective_fraction(self, most: float, seed: int) -> float:
        """Effective number of units for a yield, over the number of units.

            var_binomial / var,   at most 1

        Units with many trials have the variance var_binomial. The variance var is that over
        resamples of the units, plus the error by the uncertain noise variance.

        most  radian, the limit of the yield
        seed  of the resamples
        """
        n = len(self.error)
        if not self.noise:
            return 1.0
        shares = (self.noise_removed(resampled_units(n, seed)) <= most).mean(axis=-1)
        apart = float((self.least_denoised <= most).mean() - shares[0])
        some = min(max(float(shares[0]), 0.5 / n), 1 - 0.5 / n)
        return min(1.0, some * (1 - some) / n / max(float(shares[1:].var()) + apart**2, 1e-300))


def level_interval_of_units(
    objective: Objective,
    judged: Sequence[Judged],
    outcomes: Sequence[Rows],
    campaign: Campaign,
    runner: TrialRunner,
) -> Interval:
    """The level over units, radian, with its interval.

    The level is the objective's mean over conditions.

    judged, outcomes  conditions, and the outcomes of the fresh units in each
    """
    measured, units = (
        _measured_by_condition(objective, judged, outcomes, campaign, runner),
        judged[0].units,
    )
    assert units is not None
    weights = [condition.weight for condition in judged]
    chosen = resampled_units(len(measured[0].error), runner.seed)
    count = len(measured[0].error)
    level = levels_of(objective, measured, weights, units.fraction, chosen)
    return compare_levels(level, level, count, units.fraction).best


def measured_units(
    objective: Objective, condition: Judged, outcomes: Rows, campaign: Campaign, runner: TrialRunner
) -> MeasuredUnits:
    """An objective of the fresh units of a condition.

    Where trials of a unit are missing, no noise is estimated, and the errors are those of
    `unit_objectives`.
    """
    assert condition.units is not None
    trials, each = outcomes["trial"], trial_order(condition.units, campaign).trials
    if not len(trials) or len(trials) % each or (np.diff(trials) != 1).any():
        errors = unit_objectives(objective, outcomes, condition.units, campaign)
        return MeasuredUnits(errors, np.ones(len(errors)), 0.0)
    [units] = _measured_by_condition(objective, [condition], [outcomes], campaign, runner)
    return units


def _measured_by_condition(
    objective: Objective,
    judged: Sequence[Judged],
    outcomes: Sequence[Rows],
    campaign: Campaign,
    runner: TrialRunner,
) -> list[MeasuredUnits]:
    return [
        MeasuredUnits(
            unit_objectives(objective, rows, condition.units, campaign),
            _budgeted(objective, condition, rows, campaign, runner),
            trial_noise(objective, rows, condition.units, campaign),
        )
        for condition, rows in zip(judged, outcomes, strict=True)
        if len(rows) and condition.units
    ]


def _budgeted(
    objective: Objective, condition: Judged, outcomes: Rows, campaign: Campaign, runner: TrialRunner
) -> Floats:
    """Objective (n,) of each unit by its budget; ones where budgets would take too long."""
    assert condition.units is not None
    order, age = trial_order(condition.units, campaign), condition.units.age
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
    solved = [part for part in parts if not isinstance(part, Refused)]
    some_lost = len(solved) < len(parts)
    return np.ones(count) if some_lost else units_expected(objective, joined(solved))


Block = tuple[Case, int, float, int, int, int]  # the arguments of `budgets_of_units`


def _budgets(block: Block) -> UnitBudgets | Refused:
    return budgets_of_units(*block)


def resampled_units(count: int, seed: int, stream: int = BOOTSTRAP) -> Ints:
    """Numbers (1 + RESAMPLES, n) of units: first all units, then resamples with repetition."""
    rng = np.random.default_rng(np.random.SeedSequence((seed, stream)))
    return np.vstack([np.arange(count), rng.integers(0, count, (RESAMPLES, count))])


class ComparedLevels(NamedTuple):
    """Levels of start and best over the same units, radian, and their ratio."""

    start: Interval
    best: Interval
    factor: Interval


class Levels(NamedTuple):
    """A level over units: the objective's mean over conditions.

    logs   (1 + resamples,) ln(radian): of all units, then of each resample; NaN where a condition
           has no trials
    model  1, largest increase of ln(level) by the uncertain noise variance of few trials
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
    """The level of each choice of units; the first choice is all units."""
    if len(measured) < len(weights):
        return Levels(np.full(len(chosen), np.nan), 0.0)
    levels = np.stack(
        [quantile_of_few(units.noise_removed(chosen), fraction) for units in measured], -1
    )
    over = [objective.over(each, weights) for each in levels.tolist()]
    logs, model = np.log(over), 0.0
    if math.isfinite(logs[0]) and any(units.noise for units in measured):
        more = [float(quantile_of_few(units.least_denoised, fraction)) for units in measured]
        model = math.log(objective.over(more, weights)) - float(logs[0])
    return Levels(logs, model)


def compare_levels(before: Levels, after: Levels, count: int, fraction: float) -> ComparedLevels:
    """Levels of start and best, and their ratio, with 95 % intervals.

    count     number of units
    fraction  of the units, which does not exceed the levels
    Returns   intervals without bounds where less than one unit is expected beyond the levels
    Accuracy  statistical: of 20 to 200 units with 3 trials each, whose noise is up to four times
              the differences between units, intervals of levels and of ratios have a coverage of
              0.92 to 1.
    """
    freedom = 2 * count * (1 - fraction)
    ratio = freedom + 1 if freedom >= 2 - 1e-9 else 0.0  # common errors do not count
    both = math.hypot(before.model, after.model)
    return ComparedLevels(
        interval_of_logs(before.logs, freedom, before.model),
        interval_of_logs(after.logs, freedom, after.model),
        interval_of_logs(before.logs - after.logs, ratio, both),
    )


def without_noise(errors: Floats, expected: Floats, noise: float) -> Floats:
    """Errors (..., n) of units with the spread that many trials would show.

        r = ln(e / expected),   ln(e' / expected) = c + m + sqrt(max(1 - noise / v, 0)) (r - m)

    m and v are the mean and the variance of the r. The constant c keeps the mean square of the
    errors, which has no bias. Without the correction, the noise of few trials makes the level of a
    large fraction of the units too large. Differences that budgets expect between units are kept.

    expected  (..., n) error of each unit by its budget, on any scale
    noise     1, variance of ln e that the small number of trials causes
    Accuracy  model: the law of the r keeps its shape. Of 75 units with 3 trials each, whose budgets
              have errors of 10 %, the level is 1 % too large and has a standard deviation of 7.3 %;
              with 8 trials each 7.1 %, as the level of the true errors has.
    """
    if not (noise and np.isfinite(errors).all()):
        return errors
    logs = np.log(errors / expected)
    mean, variance = logs.mean(axis=-1, keepdims=True), logs.var(axis=-1, ddof=1, keepdims=True)
    part = np.sqrt(np.maximum(1 - noise / np.maximum(variance, 1e-300), 0.0))
    freed = expected * np.exp(part * (logs - mean))
    before, after = ((values**2).mean(axis=-1, keepdims=True) for values in (errors, freed))
    return np.asarray(freed * np.sqrt(before / after))


def interval_of_logs(logs: Floats, freedom: float, model: float) -> Interval:
    """Interval of a positive statistic, from `resampled_interval` of its logarithms."""
    bounds = vars(resampled_interval(logs, freedom, model)).values()
    return Interval(*(math.exp(min(end, 700)) if end < math.inf else end for end in bounds))


def least_units_for_interval(fraction: float) -> int:
    """Least number of units whose level has an upper bound."""
    return math.ceil(1 / (1 - fraction) - 1e-9)
