"""Case -> error budgets of many units at an age: classes of error and levels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from startrack.attitude import Mounting
from startrack.budget.analytic import of_fields
from startrack.budget.budget import Law
from startrack.budget.causes import Term
from startrack.budget.fields import attitudes, fields
from startrack.core import Floats, Refused, whole
from startrack.design import Case, Moment, Scope
from startrack.metrics import Interpretation
from startrack.population import middle_of, of_places, unit_of

OF_THE_CAMERA = ("camera model", "mounting")  # calibrated together, so that parts of them cancel
FIELDS = 64  # of each unit in each environment
ENVIRONMENTS = 3  # of each unit


@dataclass(frozen=True, eq=False)
class UnitBudgets:
    """Error budgets of n units, each in m fields of the sky and environments.

    The bias of a unit is apart: the mean of its error over fields, without what its environment and
    its frames change.

    age           second
    mean, sigma   (n, m, 3) radian, of a normal error, without the bias of the unit
    weight        (n, m) 1, of each field; sums to 1 for each unit
    bias          (n, 3) radian
    terms         (n, 3) radian, rms of each class of error but bias
    availability  (n,) 1
    """

    age: float
    mean: Floats
    sigma: Floats
    weight: Floats
    bias: Floats
    terms: dict[Term, Floats]
    availability: Floats

    def __len__(self) -> int:
        return len(self.mean)

    def unit(self, number: int) -> Law:
        """The error of one unit, without its bias."""
        return Law(self.mean[number], self.sigma[number], self.weight[number])

    def first(self, count: int) -> UnitBudgets:
        """The budgets of the first of these units."""
        return replace(
            self,
            mean=self.mean[:count],
            sigma=self.sigma[:count],
            weight=self.weight[:count],
            bias=self.bias[:count],
            terms={term: values[:count] for term, values in self.terms.items()},
            availability=self.availability[:count],
        )

    def all(self) -> Law:
        """The error of all units together, with their biases."""
        mean = self.mean + self.bias[:, None]
        flat = [each.reshape(-1, 3) for each in (mean, self.sigma)]
        return Law(flat[0], flat[1], self.weight.ravel() / len(self))

    def whole(self, number: int) -> Law:
        """The error of one unit, with its bias."""
        return Law(self.mean[number] + self.bias[number], self.sigma[number], self.weight[number])

    def rms(self) -> Floats:
        """(n, 3) radian, of each unit, without its bias."""
        return np.array([self.unit(k).rms() for k in range(len(self))])

    def across(self) -> Floats:
        """(n,) radian, rms per axis across the boresight of each unit."""
        return np.asarray(np.sqrt((self.rms()[:, :2] ** 2).mean(axis=1)))

    def about(self) -> Floats:
        """(n,) radian, rms about the boresight of each unit."""
        return np.asarray(self.rms()[:, 2])

    def levels(self, axes: Sequence[int], fraction: float) -> Floats:
        """(n,) radian per axis that each unit does not exceed in a fraction of the time."""
        each = [self.unit(k).level(axes, fraction, Interpretation.MIXED) for k in range(len(self))]
        return np.array(each)

    def level(self, axes: Sequence[int], fraction: float, interpretation: Interpretation) -> float:
        """Radian per axis, by an interpretation of ECSS-E-ST-60-10C; without the biases.

        temporal: of the worst unit; ensemble: of the units in the worst field; mixed: of all.

        Accuracy  statistical: the worst of few units or fields is too small.
        """
        match interpretation:
            case Interpretation.TEMPORAL:
                return float(self.levels(axes, fraction).max())
            case Interpretation.ENSEMBLE:
                every = [
                    Law(self.mean[:, f], self.sigma[:, f], _share(self.weight[:, f]))
                    for f in range(self.mean.shape[1])
                    if self.weight[:, f].sum() > 0
                ]
                return max(one.level(axes, fraction, Interpretation.MIXED) for one in every)
        flat = [each.reshape(-1, 3) for each in (self.mean, self.sigma)]
        whole_law = Law(flat[0], flat[1], self.weight.ravel() / len(self))
        return whole_law.level(axes, fraction, Interpretation.MIXED)


def unit_budgets(
    case: Case,
    seed: int,
    count: int,
    age: float = 0.0,
    environments: int = ENVIRONMENTS,
    count_fields: int = FIELDS,
    progress: Callable[[int], None] | None = None,
    first: int = 0,
    apart: bool = True,
) -> UnitBudgets:
    """The analytic budget of each of some units of a seed.

    age           second
    environments  of each unit
    progress      called with 1 for each unit
    first         number of the first unit
    apart         whether biases are apart; False: they are in the means, in a third less time
    Raises    as `analytic`; ValueError where a unit cannot be solved in any field.
    Accuracy  that of `analytic`; 10 % of a unit's rms for 64 fields in 3 environments. Behind a
              lens table all units have the noise of the middle one, see `middle_of`.
    """
    whole(1, 10**6, count=count)
    whole(1, 1000, environments=environments)
    numbers = range(-1 if apart else 0, environments)
    settings = _Settings(age, numbers, count_fields, _alike(case), middle_of(case, age))
    parts = []
    for unit in range(first, first + count):
        parts.append(_of_unit(case, seed, unit, settings))
        if progress:
            progress(1)
    mean, sigma, weight, bias, available = (
        np.stack(each) for each in list(zip(*parts, strict=True))[:5]
    )
    terms = {
        term: np.stack([part[5].get(term, np.zeros(3)) for part in parts])
        for term in Term
        if any(term in part[5] for part in parts)
    }
    return UnitBudgets(age, mean, sigma, weight, bias, terms, available)


def joined(parts: Sequence[UnitBudgets]) -> UnitBudgets:
    """Budgets of units of one age that were computed apart, in their order."""
    mean, sigma, weight, bias, available = (
        np.concatenate([getattr(one, name) for one in parts])
        for name in ("mean", "sigma", "weight", "bias", "availability")
    )
    terms = {
        term: np.concatenate([one.terms.get(term, np.zeros((len(one), 3))) for one in parts])
        for term in Term
        if any(term in one.terms for one in parts)
    }
    return UnitBudgets(parts[0].age, mean, sigma, weight, bias, terms, available)


class _Settings(NamedTuple):
    """How the budget of each unit is made.

    environments  numbers; with -1 first, that of its calibration, its bias is apart
    alike         whether stars are measured alike in all environments of a unit
    middle        unit for which stars are measured once, for all units; None: each has its own
    """

    age: float
    environments: range
    fields: int
    alike: bool
    middle: Case | None


def _alike(case: Case) -> bool:
    """Whether what varies from environment to environment moves the places of stars alone."""
    changing = (Scope.ENVIRONMENT, Scope.FRAME)
    return all(of_places(case, one.name) for one in case.variation if one.per in changing)


def _of_unit(
    case: Case, seed: int, unit: int, settings: _Settings
) -> tuple[Floats, Floats, Floats, Floats, Floats, dict[Term, Floats]]:
    """Mean, sigma (m, 3), weight (m,), bias (3,), availability, classes of one unit."""
    means, sigmas, weights = (list[Floats]() for _ in range(3))
    squares, available, bias = dict[Term, list[Floats]](), list[float](), np.zeros(3)
    like = settings.middle
    for environment in settings.environments:
        one = unit_of(case, seed, Moment(unit, environment, environment, settings.age))
        view = fields(one.catalog, one.instrument.camera, attitudes, settings.fields)
        alike = like or _as_measured(one)
        found = of_fields(one, view, alike)
        if found is None:
            raise Refused(f"unit {unit} of seed {seed} must see enough stars somewhere")
        like = alike if settings.alike else like
        budget, _ = found
        law = budget.whole.spread
        camera = sum(
            (line.spread.mean for line in budget.lines if line.name in OF_THE_CAMERA),
            np.zeros_like(law.mean),
        )
        middle = law.weight @ camera
        if environment < 0:
            bias = middle
            continue
        square = {Term.FIELD: law.weight @ (camera - middle) ** 2}
        for line in budget.lines:
            if line.term and line.name not in OF_THE_CAMERA:
                known = square.get(line.term, np.zeros(3))
                square[line.term] = known + line.spread.rms() ** 2
        known = square.get(Term.THERMO_ELASTIC, np.zeros(3))
        square[Term.THERMO_ELASTIC] = known + (middle - bias) ** 2
        for term, value in square.items():
            squares.setdefault(term, []).append(value)
        available.append(budget.availability)
        means.append(law.mean)
        sigmas.append(law.sigma)
        weights.append(law.weight / settings.environments.stop)
    terms = {term: np.sqrt(np.mean(values, axis=0)) for term, values in squares.items()}
    return (
        np.concatenate(means) - bias, np.concatenate(sigmas), np.concatenate(weights), bias,
        np.array(float(np.mean(available))), terms,
    )  # fmt: skip


def _as_measured(case: Case) -> Case:
    """A unit without what the response to single stars does not depend on.

    Units that differ in nothing else are measured once.
    """
    instrument, mounting = case.instrument, Mounting()
    detector = replace(instrument.detector, device_seed=0)
    return replace(
        case,
        instrument=replace(instrument, detector=detector, mounting=mounting, delay=0.0),
        tracker=replace(case.tracker, mounting=mounting, delay=0.0),
    )


def _share(weight: Floats) -> Floats:
    return weight / weight.sum()
