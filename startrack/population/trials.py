"""Units -> outcomes of trials of many units, each with its unit and environment."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.core import NON_NEGATIVE, Parameters, Range, whole
from startrack.design import Case, Fidelity, Moment, Scope
from startrack.population.nodes import unit_plans
from startrack.population.unit import unit_of
from startrack.trial import OUTCOMES, outcomes, random_attitudes, run_trials

ENVIRONMENTS = 10  # of each unit
# A row of a table of trials of units: of which, and in which environment.
UNITS: np.dtype[np.void] = np.dtype(
    [*OUTCOMES.descr, ("unit", np.int64), ("environment", np.int64)]
)


@dataclass(frozen=True)
class Units(Parameters):
    """How the trials of a campaign go over units: those of each one after the other.

    trials        of each unit
    environments  that each unit meets, its trials shared among them
    age           second, of all units
    exact         whether each unit's stars are measured anew in fidelity covariance; false: their
                  response is interpolated between nodes, see `UnitPlans`, which is quicker from
                  some hundred units on
    """

    trials: Annotated[int, Range(1, 10**6)]
    environments: Annotated[int, Range(1)] = ENVIRONMENTS
    age: Annotated[float, NON_NEGATIVE] = 0.0
    exact: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        whole(1, self.trials, environments=self.environments)

    def moment(self, case: Case, number: int) -> Moment:
        """Which unit a trial has, where and when."""
        unit, inside = divmod(number, self.trials)
        environment = inside * self.environments // self.trials
        each = any(one.per is Scope.FRAME for one in case.varying)
        return Moment(unit, environment, inside if each else -1, self.age)


def unit_trials(
    case: Case,
    seed: int,
    numbers: Sequence[int],
    units: Units,
    fidelity: Fidelity = Fidelity.COVARIANCE,
    icrs_to_camera: Rotation | None = None,
) -> NDArray[np.void]:
    """The outcomes of some trials of a seed, each of a unit drawn from the design's variations.

    icrs_to_camera  a true attitude for each; None: random ones
    Returns  (n,) structured array: the fields of `run_trials`, the unit, and its environment
    Raises   as `run_trials`; ValueError where a parameter refuses what was drawn for a unit.
    """
    table = np.empty(len(numbers), UNITS)
    fast = fidelity is Fidelity.COVARIANCE and not units.exact
    plans = unit_plans(case, units.age) if fast else None
    attitudes = random_attitudes(seed, numbers) if icrs_to_camera is None else icrs_to_camera
    for moment, each in groupby(range(len(numbers)), lambda n: units.moment(case, numbers[n])):
        rows = list(each)
        some = [numbers[n] for n in rows]
        unit = unit_of(case, seed, moment)
        if plans is None:
            part = run_trials(unit, seed, some, fidelity, attitudes[rows])
            for name in OUTCOMES.names or ():
                table[name][rows] = part[name]
        else:
            part = outcomes(unit, seed, some, attitudes[rows], plans.of(unit))
            for name in part.dtype.names or ():
                table[name][rows] = part[name]
            table["trial"][rows] = some
        table["unit"][rows], table["environment"][rows] = moment.unit, moment.environment
    return table
