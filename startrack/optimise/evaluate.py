"""Point of a DesignSpace -> the score of its design."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.budget import Budget, Law, analytic
from startrack.core import Floats, arcsec
from startrack.design import (
    NOMINAL,
    Campaign,
    Case,
    DesignSpace,
    Judged,
    Objective,
    Requirements,
)
from startrack.metrics import Summary, summarise
from startrack.optics import COARSE
from startrack.optimise.runner import TrialRunner
from startrack.verification import (
    boresights,
    counted,
    expected_error,
    expected_margins,
    margin,
    measured_over,
)
from startrack.verification import margins as margins_of

# ln(error) for each unit of a margin that is missed. Chosen by hand: it must exceed the slope of
# ln(error) along every margin; a larger one makes the valley along a limit narrower.
PENALTY = 10.0
# Amount by which an error may miss its limit in a score; beyond, ln(error) alone drives the search.
# Chosen by hand: an error of ten times the limit.
MOST_MISSED = 9.0
LOST = 20.0  # ln(arcsec) of a design that no trial solves; chosen by hand: far above any error


@dataclass(frozen=True)
class Evaluation:
    """One design that was evaluated.

    coordinates  (d,) in the unit cube
    values       of the variables, SI
    error        radian, the objective; NaN where no trial was solved
    expected     radian, the objective by the analytic budget; NaN where it expects no attitude
    score        the function that is minimised, see `evaluate`
    margins      of the requirements, with those of errors and availability; below 0, not met
    summary      of the trials in the design's own condition, None where none was run
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
    often an attitude is found. Of several conditions, `expected` is the geometric mean by their
    weights; those of weight 0 have no trials here, and their margins are the budget's. An L1
    penalty has the same minimum as the constrained problem where
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
        judged = campaign.judged(space.design(coordinates))
        margins = margins_of(campaign.requirements, judged[0].case)
        expected, foreseen = forecasts(judged, objective, runner)
        score = _log_arcsec(expected) + (correction(coordinates) if correction else 0.0)
        hopeless = expected > 0 and score + PENALTY * missed(margins) > lead
        if hopeless or (spare and missed(margins)):
            tried = {}
        else:
            tried = {
                one.name: runner.run(one.case, trials or campaign.trials, campaign.fidelity)
                for one in judged
                if one.weight
            }
    except ValueError as reason:  # such a design has the worst score; the search goes on
        refused = LOST + PENALTY
        return Evaluation(
            tuple(coordinates), values, math.nan, math.nan, refused, {}, None, str(reason)
        )
    summary = summarise(tried[NOMINAL], campaign.requirements.limits) if tried else None
    for one in judged if tried else ():
        by_trials = tried.get(one.name)
        found = foreseen[one.name] if by_trials is None else measured(one, by_trials, runner.seed)
        margins |= named(one.name, found)
    error = combined(judged, tried, objective)
    if not expected > 0:
        score = _log_arcsec(error) + (correction(coordinates) if correction else 0.0)
    score += PENALTY * missed(margins)
    return Evaluation(tuple(coordinates), values, error, expected, score, margins, summary, "")


def named(condition: str, margins: Mapping[str, float]) -> dict[str, float]:
    """Margins with the name of their condition, except those of the design's own."""
    if condition == NOMINAL:
        return dict(margins)
    return {f"{name} ({condition})": margin for name, margin in margins.items()}


def geometric_mean(errors: Sequence[float], weights: Sequence[float]) -> float:
    """Mean of errors by their weights; NaN where there is none, or one is NaN or zero."""
    if not errors or not all(error > 0 for error in errors):
        return math.nan
    if len(errors) == 1:
        return errors[0]
    logs = [weight * math.log(error) for error, weight in zip(errors, weights, strict=True)]
    return math.exp(math.fsum(logs) / math.fsum(weights))


def combined(
    judged: Sequence[Judged], tried: Mapping[str, NDArray[np.void]], objective: Objective
) -> float:
    """The objective (radian) over the trials of all conditions that have a weight."""
    counted = [one for one in judged if one.weight and one.name in tried]
    errors = [float(objective.of(objective.squares(tried[one.name]))) for one in counted]
    return geometric_mean(errors, [one.weight for one in counted]) if counted else math.nan


@lru_cache(maxsize=16)
def _budget(case: Case) -> Budget[Law] | None:
    """The analytic budget, None where it expects no attitude anywhere; of the 16 last cases.

    Behind a lens table from images of few wavelengths, because each design needs its own.
    """
    optics = case.instrument.optics
    if optics.tabulated and optics.psf_tolerance < COARSE:
        instrument = replace(case.instrument, optics=replace(optics, psf_tolerance=COARSE))
        case = replace(case, instrument=instrument)
    try:
        return analytic(case)
    except ValueError:
        return None


class Forecast(NamedTuple):
    """What the analytic budget expects of a design in one condition.

    error    radian, the objective; NaN where no attitude is expected
    margins  of the requirements that need trials
    """

    error: float
    margins: dict[str, float]


def forecast(one: Judged, objective: Objective) -> Forecast:
    """The objective and the margins of one condition by the analytic budget."""
    budget = _budget(one.case)
    if budget is None:
        return Forecast(math.nan, blind(one.needs))
    found = bounded(expected_margins(one.needs, budget))
    # Errors have margins of their own here: the availability must not count them again.
    found["availability"] = budget.availability - one.needs.min_availability
    return Forecast(expected_error(objective, budget), found)


