"""Units -> outcomes of trials over many units, error of each, yield, causes of a bad unit."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from itertools import groupby
from typing import Any, ClassVar, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import (
    NON_NEGATIVE,
    YEAR,
    Floats,
    Ints,
    Parameters,
    Range,
    Rows,
    parameter,
    whole,
)
from startrack.design import Case, Fidelity, Moment, Objective, Scope
from startrack.metrics import Interval, fraction_interval
from startrack.observation import random_attitudes
from startrack.population.nodes import unit_plans
from startrack.population.unit import unit_of
from startrack.trial import OUTCOMES, outcomes, run_trials

ENVIRONMENTS = 10  # of each unit
# A row of a table of trials of units: unit and environment.
UNITS: np.dtype[np.void] = np.dtype(
    [*OUTCOMES.descr, ("unit", np.int64), ("environment", np.int64)]
)


class AsDesigned(Parameters):
    """All trials use the unit as designed: a population of one."""

    dtype: ClassVar[np.dtype[Any]] = OUTCOMES
    block: ClassVar[int] = 64  # trials: a second of work, 83 bytes a trial on disk; by hand
    trials: ClassVar[int] = 1  # least number for one worker
    words: ClassVar[tuple[str, ...]] = ()
    stored: ClassVar[dict[str, str]] = {}

    @property
    def anew(self) -> "AsDesigned":
        """See `Units`."""
        return self

    def case_of(self, case: Case, seed: int, number: int) -> Case:
        """The case of a trial."""
        return case

    def run(
        self,
        case: Case,
        seed: int,
        numbers: Sequence[int],
        fidelity: Fidelity,
        icrs_to_camera: Rotation,
    ) -> Rows:
        """The outcomes of some trials, as `run_trials`."""
        return run_trials(case, seed, numbers, fidelity, icrs_to_camera)


AS_DESIGNED = AsDesigned()


class Units(Parameters):
    """Order of a campaign's trials over units: all trials of one unit, then of the next.

    trials        number for each unit
    environments  number for each unit; its trials are divided evenly over them
    age           second, of all units
    exact         whether fidelity covariance measures the stars of each unit again; false: their
                  response is interpolated between nodes (`UnitPlans`), which is faster for more
                  than some hundred units
    """

    dtype: ClassVar[np.dtype[Any]] = UNITS
    block: ClassVar[int] = 2000  # trials, of units that share their plans; chosen by hand

    trials: int = parameter(limit=Range(1, 10**6))
    environments: int = parameter(limit=Range(1), default=ENVIRONMENTS)
    age: float = parameter(limit=NON_NEGATIVE, default=0.0)
    exact: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        whole(1, self.trials, environments=self.environments)

    @property
    def words(self) -> tuple[str, ...]:
        """The order in words, as in the text of a campaign."""
        environments = f"{self.environments} environments at {self.age / YEAR:g} yr"
        return (f"{self.trials} trials a unit in {environments}",)

    @property
    def stored(self) -> dict[str, str]:
        """The order as stored in a file of trials; see `stored_units`."""
        return {"units": json.dumps(asdict(self))}

    @property
    def anew(self) -> "Units":
        """The same order, with the stars of each unit measured again."""
        return replace(self, exact=True)

    def case_of(self, case: Case, seed: int, number: int) -> Case:
        """The case of the unit of a trial."""
        return unit_of(case, seed, self.moment(case, number))

    def run(
        self,
        case: Case,
        seed: int,
        numbers: Sequence[int],
        fidelity: Fidelity,
        icrs_to_camera: Rotation,
    ) -> Rows:
        """The outcomes of some trials, as `unit_trials`."""
        return unit_trials(case, seed, numbers, self, fidelity, icrs_to_camera)

    def moment(self, case: Case, number: int) -> Moment:
        """Unit, place and time of a trial."""
        unit, inside = divmod(number, self.trials)
        environment = inside * self.environments // self.trials
        by_frame = any(variation.per is Scope.FRAME for variation in case.varying)
        return Moment(unit, environment, inside if by_frame else -1, self.age)


def stored_units(about: Mapping[str, str]) -> AsDesigned | Units:
    """Inverse of `stored`, from the description of trials in a file."""
    return Units(**json.loads(about["units"])) if "units" in about else AS_DESIGNED


def unit_trials(
    case: Case,
    seed: int,
    numbers: Sequence[int],
    units: Units,
    fidelity: Fidelity = Fidelity.COVARIANCE,
    icrs_to_camera: Rotation | None = None,
) -> Rows:
    """The outcomes of some trials of a seed, each of a unit drawn from the design's variations.

    icrs_to_camera  a true attitude for each; None: random ones
    Returns  (n,) structured array: the fields of `run_trials`, the unit, and its environment
    Raises   as `run_trials`; ValueError if a parameter refuses a value drawn for a unit.
    """
    table = np.empty(len(numbers), UNITS)
    fast = fidelity is Fidelity.COVARIANCE and not units.exact
    plans = unit_plans(case, units.age) if fast else None
    attitudes = random_attitudes(seed, numbers) if icrs_to_camera is None else icrs_to_camera
    for moment, places in groupby(range(len(numbers)), lambda n: units.moment(case, numbers[n])):
        rows = list(places)
        some = [numbers[n] for n in rows]
        unit = unit_of(case, seed, moment)
        if plans is None:
            part = run_trials(unit, seed, some, fidelity, attitudes[rows])
        else:
            part = outcomes(unit, seed, some, attitudes[rows], plans.of(unit))
        for name in part.dtype.names or ():
            table[name][rows] = part[name]
        table["trial"][rows] = some
        table["unit"][rows], table["environment"][rows] = moment.unit, moment.environment
    return table


def with_units(outcomes: Rows, trials: int) -> Rows:
    """Outcomes with a column of the unit: that many trials are of one unit, then of the next."""
    table = np.empty(len(outcomes), [*OUTCOMES.descr, ("unit", np.int64)])
    for name in OUTCOMES.names or ():
        table[name] = outcomes[name]
    table["unit"] = outcomes["trial"] // trials
    return table


class PerUnit(NamedTuple):
    """Errors of n units over their environments.

    unit           (n,) number
    across, about  (n,) radian, rms per axis of the solved trials; NaN without such trials
    """

    unit: Ints
    across: Floats
    about: Floats

    @property
    def worst(self) -> int | None:
        """Number of the unit with the largest rms across; None if no unit has an rms."""
        if not np.isfinite(self.across).any():
            return None
        return int(self.unit[np.nanargmax(self.across)])

    def meets(self, table: Rows, objective: Objective, limit: float) -> Interval:
        """Yield: fraction of the units with an objective not above a limit, with its 95 % interval.

        table  of the trials of these units
        limit  radian
        Accuracy  statistical: a unit's objective is estimated from its trials; the scatter of this
                  estimate smears the limit by the fraction 1 / sqrt(2 trials).
        """
        errors = unit_errors(objective, table, table["unit"])
        return fraction_interval(int((errors <= limit).sum()), len(errors))


def unit_errors(objective: Objective, outcomes: Rows, unit: Ints) -> Floats:
    """The objective of each unit over its trials, radian; NaN if no trial is solved.

    unit     (n,) of each trial
    Returns  in order of the units' numbers
    """
    squares, (_, place) = objective.squares(outcomes), np.unique(unit, return_inverse=True)
    order = np.argsort(place, kind="stable")
    parts = np.split(squares[order], np.cumsum(np.bincount(place))[:-1])
    return np.array([float(objective.of(part)) for part in parts])


def per_unit(table: Rows) -> PerUnit:
    """The errors of each unit in a table of `unit_trials`."""
    unit = table["unit"]
    across, about = (unit_errors(Objective(axes), table, unit) for axes in ("across", "about"))
    return PerUnit(np.unique(unit), across, about)


def explain(case: Case, seed: int, units: Units, unit: int) -> list[tuple[str, float]]:
    """Change of a unit's rms across if each varying number in turn has its designed value.

    Sky and noise stay the same, in fidelity covariance. The residual field counts as one number;
    the tracker still weights its stars as if the field were present.

    Returns  name and scope of each number, and the relative change, largest reduction first
    Raises   ValueError if fidelity covariance cannot compute the design.
    """
    # Variations that follow from the structure are declared, so that each can be left out alone.
    alone = replace(case.instrument, structure=None)
    case = replace(case, variation=case.varying, instrument=alone)
    numbers = list(range(unit * units.trials, (unit + 1) * units.trials))
    start = _rms(case, case, seed, units, numbers)
    rms_without = []
    for variation in case.variation:
        rest = tuple(other for other in case.variation if other is not variation)
        name = f"{variation.name} per {variation.per}"
        rms_without.append((name, _rms(case, replace(case, variation=rest), seed, units, numbers)))
    if case.instrument.residual is not None:
        kept = tuple(other for other in case.variation if ".residual." not in other.name)
        bare = replace(case.instrument, residual=None)
        flat = replace(case, instrument=bare, variation=kept)
        rms_without.append(("instrument.residual", _rms(case, flat, seed, units, numbers)))
    return sorted(((name, rms / start - 1) for name, rms in rms_without), key=lambda pair: pair[1])


def _rms(case: Case, other: Case, seed: int, units: Units, numbers: list[int]) -> float:
    """Radian, rms across over the trials of a unit of another case, with the plans of a case."""
    plans, across = unit_plans(case, units.age), Objective("across")
    squares = []
    for environment in range(units.environments):
        some = [n for n in numbers if units.moment(case, n).environment == environment]
        unit = unit_of(other, seed, units.moment(case, some[0]))
        attitudes = random_attitudes(seed, some)
        table = outcomes(unit, seed, some, attitudes, plans.of(unit))
        squares.append(across.squares(table))
    return float(across.of(np.concatenate(squares)))
