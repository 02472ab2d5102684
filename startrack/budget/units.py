"""Case -> error budgets of many units at an age: classes of error and levels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any, NamedTuple

import numpy as np

from startrack.attitude import Mounting
from startrack.budget.analytic import of_fields
from startrack.budget.blind import blind
from startrack.budget.budget import Budget, BudgetLine, Cause, ErrorLaw, Term
from startrack.budget.fields import attitudes, lattice_nodes, listed_fields
from startrack.budget.fixed import displacement, of_the_camera
from startrack.core import Advance, Floats, Unit, printed, whole
from startrack.design import Case, Moment, Scope, turning, unchecked
from startrack.metrics import Interpretation
from startrack.population import middle_of, of_places, placed, unit_of
from startrack.trial import EFFECTS

CAMERA_MODEL = "camera model"
OF_THE_CAMERA = (CAMERA_MODEL, "mounting")  # calibrated together, so that they partly cancel
# Error terms of one unit that are not of the camera, and their causes.
TURNED = (Term.THERMO_ELASTIC, Term.MEASUREMENT_DATE)
TURNS = tuple(
    Cause(effect.cause, effect.term, effect.without)
    for effect in EFFECTS
    if effect.without and effect.term in TURNED
)
FIELDS = 64  # of each unit in each environment
ENVIRONMENTS = 3  # of each unit
# Values that datasheets state, and the error classes (ECSS-E-ST-60-20C) in them; rms over units.
_RANDOM = Term.NOISE, Term.PIXEL, Term.ABERRATION, Term.MEASUREMENT_DATE
_ALL = *_RANDOM, Term.FIELD, Term.THERMO_ELASTIC, Term.PLATFORM
PUBLISHED = {
    "NEA": (Term.NOISE,),
    "NEA and pixel errors": _RANDOM,
    "and FOV errors": (*_RANDOM, Term.FIELD),
    "and thermo-elastic: accuracy": _ALL,
    "accuracy with bias": (*_ALL, Term.BIAS),
}
ARRAYS = ("mean", "sigma", "weight", "bias", "availability")  # of `UnitBudgets`


@printed
@dataclass(frozen=True, eq=False)
class UnitBudgets:
    """Error budgets of n units, each in m fields of the sky and environments.

    The bias of a unit is separate. It is the mean of the unit's error over fields, without the
    errors that vary with environment and from frame to frame.

    age           second
    mean, sigma   (n, m, 3) radian, of a normally distributed error, without the bias of the unit
    weight        (n, m) 1, weight of each field; sums to 1 for each unit
    bias          (n, 3) radian
    terms         (n, 3) radian, rms of each class of error except bias
    availability  (n,) 1
    """

    age: Annotated[float, Unit("s", "yr")]
    mean: Annotated[Floats, Unit("rad", "arcsec")]
    sigma: Annotated[Floats, Unit("rad", "arcsec")]
    weight: Floats
    bias: Annotated[Floats, Unit("rad", "arcsec")]
    terms: Annotated[dict[Term, Floats], Unit("rad", "arcsec")]
    availability: Floats

    @classmethod
    def of_one(cls, budget: Budget[ErrorLaw]) -> UnitBudgets:
        """`UnitBudgets` of one unit, the unit as designed at age 0; `terms` is empty."""
        law = budget.whole.spread
        available = np.array([budget.availability])
        bias = np.zeros((1, 3))
        return cls(0.0, law.mean[None], law.sigma[None], law.weight[None], bias, {}, available)

    def __len__(self) -> int:
        return len(self.mean)

    def unit(self, number: int) -> ErrorLaw:
        """The error of one unit, without its bias."""
        return ErrorLaw(self.mean[number], self.sigma[number], self.weight[number])

    def first(self, count: int) -> UnitBudgets:
        """The budgets of the first `count` units."""
        terms = {term: values[:count] for term, values in self.terms.items()}
        some = {name: getattr(self, name)[:count] for name in ARRAYS}
        return replace(self, terms=terms, **some)

    def all(self, biased: bool = True) -> ErrorLaw:
        """The error of all units together, with or without their biases."""
        mean = self.mean + self.bias[:, None] if biased else self.mean
        flat = [values.reshape(-1, 3) for values in (mean, self.sigma)]
        return ErrorLaw(flat[0], flat[1], self.weight.ravel() / len(self))

    def whole(self, number: int) -> ErrorLaw:
        """The error of one unit, with its bias."""
        return ErrorLaw(
            self.mean[number] + self.bias[number], self.sigma[number], self.weight[number]
        )

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
        """(n,) radian per axis: the error that each unit does not exceed in a fraction of the
        time."""
        units = map(self.unit, range(len(self)))
        return np.array([unit.level(axes, fraction, Interpretation.MIXED) for unit in units])

    def level(self, axes: Sequence[int], fraction: float, interpretation: Interpretation) -> float:
        """Radian per axis, by an interpretation of ECSS-E-ST-60-10C; without the biases.

        temporal: over the time, of the worst unit; ensemble: over the units, in the worst field;
        mixed: over both.

        Accuracy  statistical: the worst of few units or fields underestimates the worst of all.
        """
        match interpretation:
            case Interpretation.TEMPORAL:
                return float(self.levels(axes, fraction).max())
            case Interpretation.ENSEMBLE:
                fields = [
                    ErrorLaw(self.mean[:, f], self.sigma[:, f], self.weight[:, f] / total)
                    for f in range(self.mean.shape[1])
                    if (total := self.weight[:, f].sum()) > 0
                ]
                worst = 0.0  # of all fields so far; only a field with a larger level is computed
                for field in sorted(fields, key=lambda law: -law.rms()[list(axes)].max()):
                    if field.share_within(worst, axes) < fraction:
                        worst = field.level(axes, fraction, Interpretation.MIXED)
                return worst
        return self.all(biased=False).level(axes, fraction, Interpretation.MIXED)


def unit_budgets(
    case: Case,
    seed: int,
    count: int,
    age: float = 0.0,
    environments: int = ENVIRONMENTS,
    count_fields: int = FIELDS,
    progress: Advance | None = None,
    first: int = 0,
    apart: bool = True,
) -> UnitBudgets:
    """The analytic budget of each unit, for some units of a seed.

    age           second
    environments  number of environments of each unit
    progress      called with 1 for each unit
    first         number of the first unit
    apart         whether biases are separate; False: `mean` contains them, which takes 2/3 of the
                  time
    Raises    as `analytic`; ValueError if a unit is solved in no field.
    Accuracy  as `analytic`; 10 % of a unit's rms for 64 fields in 3 environments. With a lens table
              all units have the noise of the middle unit, see `middle_of`.
    """
    whole(1, 10**6, count=count)
    whole(1, 1000, environments=environments)
    numbers = range(-1 if apart else 0, environments)
    middle = _middle(case, seed, age, count_fields)
    settings = _Settings(age, numbers, count_fields, _alike(case), middle)
    units = []
    for unit in range(first, first + count):
        units.append(_of_unit(case, seed, unit, settings))
        if progress:
            progress(1)
    arrays: dict[str, Any] = {
        name: np.stack([getattr(unit, name) for unit in units]) for name in ARRAYS
    }
    terms = {
        term: np.stack([unit.terms.get(term, np.zeros(3)) for unit in units])
        for term in Term
        if any(term in unit.terms for unit in units)
    }
    return UnitBudgets(age=age, terms=terms, **arrays)


def joined(parts: Sequence[UnitBudgets]) -> UnitBudgets:
    """Budgets of units of one age that were computed separately, in order."""
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in ARRAYS
    }
    terms = {
        term: np.concatenate([part.terms.get(term, np.zeros((len(part), 3))) for part in parts])
        for term in Term
        if any(term in part.terms for part in parts)
    }
    return replace(parts[0], terms=terms, **arrays)


class _Settings(NamedTuple):
    """Settings of the budget of each unit.

    environments  numbers of the environments; a first one of -1, the calibration, makes the bias
                  separate
    alike         whether stars have the same response in all environments of a unit
    middle        plan that all units share; None: the response of each unit is measured
    """

    age: float
    environments: range
    fields: int
    alike: bool
    middle: _Middle | None


def _alike(case: Case) -> bool:
    """Whether variations from environment to environment change only the places of stars."""
    changing = (Scope.ENVIRONMENT, Scope.FRAME)
    return all(of_places(case, law.name) for law in case.varying if law.per in changing)


class _Lines(NamedTuple):
    """The lines of a budget over m fields, the weight (m,) of each field, and the availability."""

    lines: tuple[BudgetLine[ErrorLaw], ...]
    weight: Floats
    availability: float


class _Middle(NamedTuple):
    """The middle unit: attitude errors from displacements, and the errors that all units share.

    Units differ by small displacements of stars at the same places of the frame. The attitude error
    is linear in these displacements.

    unit    the middle unit
    still   the design and its middle unit at rest
    seed    seed of the units
    answer  matrix from `Attitudes.by_lattice`
    shared  lines that all units share
    """

    unit: Case
    still: tuple[Case, Case]
    seed: int
    answer: Floats
    shared: _Lines

    def of(self, moment: Moment) -> _Lines:
        """The budget lines of a unit at a moment."""
        unit, moved = _displaced(*self.still, self.seed, moment)
        unit = unchecked(unit, {"instrument.motion": self.unit.instrument.motion})
        weight = self.shared.weight
        lines, none = list(self.shared.lines), np.zeros((len(weight), 3))
        mean = np.tensordot(self.answer, moved, 2).T
        lines.append(BudgetLine(CAMERA_MODEL, Term.FIELD, ErrorLaw(mean, none, weight)))
        for cause in TURNS:
            of_all = of_the_camera(unit, cause)
            if of_all and np.any(of_all):
                mean, sigma = (none + values for values in of_all)
                lines.append(BudgetLine(cause.name, cause.term, ErrorLaw(mean, sigma, weight)))
        return self.shared._replace(lines=tuple(lines))


@lru_cache(maxsize=128)
def _displaced(case: Case, like: Case, seed: int, moment: Moment) -> tuple[Case, Floats]:
    """A unit at a moment, and the displacements (2, LATTICE^2) pixel of its stars over the frame.

    The last 128 are cached, because the conditions of a design differ only in motion.
    """
    unit = placed(case, like, seed, moment)
    # The rotation that the mounting's calibration corrects is subtracted first. It is hundreds of
    # arcseconds for a shift of the principal point, so an error of 1/1000 of it would matter.
    turn = unit.believed_mounting.camera_to_body().inv()
    turn *= unit.instrument.mounting.camera_to_body()
    true = unit.instrument.camera
    pixel = np.stack(np.meshgrid(*lattice_nodes(true)), axis=-1).reshape(-1, 2)
    return unit, displacement(true, unit.believed_camera, pixel, turn).T


def _middle(case: Case, seed: int, age: float, count: int) -> _Middle | None:
    """The plan that all units share; None if units differ in noise or the median unit is blind."""
    unit = middle_of(case, age)
    if unit is None:
        return None
    view = listed_fields(unit, attitudes, count)
    solved = of_fields(unit, view, unit)
    if solved is None:
        raise blind(unit, f"the middle one of the units of seed {seed}")
    lines = tuple(
        line
        for line in solved.budget.lines
        if line.name not in OF_THE_CAMERA and line.term not in TURNED
    )
    weight, available = solved.budget.whole.spread.weight, solved.budget.availability
    shared, stars, camera = _Lines(lines, weight, available), solved.stars, unit.instrument.camera
    pixel = camera.project(np.column_stack([stars.x, stars.y, np.ones(len(stars.x))]))
    answer = solved.attitudes.by_lattice(stars.first, pixel, camera)
    rest = turning(case, 0.0)
    still = rest, middle_of(rest, age) or unit
    return _Middle(unit, still, seed, answer, shared)


class _UnitBudget(NamedTuple):
    """The values of `UnitBudgets` for one unit: (m, 3), (m, 3), (m,), (3,), (3,) and a number."""

    mean: Floats
    sigma: Floats
    weight: Floats
    bias: Floats
    terms: dict[Term, Floats]
    availability: float


def _of_unit(case: Case, seed: int, unit: int, settings: _Settings) -> _UnitBudget:
    """The budget of one unit over its environments."""
    means, sigmas, weights = (list[Floats]() for _ in range(3))
    squares, available, bias = dict[Term, list[Floats]](), list[float](), np.zeros(3)
    like: Case | None = None
    for environment in settings.environments:
        moment = Moment(unit, environment, environment, settings.age)
        if settings.middle:
            budget = settings.middle.of(moment)
        else:
            budget, like = _measured(case, seed, moment, settings, like)
        spreads = [line.spread for line in budget.lines]
        none = np.zeros_like(spreads[0].mean)
        of_camera = (line.spread.mean for line in budget.lines if line.name in OF_THE_CAMERA)
        camera = sum(of_camera, none)
        camera_mean = budget.weight @ camera
        if environment < 0:
            bias = camera_mean
            continue
        square = {Term.FIELD: budget.weight @ (camera - camera_mean) ** 2}
        for line in budget.lines:
            if line.term and line.name not in OF_THE_CAMERA:
                before = square.get(line.term, np.zeros(3))
                square[line.term] = before + line.spread.rms() ** 2
        before = square.get(Term.THERMO_ELASTIC, np.zeros(3))
        square[Term.THERMO_ELASTIC] = before + (camera_mean - bias) ** 2
        for term, value in square.items():
            squares.setdefault(term, []).append(value)
        available.append(budget.availability)
        means.append(np.sum([spread.mean for spread in spreads], axis=0))
        sigmas.append(np.sqrt(np.sum([spread.sigma**2 for spread in spreads], axis=0)))
        weights.append(budget.weight / settings.environments.stop)
    terms = {term: np.sqrt(np.mean(values, axis=0)) for term, values in squares.items()}
    return _UnitBudget(
        np.concatenate(means) - bias,
        np.concatenate(sigmas),
        np.concatenate(weights),
        bias,
        terms,
        float(np.mean(available)),
    )


def _measured(
    case: Case, seed: int, moment: Moment, settings: _Settings, like: Case | None
) -> tuple[_Lines, Case | None]:
    """The lines of a unit at a moment, and the case whose response its other moments use.

    like  case of an earlier moment, whose response is used; None: the response is measured
    """
    unit = unit_of(case, seed, moment)
    view = listed_fields(unit, attitudes, settings.fields)
    alike = like or _as_measured(unit)
    solved = of_fields(unit, view, alike)
    if solved is None:
        raise blind(unit, f"unit {moment.unit} of seed {seed}")
    budget = solved.budget
    lines = _Lines(budget.lines, budget.whole.spread.weight, budget.availability)
    return lines, alike if settings.alike else like


def _as_measured(case: Case) -> Case:
    """A unit without the parameters that do not change its response to single stars.

    Units that differ only in such parameters are measured once.
    """
    instrument, mounting, seed = case.instrument, Mounting(), "instrument.detector.device_seed"
    detector = replace(instrument.detector, device_seed=0)
    return replace(
        case,
        instrument=replace(instrument, detector=detector, mounting=mounting, delay=0.0),
        tracker=replace(case.tracker, mounting=mounting, delay=0.0),
        design=case.design and unchecked(case.design, {seed: 0}),  # its pixels are in the dark map
    )
