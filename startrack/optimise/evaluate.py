"""Point of a DesignSpace -> the score of its design."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from scipy import special

from startrack.budget import Budget, Law, analytic
from startrack.core import Floats, arcsec
from startrack.design import AXES, Campaign, Case, DesignSpace, Objective, Requirements
from startrack.metrics import Summary, summarise
from startrack.optimise.margins import margins as margins_of
from startrack.optimise.runner import TrialRunner
from startrack.trial import OUTCOMES

# ln(error) for each unit of a margin that is missed. Chosen by hand: it must exceed the slope of
# ln(error) along every margin; a larger one makes the valley along a limit narrower.
PENALTY = 10.0
LOST = 20.0  # ln(arcsec) of a design that no trial solves; chosen by hand: far above any error


@dataclass(frozen=True)
class Evaluation:
    """One design that was evaluated.

    coordinates  (d,) in the unit cube
    values       of the variables, SI
    error        radian, the objective; NaN where no trial was solved
    expected     radian, the objective by the analytic budget; NaN where it expects no attitude
    score        the function that is minimised, see `evaluate`
    margins      of the requirements, with that of the availability; below 0, not met
    summary      of the trials, None where none was run
    note         why none was run, or empty
    """

    coordinates: tuple[float, ...]
    values: dict[str, float]
    error: float
    expected: float
    score: float
    margins: dict[str, float]
    summary: Summary | None
    note: str

    @property
    def feasible(self) -> bool:
        """Whether every requirement is met."""
        return self.summary is not None and all(m >= 0 for m in self.margins.values())

    @property
    def trials(self) -> int:
        """How many trials were run."""
        return self.summary.trials if self.summary else 0


def evaluate(
    space: DesignSpace,
    campaign: Campaign,
    coordinates: Floats,
    runner: TrialRunner,
    trials: int | None = None,
    correction: Callable[[Floats], float] | None = None,
    spare: bool = False,
    lead: float = math.inf,
) -> Evaluation:
    """Score a design by its analytic budget, corrected by trials.

        score = ln(expected / arcsec) + correction(coordinates) + PENALTY sum(max(0, -margin))

    The budget gives the differences between designs without noise. Trials, with the same attitudes
    and random streams for every design, give what the budget neglects: the correction, and how
    often an attitude is found. An L1 penalty has the same minimum as the constrained problem where
    PENALTY exceeds the slope of ln(error) along the margin (Fletcher 1987, Practical Methods of
    Optimization, 14.3).

    trials      None for the campaign's first number
    correction  ln(error / expected) at unit-cube coordinates, None for zero
    spare       whether no trials are run where a requirement that needs none is missed
    lead        score of the best so far; no trials are run where the score without them is worse,
                as they only add penalties
    Returns     an evaluation; its note is the reason where a design cannot be built or rendered
    """
    coordinates = np.clip(coordinates, 0, 1)
    values = space.values(coordinates)
    objective = Objective.read(campaign.objective)
    try:
        case = space.design(coordinates)
        margins = margins_of(campaign.requirements, case)
        expected = forecast(case, objective)
        score = _log_arcsec(expected) + (correction(coordinates) if correction else 0.0)
        hopeless = expected > 0 and score + PENALTY * missed(margins) > lead
        if hopeless or (spare and missed(margins)):
            outcomes = np.empty(0, OUTCOMES)
        else:
            outcomes = runner.run(case, trials or campaign.trials, campaign.fidelity)
    except ValueError as reason:  # such a design has the worst score; the search goes on
        refused = LOST + PENALTY
        return Evaluation(
            tuple(coordinates), values, math.nan, math.nan, refused, {}, None, str(reason)
        )
    summary = summarise(outcomes) if len(outcomes) else None
    if summary:
        margins |= measured(campaign.requirements, summary)
    error = float(objective.of(objective.squares(outcomes)))
    if not expected > 0:
        score = _log_arcsec(error) + (correction(coordinates) if correction else 0.0)
    score += PENALTY * missed(margins)
    return Evaluation(tuple(coordinates), values, error, expected, score, margins, summary, "")


def forecast(case: Case, objective: Objective) -> float:
    """Error by the analytic budget (radian); NaN where it expects no attitude anywhere."""
    try:
        return expected_error(objective, analytic(case))
    except ValueError:
        return math.nan


def expect(case: Case, campaign: Campaign) -> tuple[Budget, dict[str, float]]:
    """The analytic budget of a design, and all its margins without a trial.

    Raises  ValueError where the budget expects no attitude anywhere.
    """
    budget = analytic(case)
    margins = margins_of(campaign.requirements, case)
    margins["availability"] = budget.availability - campaign.requirements.min_availability
    return budget, margins


def foresee(space: DesignSpace, campaign: Campaign, coordinates: Floats) -> float:
    """The score of a design without a trial; NaN where it cannot be built.

    Accuracy  model: that of the budget. The result of a search needs trials too, as an optimiser
              is drawn to designs whose error the model underestimates.
    """
    try:
        budget, margins = expect(space.design(coordinates), campaign)
    except ValueError:
        return math.nan
    expected = expected_error(Objective.read(campaign.objective), budget)
    return _log_arcsec(expected) + PENALTY * missed(margins)


def _log_arcsec(angle: float) -> float:
    return math.log(angle / arcsec) if angle > 0 else LOST


def measured(requirements: Requirements, summary: Summary) -> dict[str, float]:
    """The margins that need trials."""
    return {
        "availability": summary.availability.value - requirements.min_availability,
        "false attitudes": -summary.false.value,
    }


def measured_score(one: Evaluation) -> float:
    """The score of an evaluation by its trials alone."""
    return _log_arcsec(one.error) + PENALTY * missed(one.margins) if one.summary else one.score


def missed(margins: dict[str, float]) -> float:
    """The sum of the amounts by which margins are missed."""
    return sum(max(0.0, -margin) for margin in margins.values())


def expected_error(objective: Objective, budget: Budget) -> float:
    """The objective's statistic of the errors that a budget expects (radian).

        sum_i weight_i P(k / 2, L^2 / (2 square_i)) = fraction,   P the regularised incomplete
        gamma function, k = 2, 1, 3 axes, square_i the mean square per axis in field i

    Accuracy  model: errors that are normal, with equal variance about the axes, in each field.
    """
    law = budget.whole.spread
    assert isinstance(law, Law)
    axes = AXES[objective.axes]
    squares = (law.mean**2 + law.sigma**2)[:, axes].mean(axis=1)
    if objective.fraction is None:
        return math.sqrt(float(law.weight @ squares))
    fraction, half = objective.fraction, len(axes) / 2

    def excess(log_square: float) -> float:
        reached = special.gammainc(half, math.exp(log_square) / (2 * squares))
        return float(law.weight @ reached) - fraction

    lowest, highest = math.log(squares.min()) - 40, math.log(squares.max()) + 10
    return math.exp(scipy.optimize.brentq(excess, lowest, highest) / 2)
