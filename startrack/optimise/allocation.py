"""Case, units -> what halving the tolerance of each variation buys, by their budgets."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from startrack.budget import unit_budgets
from startrack.core import Floats
from startrack.design import Accuracy, Case, Objective
from startrack.metrics import Interval, quantile_of_few
from startrack.verification import units_expected

ENVIRONMENTS = 2  # of each unit; chosen by hand: time against the rms of a unit
RESAMPLES = 4000
BOOTSTRAP = 4  # names the stream of the resampling


@dataclass(frozen=True)
class Tightened:
    """What is gained where the scale of one variation is half of that of the design.

    name    of the number and the scope of its variation
    level   radian, by which the level over units falls, with its interval
    yields  1, by which the yield of each limit rises, with its interval
    price   what it costs, in the unit of the requirements' cost
    """

    name: str
    level: Interval
    yields: tuple[Interval, ...]
    price: float


@dataclass(frozen=True)
class Allocation:
    """Tolerances of a design, the one that buys most first.

    age       second, of the units
    fraction  1, of the units, which do not exceed the level
    level     radian, of the objective
    yields    1, of each limit
    each      of each variation
    """

    age: float
    fraction: float
    level: float
    yields: tuple[float, ...]
    each: tuple[Tightened, ...]


def allocation(
    case: Case,
    objective: Objective,
    limits: Sequence[Accuracy],
    fraction: float,
    seed: int,
    count: int,
    progress: Callable[[int], None] | None = None,
) -> Allocation:
    """Halve the scale of each variation in turn, on the same draws of the same units.

    At the end of life; of a residual, the rms is halved, too. Intervals are bootstrap percentiles
    over the units, the same ones before and after, so that what all have in common does not count.

    fraction  1, of the units, whose level counts
    progress  called with 1 for each unit
    Accuracy  model: that of the budget; gains of two tolerances do not add where one hides another.
    """
    age = case.end_of_life
    asked = [objective, *(one.objective for one in limits)]

    def errors(one: Case) -> list[Floats]:
        found = unit_budgets(one, seed, count, age, ENVIRONMENTS, progress=progress, apart=False)
        return [units_expected(each, found) for each in asked]

    rng = np.random.default_rng(np.random.SeedSequence((seed, BOOTSTRAP)))
    chosen = np.vstack([np.arange(count), rng.integers(0, count, (RESAMPLES, count))])
    before = errors(case)
    level = quantile_of_few(before[0][chosen], fraction)
    kept = [one <= limit.most for one, limit in zip(before[1:], limits, strict=True)]
    each = list[Tightened]()
    for name, half, price in halved(case):
        after = errors(half)
        gained = level - quantile_of_few(after[0][chosen], fraction)
        more = [
            ((found <= limit.most) * 1.0 - was)[chosen].mean(axis=1)
            for found, limit, was in zip(after[1:], limits, kept, strict=True)
        ]
        each.append(Tightened(name, _interval(gained), tuple(map(_interval, more)), price))
    each.sort(key=lambda one: -one.level.value)
    shares = tuple(float(one.mean()) for one in kept)
    return Allocation(age, fraction, float(level[0]), shares, tuple(each))


def halved(case: Case) -> Iterator[tuple[str, Case, float]]:
    """Each tolerance of a design: its name, the design with half of it, and what that costs."""
    for number, one in enumerate(case.variation):
        half = replace(one, scale=one.scale / 2)
        every = (*case.variation[:number], half, *case.variation[number + 1 :])
        yield f"{one.name} per {one.per}", replace(case, variation=every), one.price
    if (residual := case.instrument.residual) is not None:
        less = replace(residual, rms=residual.rms / 2)
        instrument = replace(case.instrument, residual=less)
        yield "instrument.residual.rms", replace(case, instrument=instrument), 0.0


def _interval(values: Floats) -> Interval:
    """The first value, with 95 % percentiles of the others."""
    low, high = np.quantile(values[1:], [0.025, 0.975])
    return Interval(float(values[0]), float(low), float(high))
