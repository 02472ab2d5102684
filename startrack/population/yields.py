"""Outcomes of trials of units -> error of each unit, yield, and what made one of them bad."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Ints
from startrack.design import Case, Objective
from startrack.metrics import Interval, fraction_interval
from startrack.population.nodes import unit_plans
from startrack.population.trials import Units
from startrack.population.unit import unit_of
from startrack.trial import outcomes as drawn_outcomes
from startrack.trial import random_attitudes


class PerUnit(NamedTuple):
    """Errors of n units over their environments.

    unit           (n,) number
    across, about  (n,) radian, rms per axis of the solved trials; NaN where none is
    """

    unit: Ints
    across: Floats
    about: Floats

    @property
    def worst(self) -> int | None:
        """Number of the unit of the largest rms across; None where no unit has one."""
        if not np.isfinite(self.across).any():
            return None
        return int(self.unit[np.nanargmax(self.across)])

    def meets(self, table: NDArray[np.void], objective: Objective, limit: float) -> Interval:
        """Yield: share of the units whose objective is at most a limit, with its 95 % interval.

        table  of the trials of these units
        limit  radian
        Accuracy  statistical: a unit's objective is that of its trials, whose scatter smears the
                  limit by 1 / sqrt(2 trials) of it.
        """
        found = unit_errors(objective, table, table["unit"])
        return fraction_interval(int((found <= limit).sum()), len(found))


def unit_errors(objective: Objective, outcomes: NDArray[np.void], unit: Ints) -> Floats:
    """The objective of each unit over its trials, radian; NaN where none is solved.

    unit     (n,) of each trial
    Returns  in order of the units' numbers
    """
    squares, (_, place) = objective.squares(outcomes), np.unique(unit, return_inverse=True)
    order = np.argsort(place, kind="stable")
    parts = np.split(squares[order], np.cumsum(np.bincount(place))[:-1])
    return np.array([float(objective.of(one)) for one in parts])


def per_unit(table: NDArray[np.void]) -> PerUnit:
    """The errors of each unit in a table of `unit_trials`."""
    unit = table["unit"]
    across, about = (unit_errors(Objective(axes), table, unit) for axes in ("across", "about"))
    return PerUnit(np.unique(unit), across, about)


def explain(case: Case, seed: int, units: Units, unit: int) -> list[tuple[str, float]]:
    """What a unit's rms across changes by if each number that varies is as designed instead.

    On the same sky and noise, in fidelity covariance. The residual field counts as one; the tracker
    still weights its stars as if it were there.

    Returns  name of each number and scope, and the relative change, the greatest gain first
    Raises   ValueError where fidelity covariance cannot compute the design.
    """
    # What follows from the structure is declared, so that each number can be left out alone.
    alone = replace(case.instrument, structure=None)
    case = replace(case, variation=case.varying, instrument=alone)
    numbers = list(range(unit * units.trials, (unit + 1) * units.trials))
    start = _rms(case, case, seed, units, numbers)
    found = []
    for one in case.variation:
        rest = tuple(other for other in case.variation if other is not one)
        name = f"{one.name} per {one.per}"
        found.append((name, _rms(case, replace(case, variation=rest), seed, units, numbers)))
    if case.instrument.residual is not None:
        kept = tuple(one for one in case.variation if ".residual." not in one.name)
        bare = replace(case.instrument, residual=None)
        flat = replace(case, instrument=bare, variation=kept)
        found.append(("instrument.residual", _rms(case, flat, seed, units, numbers)))
    return sorted(((name, rms / start - 1) for name, rms in found), key=lambda pair: pair[1])


def _rms(case: Case, other: Case, seed: int, units: Units, numbers: list[int]) -> float:
    """Radian, rms across of trials of a unit of another case, by the plans of a case."""
    plans, across = unit_plans(case, units.age), Objective("across")
    squares = []
    for environment in range(units.environments):
        some = [n for n in numbers if units.moment(case, n).environment == environment]
        unit = unit_of(other, seed, units.moment(case, some[0]))
        attitudes = random_attitudes(seed, some)
        table = drawn_outcomes(unit, seed, some, attitudes, plans.of(unit))
        squares.append(across.squares(table))
    return float(across.of(np.concatenate(squares)))
