"""Intervals over units: the rms of all trials and its ratio between two designs, the level of a
fraction of units, the factor between two designs, and yields.

Units and their trials are drawn from pools of units with many trials each.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from intervals_coverage import COUNTS, Coverage, note

from startrack import Case, load_design, shipped
from startrack.core import YEAR, Floats, Refused, Rows
from startrack.design import Campaign, Fidelity, Objective, Variable, Variation
from startrack.metrics import fraction_interval, summarise
from startrack.montecarlo import Serial, differences, run
from startrack.optimise import (
    MeasuredUnits,
    budgets_of_units,
    compare_levels,
    levels_of,
    resampled_units,
    trial_noise,
)
from startrack.population import Units, with_units
from startrack.trial import OUTCOMES
from startrack.verification import USUAL, YieldClaim, units_expected

EACH = 24  # trials of each unit of a pool; a repeat uses few of them
FEW, OF_VERIFY = 3, 8  # trials of each unit, in a search and in `verify --units`
BEST = "instrument.optics.blur=4 um"
KEPT = 0.8  # fraction of the units whose level is the limit of yields
BLUR = Variation("instrument.optics.blur", "lognormal", sigma=0.3, vary="relative")
TAILS = replace(BLUR, sigma=0.6)
TURNED = tuple(Variation(f"instrument.mounting.{axis}", sigma="0.3 arcsec") for axis in ("x", "y"))


class Varied(NamedTuple):
    """A design with noise alone, and the differences of its units."""

    changes: tuple[str, ...]
    variation: tuple[Variation, ...]


DESIGNS = {
    "units, many stars": Varied((), (BLUR,)),
    "units, five stars": Varied(("tracker.detection.max_spots=5",), (BLUR,)),
    "units, turned": Varied((), TURNED),
    "units, tails": Varied((), (TAILS,)),
    "units, slew": Varied(("instrument.motion.rate_y=0.3 deg/s",), (BLUR,)),
    "units, faint stars": Varied(("instrument.detector.exposure=30 ms",), (BLUR,)),
}


class Pool(NamedTuple):
    """Units of a design with many trials.

    squares   (units, EACH) radian^2 per axis
    expected  (units,) radian, by budgets
    """

    squares: Floats
    expected: Floats

    def level(self) -> float:
        """The level by many trials, ln(radian)."""
        every = np.arange(len(self.expected))[None]
        return float(levels_of(Objective(), [measured(self)], [1.0], USUAL, every).logs[0])


def unit_coverage(repeats: int, units: int, quick: bool) -> dict[str, Any]:
    """Fractions of repeats whose interval contains the truth, by figure, design and number of
    units."""
    held: Coverage = {}
    for name, design in list(DESIGNS.items())[: 1 if quick else None]:
        first, second = pool_of(design, (), units), pool_of(design, (BEST,), units)
        both = np.isfinite(first.squares).all(axis=1) & np.isfinite(second.squares).all(axis=1)
        first, second = (Pool(one.squares[both], one.expected[both]) for one in (first, second))
        for count in COUNTS[:1] if quick else COUNTS:
            note(held, name, count, repeated(first, second, count, repeats))
    return {"coverage": held}


def pool_of(design: Varied, more: tuple[str, ...], units: int) -> Pool:
    """Units of a design with their trials and budgets."""
    case: Case = load_design(shipped("designs/noise_only.toml"), (*design.changes, *more)).case
    case = replace(case, variation=design.variation, lifetime=YEAR)
    how = Units(EACH, EACH)
    rows = run(case, units * EACH, 1, Serial(), 0, 1, None, Fidelity.COVARIANCE, how)
    budgets = budgets_of_units(case, 1, 0.0, 0, units, 1)
    if isinstance(budgets, Refused):
        raise budgets
    squares = Objective().squares(rows).reshape(units, EACH)
    return Pool(squares, units_expected(Objective(), budgets))


def rows_of(squares: Floats) -> Rows:
    """Outcomes with these squares per axis (units, trials)."""
    rows = np.zeros(squares.size, OUTCOMES)
    rows["solved"], rows["trial"] = True, np.arange(len(rows))
    rows["error_x"] = rows["error_z"] = np.sqrt(2 * squares.ravel())
    return rows


def measured(pool: Pool) -> MeasuredUnits:
    """The errors of units from trials, as in a search."""
    trials, rows = pool.squares.shape[1], rows_of(pool.squares)
    campaign = Campaign((VARIABLE,), units=USUAL, unit_trials=trials)
    over = campaign.over_units(CASE)
    assert over is not None
    errors = np.sqrt(pool.squares.mean(axis=1))
    return MeasuredUnits(errors, pool.expected, trial_noise(Objective(), rows, over, campaign))


VARIABLE = Variable("instrument.optics.blur", "2 um", "8 um")
CASE = replace(
    load_design(shipped("designs/noise_only.toml")).case, variation=(BLUR,), lifetime=YEAR
)


def repeated(first: Pool, second: Pool, count: int, repeats: int) -> dict[str, float]:
    """Fractions of repeats that contain the rms of the start and its ratio to the best, the level
    of the start, the factor to the best and two yields."""
    rng, size = np.random.default_rng(count), len(first.expected)
    level = first.level()
    factor = level - second.level()
    errors = np.sqrt(first.squares.mean(axis=1))
    limit = float(np.quantile(errors, KEPT))
    true_share = float((errors <= limit).mean())
    verified_share = by_few(first, limit, rng)
    rms = [math.sqrt(pool.squares.mean()) for pool in (first, second)]
    figures = "unit rms", "unit ratio", "unit level", "unit factor", "yield", "yield of verify"
    held = dict.fromkeys(figures, 0)
    for number in range(repeats):
        unit = rng.integers(0, size, count)
        trial = rng.permuted(np.tile(np.arange(EACH), (count, 1)), axis=1)
        few = [
            Pool(pool.squares[unit[:, None], trial[:, :FEW]], pool.expected[unit])
            for pool in (first, second)
        ]
        before, after = (measured(pool) for pool in few)
        chosen = resampled_units(count, number)
        found = compare_levels(
            levels_of(Objective(), [before], [1.0], USUAL, chosen),
            levels_of(Objective(), [after], [1.0], USUAL, chosen),
            count,
            USUAL,
        )
        kept = before.denoised <= limit
        part = before.effective_fraction(limit, number)
        met = np.sqrt(first.squares[unit[:, None], trial[:, :OF_VERIFY]].mean(axis=1)) <= limit
        before_rows, after_rows = (
            with_units(rows_of(pool.squares[unit[:, None], trial[:, :OF_VERIFY]]), OF_VERIFY)
            for pool in (first, second)
        )
        ratio = differences(before_rows, after_rows)[0].change
        holds = (
            holding(summarise(before_rows).across, rms[0]),
            holding(ratio, rms[1] / rms[0]),
            found.start.low <= math.exp(level) <= found.start.high,
            found.factor.low <= math.exp(factor) <= found.factor.high,
            holding(fraction_interval(part * int(kept.sum()), part * count), true_share),
            holding(YieldClaim(KEPT).bounds(met, 0.025, 0.025), verified_share),
        )
        for figure, one in zip(held, holds, strict=True):
            held[figure] += one
    return {figure: number / repeats for figure, number in held.items()}


def holding(interval: Any, value: float) -> bool:
    """Whether an interval contains a value."""
    return bool(interval.low <= value <= interval.high)


def by_few(pool: Pool, limit: float, rng: np.random.Generator, draws: int = 200) -> float:
    """Fraction of the units that meet a limit with a few of their trials, counted as by
    `verify`."""
    shares = []
    for _ in range(draws):
        trial = rng.permuted(np.tile(np.arange(EACH), (len(pool.squares), 1)), axis=1)[
            :, :OF_VERIFY
        ]
        some = np.take_along_axis(pool.squares, trial, axis=1)
        shares.append((np.sqrt(some.mean(axis=1)) <= limit).mean())
    return float(np.mean(shares))
