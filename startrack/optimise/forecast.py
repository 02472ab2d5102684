"""Case -> its expected figures by the analytic budget in each condition, over its units."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from startrack.budget import Budget, ErrorLaw, UnitBudgets, joined
from startrack.core import Refused, Rows
from startrack.design import NOMINAL, Campaign, Case, Judged, Objective, Requirements
from startrack.metrics import quantile_of_few
from startrack.optimise.budgets import budget_of, budget_or_refusal, without_units
from startrack.optimise.limit import MOST_MISSED
from startrack.optimise.population import population_of
from startrack.optimise.runner import TrialRunner
from startrack.verification import expected_margins, expected_of, expected_over, limited, margin
from startrack.verification import margins as margins_of

Value = TypeVar("Value")


def name_by_condition(condition: str, margins: Mapping[str, Value]) -> dict[str, Value]:
    """Margins with the name of their condition, except those of the design's own."""
    if condition == NOMINAL:
        return dict(margins)
    return {f"{name} ({condition})": margin for name, margin in margins.items()}


def bounded(margins: Mapping[str, float]) -> dict[str, float]:
    """The margins, none below -MOST_MISSED, so that a score stays finite."""
    return {name: max(margin, -MOST_MISSED) for name, margin in margins.items()}


def blind(needs: Requirements) -> dict[str, float]:
    """The margins if no attitude is expected: all are missed by MOST_MISSED."""
    errors = {accuracy.name: -MOST_MISSED for accuracy in needs.accuracy}
    return errors | {"availability": -needs.min_availability}


# The errors that tables show of each design, by their names.
SHOWN = {"across": Objective("across"), "about": Objective("about")}
# Task of a worker: a condition, and some of the units over which it is judged.
Task = tuple[Judged, range]


class Forecast(NamedTuple):
    """Expectation of the analytic budget for a design in one condition.

    error    radian, the objective; NaN if no attitude is expected
    margins  margins of the requirements that need trials
    over     for the objective and each limited error: ratios of the level over all units to the
             error of the first 1, 2, ... units together; none if no attitude is expected
    shown    radian, errors that tables show, over the units; none if no attitude is expected
    reason   why no attitude is expected, or empty
    """

    error: float
    margins: dict[str, float]
    over: dict[str, list[float]] = {}  # noqa: RUF012, never changed
    shown: dict[str, float] = {}  # noqa: RUF012, never changed
    reason: str = ""

    @classmethod
    def without_attitude(cls, needs: Requirements, reason: Refused) -> "Forecast":
        """All requirements are missed by MOST_MISSED."""
        return cls(math.nan, blind(needs), reason=str(reason))


def over_units(
    condition: Judged, outcomes: Rows, objective: Objective, foreseen: Forecast | None
) -> float:
    """Ratio, by the budgets, of the level over units to the error of all tried units together."""
    if not (foreseen and foreseen.over):
        return 1.0
    return foreseen.over[str(objective)][population_of(condition).tried(outcomes) - 1]


def forecast(condition: Judged, objective: Objective, seed: int = 1) -> Forecast:
    """The objective and the margins of one condition by the analytic budget.

    seed  of the units
    """
    units = population_of(condition)
    return _forecast(condition, objective, [units.budgets(seed, part) for part in units.parts(1)])


def _forecast(
    condition: Judged, objective: Objective, parts: Sequence[UnitBudgets | Refused]
) -> Forecast:
    """`forecast` from the budgets of units, in parts."""
    solved, needs = list[UnitBudgets](), condition.needs
    for part in parts:
        if isinstance(part, Refused):
            return Forecast.without_attitude(needs, part)
        solved.append(part)
    units, fraction = joined(solved), population_of(condition).fraction

    def level(goal: Objective, sky: str) -> float:
        errors = [expected_over(goal, units.whole(k), sky) for k in range(len(units))]
        return float(quantile_of_few(np.array(errors), fraction))

    goals = {
        str(goal): goal
        for goal in (objective, *(limit.objective for limit in needs.accuracy), *SHOWN.values())
    }
    # Levels that a fraction of the units does not exceed, by their budgets.
    levels = {
        sky: {name: level(goal, sky) for name, goal in goals.items()}
        for sky in {"whole", needs.sky}
    }
    limited = levels[needs.sky]
    errors = {
        limit.name: margin(limit.most, limited[str(limit.objective)]) for limit in needs.accuracy
    }
    margins = bounded(errors)
    # Errors have separate margins: the availability must not count them again.
    margins["availability"] = float(units.availability.mean()) - needs.min_availability
    first = [units.first(count).all() for count in range(1, len(units) + 1)]
    over = {
        name: [levels["whole"][name] / expected_of(goal, some) for some in first]
        for name, goal in goals.items()
    }
    shown = {name: levels["whole"][str(goal)] for name, goal in SHOWN.items()}
    return Forecast(levels["whole"][str(objective)], margins, over, shown)


