"""Case -> what the analytic budget expects of it in each condition, as designed or over units."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import NamedTuple, TypeVar

from startrack import verification
from startrack.budget import Budget, ErrorLaw, UnitBudgets, analytic, joined, unit_budgets
from startrack.core import Refused, Rows
from startrack.design import NOMINAL, Campaign, Case, Judged, Objective, Requirements
from startrack.metrics import quantile_of_few
from startrack.optics import COARSE
from startrack.optimise.runner import TrialRunner
from startrack.verification import margin
from startrack.verification import margins as margins_of

Value = TypeVar("Value")
# Amount by which an error may miss its limit in a score; beyond, ln(error) alone drives the search.
# Chosen by hand: an error of ten times the limit.
MOST_MISSED = 9.0


def name_by_condition(condition: str, margins: Mapping[str, Value]) -> dict[str, Value]:
    """Margins with the name of their condition, except those of the design's own."""
    if condition == NOMINAL:
        return dict(margins)
    return {f"{name} ({condition})": margin for name, margin in margins.items()}


def bounded(margins: Mapping[str, float]) -> dict[str, float]:
    """The margins, of which none misses by more than MOST_MISSED, so that a score stays finite."""
    return {name: max(margin, -MOST_MISSED) for name, margin in margins.items()}


def blind(needs: Requirements) -> dict[str, float]:
    """The margins where no attitude is expected: all missed by the most."""
    errors = {accuracy.name: -MOST_MISSED for accuracy in needs.accuracy}
    return errors | {"availability": -needs.min_availability}


def _coarse(case: Case) -> Case:
    optics = case.instrument.optics
    if not (optics.tabulated and optics.psf_tolerance < COARSE):
        return case
    instrument = replace(case.instrument, optics=replace(optics, psf_tolerance=COARSE))
    return replace(case, instrument=instrument)


@lru_cache(maxsize=16)
def _budget(case: Case) -> Budget[ErrorLaw] | None:
    """The analytic budget, None where it expects no attitude anywhere; of the 16 last cases.

    Behind a lens table from images of few wavelengths, because each design needs its own.
    """
    try:
        return analytic(_coarse(case))
    except Refused:
        return None


def budget_of(case: Case) -> Budget[ErrorLaw]:
    """The analytic budget, kept as those of a search are; Refused where it expects no attitude."""
    return _budget(case) or analytic(case)  # which says why there is none


ENVIRONMENTS = 2  # of each unit, in a search; chosen by hand: time against the rms of a unit


@lru_cache(maxsize=16)
def budgets_of_units(
    case: Case, seed: int, age: float, first: int, count: int, environments: int = ENVIRONMENTS
) -> UnitBudgets | None:
    """The analytic budgets of some units, None where one has no attitude; of the 16 last cases."""
    try:
        return unit_budgets(_coarse(case), seed, count, age, environments, first=first, apart=False)
    except Refused:
        return None


class Forecast(NamedTuple):
    """Expectation of the analytic budget for a design in one condition.

    error    radian, the objective; NaN where no attitude is expected
    margins  of the requirements that need trials
    over     of the objective and those that are limited: the level over all units over the error of
             the first 1, 2, ... of them together; none where it is judged as designed
    """

    error: float
    margins: dict[str, float]
    over: dict[str, list[float]] = {}  # noqa: RUF012, never changed


def over_units(
    condition: Judged, outcomes: Rows, objective: Objective, foreseen: Forecast | None
) -> float:
    """The level over units over the error of all those together that were tried, by the budgets."""
    if condition.units is None or not (foreseen and foreseen.over):
        return 1.0
    return foreseen.over[str(objective)][math.ceil(len(outcomes) / condition.units.trials) - 1]


def forecast(condition: Judged, objective: Objective, seed: int = 1) -> Forecast:
    """The objective and the margins of one condition by the analytic budget.

    seed  of the units
    """
    if condition.units is not None:
        age, count = condition.units.age, condition.units.count
        units = budgets_of_units(condition.case, seed, age, 0, count)
        return _forecast_units(condition, objective, [units])
    budget = _budget(condition.case)
    if budget is None:
        return Forecast(math.nan, blind(condition.needs))
    margins = bounded(verification.expected_margins(condition.needs, budget))
    # Errors have margins of their own here: the availability must not count them again.
    margins["availability"] = budget.availability - condition.needs.min_availability
    return Forecast(verification.expected_error(objective, budget), margins)


