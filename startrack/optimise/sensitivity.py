"""DesignSpace -> how much the error depends on each variable, alone and together with others."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from startrack.core import Floats, Refused, arcsec, whole
from startrack.design import Campaign, DesignSpace
from startrack.metrics import Interval
from startrack.optimise.forecast import expected_objective

STEP = 0.01  # of each range, for derivatives; chosen by hand: the budget is smooth over it
# Base designs of the Sobol indices, a power of two; each needs d + 2 budgets. Chosen by hand: more
# designs narrow the intervals, which the result states.
DESIGNS = 64
RESAMPLES = 999  # of the bootstrap, as scipy's own
BOOTSTRAP = 2  # names the stream of the resampling


@dataclass(frozen=True)
class Sensitivity:
    """How the error depends on one variable.

    name       path in the case
    error      arcsec, at the design
    low, high  arcsec, with this variable alone at its bound; NaN where no attitude is found
    slope      d ln(error) / d ln(variable) at the design; 0 where the variable is 0
    first      first-order Sobol index with its 95 % interval: fraction of the variance of ln(error)
               over the design space that is due to this variable alone
    total      total index: the fraction that would be left if all others were known
    """

    name: str
    error: float
    low: float
    high: float
    slope: float
    first: Interval
    total: Interval


def sensitivities(
    space: DesignSpace, campaign: Campaign, seed: int, designs: int = DESIGNS
) -> list[Sensitivity]:
    """Derivatives at the design, excursions to the bounds, and Sobol indices over the space.

    All by the analytic budget, which has no noise. The indices are of ln(error), as an error over
    a wide range spans decades. Estimators: Saltelli et al. (2010), table 2 (b), for the first and
    Jansen (1999), table 2 (f) there, for the total, at the points of scipy.stats.sobol_indices.
    Intervals: bootstrap (bias-corrected and accelerated) over the base designs.

    seed     of the points and of the bootstrap
    designs  base designs, a power of two
    Returns  in order of the variables; of one alone both indices are 1
    Raises    ValueError where the budget expects no attitude at the design, or nearly nowhere.
    Accuracy  model: the budget's; designs without an attitude count with the largest error.
    """
    whole(2, 2**20, designs=designs)
    if designs & (designs - 1):
        raise Refused(f"designs must be a power of two, got {designs}")

    def log_error(coordinates: Floats) -> float:
        try:
            case = space.design(np.clip(coordinates, 0, 1))
            error = expected_objective(case, campaign, seed=seed)
        except Refused:
            return math.nan
        return math.log(error / arcsec) if error > 0 else math.nan

    centre = space.start
    here = log_error(centre)
    if not math.isfinite(here):
        raise Refused("the design must be expected to find its attitude, it is not")
    fractions = _indices(log_error, len(space), designs, seed)
    result = []
    for i, variable in enumerate(space.variables):
        ends = [_moved(centre, i, at) for at in (0.0, 1.0)]
        step = [_moved(centre, i, float(np.clip(centre[i] + s, 0, 1))) for s in (-STEP, STEP)]
        change = log_error(step[1]) - log_error(step[0])
        values = [space.values(coordinates)[variable.name] for coordinates in step]
        slope = (
            change / (values[1] - values[0]) * space.values(centre)[variable.name] + 0.0
        )  # not -0
        low, high = (math.exp(log_error(coordinates)) for coordinates in ends)
        result.append(Sensitivity(variable.name, math.exp(here), low, high, slope, *fractions[i]))
    return result


def _indices(
    log_error: Callable[[Floats], float], d: int, designs: int, seed: int
) -> list[tuple[Interval, Interval]]:
    """First-order and total index of each of d variables, with their 95 % intervals."""
    if d == 1:  # which scipy cannot
        return [(Interval(1.0, 1.0, 1.0),) * 2]
    evaluated: list[tuple[Floats, Floats, Floats]] = []

    def keeping(f_A: Floats, f_B: Floats, f_AB: Floats) -> tuple[Floats, Floats]:
        evaluated.append((f_A, f_B, f_AB))
        return _saltelli_jansen(f_A, f_B, f_AB)

    indices = scipy.stats.sobol_indices(
        func=lambda points: _filled(np.array([log_error(coordinates) for coordinates in points.T]))[
            None
        ],
        n=designs,
        dists=[scipy.stats.uniform()] * d,
        rng=np.random.default_rng(seed),
        method=keeping,
    )
    ((f_a, f_b, f_ab),) = evaluated
    # Not by the result's own bootstrap, which draws from the system's random numbers.
    interval = scipy.stats.bootstrap(
        [np.arange(designs)],
        lambda chosen: _saltelli_jansen(f_a[:, chosen], f_b[:, chosen], f_ab[..., chosen]),
        n_resamples=RESAMPLES,
        confidence_level=0.95,
        rng=np.random.default_rng(np.random.SeedSequence((seed, BOOTSTRAP))),
    ).confidence_interval
    values = np.array([indices.first_order, indices.total_order]).reshape(2, d)
    low, high = (np.reshape(bound, (2, d)) for bound in (interval.low, interval.high))
    first, total = (
        [Interval(*map(float, each)) for each in zip(values[k], low[k], high[k], strict=True)]
        for k in range(2)
    )
    return list(zip(first, total, strict=True))


def _saltelli_jansen(f_a: Floats, f_b: Floats, f_ab: Floats) -> tuple[Floats, Floats]:
    """First-order and total indices (d,).

        S = mean(f_b (f_ab - f_a)) / V,   T = mean((f_a - f_ab)^2) / (2 V)

    f_a, f_b  (1, n) values at two independent sets of points, V their variance
    f_ab      (d, 1, n) values at the points of the first with one coordinate of the second
    """
    variance = np.var([f_a, f_b], axis=(0, -1))
    first = np.mean(f_b * (f_ab - f_a), axis=-1) / variance
    total = 0.5 * np.mean((f_a - f_ab) ** 2, axis=-1) / variance
    return first.T, total.T


def _moved(coordinates: Floats, axis: int, to: float) -> Floats:
    moved = coordinates.copy()
    moved[axis] = to
    return moved


def _filled(values: Floats) -> Floats:
    """The values with the largest in place of those that are not finite."""
    known = np.isfinite(values)
    if not known.mean() > 0.5:
        raise Refused(
            "more than half of the design space has no attitude; its indices mean nothing"
        )
    return np.where(known, values, values[known].max())