def _budgets(task: Task, seed: int) -> UnitBudgets | Refused:
    condition, part = task
    return population_of(condition).budgets(seed, part)


def forecasts(
    judged: Sequence[Judged],
    objective: Objective,
    runner: TrialRunner | None = None,
    seed: int = 1,
    known: Mapping[str, Forecast] | None = None,
) -> tuple[float, dict[str, Forecast]]:
    """The objective (radian) by the analytic budget, and the expected figures of each condition.

    runner  whose workers compute the conditions and units; None: this process
    seed    of the units, without a runner
    known   already known figures of some conditions
    """
    (seed, workers), given = (runner.seed, runner.workers) if runner else (seed, 1), known or {}
    new = [condition for condition in judged if condition.name not in given]
    tasks = [
        (condition, part) for condition in new for part in population_of(condition).parts(workers)
    ]
    budgets = (runner.map if runner else map)(partial(_budgets, seed=seed), tasks)
    parts = {condition.name: list[UnitBudgets | Refused]() for condition in new}
    for (condition, _), part in zip(tasks, budgets, strict=True):
        parts[condition.name].append(part)
    made = {
        condition.name: _forecast(condition, objective, parts[condition.name]) for condition in new
    }
    by_name = {condition.name: {**given, **made}[condition.name] for condition in judged}
    weighted = [condition for condition in judged if condition.weight]
    errors = [by_name[condition.name].error for condition in weighted]
    return objective.over(errors, [condition.weight for condition in weighted]), by_name


class ExpectedDesign(NamedTuple):
    """Errors and margins of a design in its own condition, by formula.

    budget   budget of the unit as designed
    margins  margins of all requirements, in all conditions
    shown    radian, rms errors across and about the boresight: over units if the design is judged
             over units, otherwise those of the budget
    refused  conditions without a forecast, and the reason
    missing  names of their margins, whose values are those of `blind`
    needs    requirements of the margins of conditions, by the names of the margins
    """

    budget: Budget[ErrorLaw]
    margins: dict[str, float]
    shown: dict[str, float]
    refused: dict[str, str]
    missing: list[str]
    needs: dict[str, Requirements]

    def value_and_limit(self, needs: Requirements, name: str, needed: float) -> tuple[str, str]:
        """Value and limit of a margin as texts, as `limited`.

        A margin without a forecast has no value; one that is cut off at -MOST_MISSED has a least
        value.
        """
        value, limit = limited(self.needs.get(name, needs), name, self.margins[name], needed)
        if name in self.missing:
            return "no forecast", limit
        cut_off = value and name in self.needs and self.margins[name] == -MOST_MISSED
        return f"{value} or more" if cut_off else value, limit


def expect(case: Case, campaign: Campaign, seed: int = 1) -> ExpectedDesign:
    """The analytic budget of a design in its own condition, and all its margins without a trial.

    seed    of the units, where it is judged over units; the budget is of the unit as designed
    Raises  ValueError if the budget expects no attitude anywhere, or a condition does not fit.
    """
    judged = campaign.judged(case)
    alone = case if judged[0].units is None else without_units(case)
    budget = budget_of(alone)
    margins = margins_of(campaign.requirements, case)
    shown = {"across": budget.whole.across, "about": budget.whole.about}
    refused, missing, needs = dict[str, str](), list[str](), dict[str, Requirements]()
    for condition in judged:
        expected = _expected(condition, seed)
        if expected.reason:
            refused[condition.name] = expected.reason
            missing += name_by_condition(condition.name, expected.margins)
        margins |= name_by_condition(condition.name, expected.margins)
        own = dict.fromkeys(expected.margins, condition.needs)
        needs |= name_by_condition(condition.name, own)
        if condition is judged[0] and condition.units is not None:
            shown = dict.fromkeys(SHOWN, math.nan) | expected.shown
    return ExpectedDesign(budget, margins, shown, refused, missing, needs)


def _expected(condition: Judged, seed: int) -> Forecast:
    """Forecast of a condition; the availability of the unit as designed excludes large errors."""
    if condition.units is not None:
        return forecast(condition, Objective(), seed)
    budget, needs = budget_or_refusal(condition.case), condition.needs
    if isinstance(budget, Refused):
        return Forecast.without_attitude(needs, budget)
    return Forecast(math.nan, expected_margins(needs, budget))


def expected_objective(case: Case, campaign: Campaign, seed: int = 1) -> float:
    """The objective (radian) by the analytic budget, over all conditions that have a weight.

    seed  of the units, where it is judged over units
    """
    objective = campaign.goal
    judged = [condition for condition in campaign.judged(case) if condition.weight]
    return forecasts(judged, objective, seed=seed)[0]