def _forecast_units(
    condition: Judged, objective: Objective, parts: Sequence[UnitBudgets | None]
) -> Forecast:
    """`forecast` from the budgets of units, in parts."""
    solved = [part for part in parts if part is not None]
    if condition.units is None or len(solved) < len(parts):
        return Forecast(math.nan, blind(condition.needs))
    units, fraction = joined(solved), condition.units.fraction
    limits = condition.needs.accuracy
    every = {str(goal): goal for goal in (objective, *(limit.objective for limit in limits))}
    # That a fraction of the units does not exceed, by their budgets.
    level = {
        name: float(quantile_of_few(verification.units_expected(goal, units), fraction))
        for name, goal in every.items()
    }
    errors = {limit.name: margin(limit.most, level[str(limit.objective)]) for limit in limits}
    margins = bounded(errors)
    margins["availability"] = float(units.availability.mean()) - condition.needs.min_availability
    first = [units.first(count) for count in range(1, len(units) + 1)]
    over = {
        name: [float(level[name] / verification.expected_of(goal, some.all())) for some in first]
        for name, goal in every.items()
    }
    return Forecast(level[str(objective)], margins, over)


# What a worker computes of a condition: its forecast, or the budgets of some of its units.
Task = tuple[Judged, range | None]


def _tasks(condition: Judged, workers: int) -> list[Task]:
    if condition.units is None:
        return [(condition, None)]
    count = condition.units.count
    # Behind a lens table all units share the images and the response of one, which take longest.
    shared = condition.case.instrument.optics.tabulated
    size = count if shared else math.ceil(count / workers)
    return [(condition, range(at, min(at + size, count))) for at in range(0, count, size)]


def _done(task: Task, objective: Objective, seed: int) -> Forecast | UnitBudgets | None:
    condition, units = task
    if condition.units is None or units is None:
        return forecast(condition, objective)
    return budgets_of_units(condition.case, seed, condition.units.age, units.start, len(units))


def forecasts(
    judged: Sequence[Judged],
    objective: Objective,
    runner: TrialRunner | None = None,
    seed: int = 1,
    known: Mapping[str, Forecast] | None = None,
) -> tuple[float, dict[str, Forecast]]:
    """The objective (radian) by the analytic budget, and what it expects of each condition.

    runner  whose workers compute the conditions and units; None: this process
    seed    of the units, without a runner
    known   what is expected of some conditions already
    """
    (seed, workers), given = (runner.seed, runner.workers) if runner else (seed, 1), known or {}
    tasks = [[] if condition.name in given else _tasks(condition, workers) for condition in judged]
    call = partial(_done, objective=objective, seed=seed)
    every = iter((runner.map if runner else map)(call, [task for some in tasks for task in some]))
    foreseen = list[Forecast]()
    for condition, some in zip(judged, tasks, strict=True):
        parts = [next(every) for _ in some]
        if condition.name in given:
            foreseen.append(given[condition.name])
        elif isinstance(parts[0], Forecast):
            foreseen.append(parts[0])
        else:
            of_units = [part if isinstance(part, UnitBudgets) else None for part in parts]
            foreseen.append(_forecast_units(condition, objective, of_units))
    pairs = list(zip(judged, foreseen, strict=True))
    errors = [expected.error for condition, expected in pairs if condition.weight]
    weights = [condition.weight for condition in judged if condition.weight]
    by_name = {condition.name: expected for condition, expected in pairs}
    return objective.over(errors, weights), by_name


def without_units(case: Case) -> Case:
    """The unit as designed, whose budget does not name as left out what units differ by."""
    alone = case.without_units
    return replace(alone, instrument=replace(alone.instrument, residual=None))


def expect(
    case: Case, campaign: Campaign, seed: int = 1
) -> tuple[Budget[ErrorLaw], dict[str, float]]:
    """The analytic budget of a design in its own condition, and all its margins without a trial.

    seed    of the units, where it is judged over units; the budget is of the unit as designed
    Raises  ValueError where the budget expects no attitude anywhere, or a condition does not fit.
    """
    judged = campaign.judged(case)
    alone = case if judged[0].units is None else without_units(case)
    budget = budget_of(alone)
    margins = margins_of(campaign.requirements, case)
    if judged[0].units is None:
        margins |= verification.expected_margins(campaign.requirements, budget)
    else:
        margins |= forecast(judged[0], Objective(), seed).margins
    for condition in judged[1:]:
        if condition.units is not None:
            margins |= name_by_condition(
                condition.name, forecast(condition, Objective(), seed).margins
            )
            continue
        there, needs = _budget(condition.case), condition.needs
        own = verification.expected_margins(needs, there) if there else blind(needs)
        margins |= name_by_condition(condition.name, own)
    return budget, margins


def expected_objective(case: Case, campaign: Campaign, seed: int = 1) -> float:
    """The objective (radian) by the analytic budget, over all conditions that have a weight.

    seed  of the units, where it is judged over units
    """
    objective = campaign.goal
    judged = [condition for condition in campaign.judged(case) if condition.weight]
    return forecasts(judged, objective, seed=seed)[0]
