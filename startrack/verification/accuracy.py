"""Budget, or outcomes of trials -> the statistic of the error that a requirement is about."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import special

from startrack.budget import Budget, Law, UnitBudgets, attitudes
from startrack.core import Floats
from startrack.design import AXES, Accuracy, Objective, Requirements
from startrack.metrics import Interpretation, Interval, fraction_interval
from startrack.montecarlo import Regions

# Whose worst counts where a requirement holds in the worst part of the sky. Chosen by hand: more
# are smaller parts and need more trials, as each must have its own.
REGIONS = Regions(3, 4)


def expected_error(objective: Objective, budget: Budget[Law]) -> float:
    """The objective's statistic of the errors that a budget expects (radian).

    By length:  sum_i weight_i P(k / 2, L^2 / (2 square_i)) = fraction,   P the regularised
        incomplete gamma function, k = 2, 1, 3 axes, square_i the mean square per axis in field i
    Per axis:   `Law.level`

    Accuracy  model: errors that are normal in each field; by their length, also of equal variance
              about the axes.
    """
    return expected_of(objective, budget.whole.spread)


def expected_of(objective: Objective, law: Law) -> float:
    """`expected_error` of the errors of a law."""
    axes = AXES[objective.axes]
    if objective.per_axis_level and objective.fraction:
        return law.level(axes, objective.fraction, Interpretation.MIXED)
    squares = (law.mean**2 + law.sigma**2)[:, axes].mean(axis=1)
    if objective.fraction is None:
        return math.sqrt((len(axes) if objective.radial else 1) * float(law.weight @ squares))
    fraction, half = objective.fraction, len(axes) / 2

    def excess(log_square: float) -> float:
        reached = special.gammainc(half, math.exp(log_square) / (2 * squares))
        return float(law.weight @ reached) - fraction

    lowest, highest = math.log(squares.min()) - 40, math.log(squares.max()) + 10
    return math.exp(scipy.optimize.brentq(excess, lowest, highest) / 2)


def units_expected(objective: Objective, budgets: UnitBudgets) -> Floats:
    """`expected_error` (n,) of each of n units, radian, its bias included."""
    return np.array([expected_of(objective, budgets.whole(k)) for k in range(len(budgets))])


def expected_in_all(objective: Objective, budgets: UnitBudgets) -> float:
    """`expected_error` of all units together, radian, their biases included."""
    return expected_of(objective, budgets.all())


def yield_of(accuracy: Accuracy, errors: Floats) -> Interval:
    """Share of the units whose errors (n,) meet a limit, with its interval."""
    return fraction_interval(int((errors <= accuracy.most).sum()), len(errors))


def expected_over(objective: Objective, budget: Budget[Law], sky: str) -> float:
    """`expected_error` over the whole sky, or in the worst of its regions.

    budget  of `analytic`
    sky     "whole" or "worst"
    Returns  radian; infinite in the worst region where one expects no attitude
    """
    law = budget.whole.spread
    if sky == "whole":
        return expected_of(objective, law)
    return max(expected_of(objective, part) if part else math.inf for part in _parts(law))


def _parts(law: Law) -> Iterator[Law | None]:
    boresight = attitudes(len(law.weight)).inv().apply([0.0, 0.0, 1.0])
    region = REGIONS.of(boresight)
    for one in range(len(REGIONS)):
        inside = (region == one) & (law.weight > 0)
        total = float(law.weight[inside].sum())
        if total > 0:
            yield replace(
                law,
                mean=law.mean[inside],
                sigma=law.sigma[inside],
                weight=law.weight[inside] / total,
            )
        else:
            yield None


def expected_availability(needs: Requirements, budget: Budget[Law]) -> float:
    """The fraction of attitudes that are solved and within what is required of a single one.

        sum_i weight_i P(1, A^2 / (2 across_i)) P(1/2, B^2 / (2 about_i)) * solved

    with the limits A and B of `Requirements.limits`, and the mean squares per axis in field i.

    Accuracy  model: normal errors in each field, independent across and about the boresight.
    """
    law = budget.whole.spread
    squares = law.mean**2 + law.sigma**2
    within = np.ones(len(squares))
    for limit, axes in ((needs.limits.across, (0, 1)), (needs.limits.about, (2,))):
        if limit is not None:
            mean = np.maximum(squares[:, list(axes)].mean(axis=1), 1e-30)
            within = within * special.gammainc(len(axes) / 2, limit**2 / (2 * mean))
    return budget.availability * float(law.weight @ within)


def measured_over(
    objective: Objective, outcomes: NDArray[np.void], boresight: Floats, sky: str
) -> float:
    """The statistic of the errors of trials, over the whole sky or in the worst of its regions.

    boresight  (n, 3) unit vectors of the outcomes, ICRS axes
    Returns    radian; NaN where no trial has an attitude
    """
    squares = objective.squares(outcomes)
    if sky == "whole":
        return float(objective.of(squares))
    region = REGIONS.of(boresight)
    found = [float(objective.of(squares[region == one])) for one in np.unique(region)]
    known = [one for one in found if not math.isnan(one)]
    return max(known, default=math.nan)


def margin(limit: float, value: float) -> float:
    """Of an error to its limit, as a fraction of the limit; minus infinity where there is none."""
    return 1 - value / limit if math.isfinite(value) else -math.inf


def expected_margins(needs: Requirements, budget: Budget[Law]) -> dict[str, float]:
    """The margins of accuracy and availability by a budget."""
    found = {
        one.name: margin(one.most, expected_over(one.objective, budget, needs.sky))
        for one in needs.accuracy
    }
    return {**found, "availability": expected_availability(needs, budget) - needs.min_availability}
