"""Fresh units of a design -> the level that a fraction of them keeps, and their yields."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats
from startrack.design import Accuracy, Campaign, Judged, Objective, OverUnits
from startrack.metrics import Interval, fraction_interval, quantile_of_few
from startrack.optimise.runner import FRESH_UNIT, TrialRunner
from startrack.population import Units, unit_errors

ENVIRONMENTS = 4  # of each fresh unit; chosen by hand: time against the rms of a unit
RESAMPLES = 4000
BOOTSTRAP = 3  # names the stream of the resampling


def how(units: OverUnits, campaign: Campaign) -> Units:
    """How the trials of fresh units go over them."""
    each = campaign.trials_per_unit
    return Units(each, min(ENVIRONMENTS, each), units.age)


def fresh_units(
    one: Judged,
    campaign: Campaign,
    runner: TrialRunner,
    count: int | None = None,
    done: int = 0,
    watch: Callable[[int], None] | None = None,
) -> NDArray[np.void]:
    """The outcomes of trials of units that no tuning used, in the campaign's fidelity.

    one    which is judged over units
    count  units; None: those of the campaign
    done   units before them
    watch  called with the number of trials that were just done
    """
    assert one.units is not None
    order = how(one.units, campaign)
    first, count = FRESH_UNIT + done, count or campaign.fresh_units
    return runner.run(
        one.case, count * order.trials, campaign.fidelity, first * order.trials, watch, order
    )


def errors_of(
    objective: Objective, outcomes: NDArray[np.void], units: OverUnits, campaign: Campaign
) -> Floats:
    """The objective (n,) of each fresh unit, radian; infinite where no trial is solved."""
    found = unit_errors(objective, outcomes, outcomes["trial"] // how(units, campaign).trials)
    return np.where(np.isnan(found), np.inf, found)


@dataclass(frozen=True)
class UnitYield:
    """Share of the fresh units of start and best that keep a limit, with 95 % intervals."""

    accuracy: Accuracy
    start: Interval
    best: Interval


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
    start: Interval
    best: Interval
    predicted: float
    yields: tuple[UnitYield, ...]
    factor: Interval
    optimism: Interval


def compare_units(
    campaign: Campaign,
    start: tuple[Sequence[Judged], Sequence[NDArray[np.void]]],
    best: tuple[Sequence[Judged], Sequence[NDArray[np.void]]],
    predicted: float,
    seed: int,
) -> ComparedUnits | None:
    """Start and best by their fresh units, in the conditions that have a weight; the own one first.

    Intervals of levels are bootstrap percentiles over units, the same ones of both designs; those
    of yields are exact.

    Returns  None where they are judged as designed
    """
    over = best[0][0].units
    if over is None:
        return None
    objective = Objective.read(campaign.objective)
    errors = [
        [errors_of(objective, each, over, campaign) for each in outcomes if len(each)]
        for _, outcomes in (start, best)
    ]
    weights = [one.weight for one in best[0]]
    n = campaign.fresh_units
    rng = np.random.default_rng(np.random.SeedSequence((seed, BOOTSTRAP)))
    chosen = np.vstack([np.arange(n), rng.integers(0, n, (RESAMPLES, n))])
    before, after = (_levels(each, weights, over.fraction, chosen) for each in errors)
    limits = best[0][0].needs.accuracy or (Accuracy(objective, predicted),)
    yields = [
        UnitYield(
            limit,
            *(
                _share(errors_of(limit.objective, outcomes[0], over, campaign), limit.most, n)
                for _, outcomes in (start, best)
            ),
        )
        for limit in limits
    ]
    return ComparedUnits(
        over, n, campaign.trials_per_unit, _interval(before), _interval(after), predicted,
        tuple(yields), _interval(before / after), _interval(after / predicted),
    )  # fmt: skip


def level_interval_of_units(
    errors: Sequence[Floats], weights: Sequence[float], fraction: float, seed: int
) -> Interval:
    """The level over units, radian, as a geometric mean over conditions, with its interval.

    errors  (n,) of the units in each condition
    """
    n = len(errors[0])
    rng = np.random.default_rng(np.random.SeedSequence((seed, BOOTSTRAP)))
    chosen = np.vstack([np.arange(n), rng.integers(0, n, (RESAMPLES, n))])
    return _interval(_levels(errors, weights, fraction, chosen))


def _levels(
    errors: Sequence[Floats], weights: Sequence[float], fraction: float, chosen: NDArray[np.int64]
) -> Floats:
    """The level of each choice of units; NaN where a condition has no trials."""
    if len(errors) < len(weights):
        return np.full(len(chosen), np.nan)
    logs = [
        weight * np.log(quantile_of_few(one[chosen], fraction))
        for one, weight in zip(errors, weights, strict=True)
    ]
    return np.asarray(np.exp(np.sum(logs, axis=0) / sum(weights)))


def _interval(values: Floats) -> Interval:
    """The first value, with percentiles of the others; NaN where one is not known."""
    if not np.isfinite(values[0]):
        return Interval(float(values[0]), np.nan, np.nan)
    low, high = np.nanquantile(values[1:], [0.025, 0.975])
    return Interval(float(values[0]), float(low), float(high))


def _share(errors: Floats, most: float, count: int) -> Interval:
    return fraction_interval(int((errors <= most).sum()), count)