def forecasts(
    judged: Sequence[Judged], objective: Objective, runner: TrialRunner | None = None
) -> tuple[float, dict[str, dict[str, float]]]:
    """The objective (radian) by the analytic budget, and the margins of each condition by it.

    runner  whose workers compute the conditions; None: this process
    """
    every = (runner.map if runner else map)(partial(forecast, objective=objective), judged)
    return _joined(judged, list(every))


def _joined(
    judged: Sequence[Judged], every: Sequence[Forecast]
) -> tuple[float, dict[str, dict[str, float]]]:
    margins = {one.name: found.margins for one, found in zip(judged, every, strict=True)}
    weights = [one.weight for one in judged]
    counted = [each.error for each, weight in zip(every, weights, strict=True) if weight]
    return geometric_mean(counted, [weight for weight in weights if weight]), margins


def bounded(margins: Mapping[str, float]) -> dict[str, float]:
    """The margins, of which none misses by more than MOST_MISSED, so that a score stays finite."""
    return {name: max(found, -MOST_MISSED) for name, found in margins.items()}


def blind(needs: Requirements) -> dict[str, float]:
    """The margins where no attitude is expected: all missed by the most."""
    return {
        **{one.name: -MOST_MISSED for one in needs.accuracy},
        "availability": -needs.min_availability,
    }


def expect(case: Case, campaign: Campaign) -> tuple[Budget[Law], dict[str, float]]:
    """The analytic budget of a design in its own condition, and all its margins without a trial.

    Raises  ValueError where the budget expects no attitude anywhere, or a condition does not fit.
    """
    judged = campaign.judged(case)
    budget = _budget(case) or analytic(case)  # which says why there is none
    margins = margins_of(campaign.requirements, case)
    margins |= expected_margins(campaign.requirements, budget)
    for one in judged[1:]:
        there = _budget(one.case)
        found = expected_margins(one.needs, there) if there else blind(one.needs)
        margins |= named(one.name, found)
    return budget, margins


def expected_objective(case: Case, campaign: Campaign, text: str | None = None) -> float:
    """An objective (radian) by the analytic budget, over all conditions that have a weight.

    text  the objective; None for the campaign's
    """
    objective = Objective.read(text or campaign.objective)
    return forecasts([one for one in campaign.judged(case) if one.weight], objective)[0]


def foresee(space: DesignSpace, campaign: Campaign, coordinates: Floats) -> float:
    """The score of a design without a trial; NaN where it cannot be built.

    Accuracy  model: that of the budget. The result of a search needs trials too, as an optimiser
              is drawn to designs whose error the model underestimates.
    """
    return foresee_all(space, campaign, [coordinates])[0]


def foresee_all(
    space: DesignSpace,
    campaign: Campaign,
    points: Sequence[Floats],
    runner: TrialRunner | None = None,
) -> list[float]:
    """`foresee` of several designs, in the workers of a runner."""
    objective, designs = Objective.read(campaign.objective), list[_Foreseen | None]()
    for coordinates in points:
        try:
            case = space.design(coordinates)
            designs.append(
                _Foreseen(margins_of(campaign.requirements, case), campaign.judged(case))
            )
        except ValueError:
            designs.append(None)
    tasks = [one for each in designs if each for one in each.judged]
    every = iter((runner.map if runner else map)(partial(_tried, objective=objective), tasks))
    scores = []
    for each in designs:
        found = [next(every) for _ in each.judged] if each else []
        counted = [one for one in found if one is not None]
        scores.append(_score(each, counted) if each and len(counted) == len(found) else math.nan)
    return scores


class _Foreseen(NamedTuple):
    """A design in its conditions, and its margins that need no budget."""

    margins: dict[str, float]
    judged: Sequence[Judged]


def _tried(one: Judged, objective: Objective) -> Forecast | None:
    """`forecast`, None where the case contradicts itself."""
    try:
        return forecast(one, objective)
    except ValueError:
        return None


def _score(design: _Foreseen, every: Sequence[Forecast]) -> float:
    expected, foreseen = _joined(design.judged, every)
    if not expected > 0:
        return math.nan
    margins = dict(design.margins)
    for one in design.judged:
        margins |= named(one.name, foreseen[one.name])
    return _log_arcsec(expected) + PENALTY * missed(margins)


def _log_arcsec(angle: float) -> float:
    return math.log(angle / arcsec) if angle > 0 else LOST


def measured(one: Judged, outcomes: NDArray[np.void], seed: int) -> dict[str, float]:
    """The margins that need trials, as these found them, without regard to their interval."""
    needs, outcomes = one.needs, counted(one.needs, one.case, seed, outcomes)
    summary = summarise(outcomes, needs.limits)
    worst = needs.sky == "worst" and needs.accuracy
    boresight = boresights(seed, outcomes) if worst else np.empty((0, 3))
    errors = {
        each.name: margin(each.most, measured_over(each.objective, outcomes, boresight, needs.sky))
        for each in needs.accuracy
    }
    return bounded(errors) | {
        "availability": summary.availability.value - needs.min_availability,
        "false attitudes": -summary.false.value,
    }


def measured_score(one: Evaluation) -> float:
    """The score of an evaluation by its trials alone."""
    return _log_arcsec(one.error) + PENALTY * missed(one.margins) if one.summary else one.score


def missed(margins: dict[str, float]) -> float:
    """The sum of the amounts by which margins are missed."""
    return sum(max(0.0, -margin) for margin in margins.values())
