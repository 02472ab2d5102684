"""Point of a DesignSpace -> the score of its design."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, NamedTuple

import numpy as np

from startrack.core import Advance, Floats, Refused, Rows, Unit, arcsec, printed
from startrack.design import NOMINAL, Campaign, Case, DesignSpace, Judged, Objective
from startrack.metrics import Summary, summarise
from startrack.optimise import forecast
from startrack.optimise.forecast import Forecast, forecasts, name_by_condition
from startrack.optimise.ledger import FORECAST
from startrack.optimise.population import population_of
from startrack.optimise.runner import TrialRunner
from startrack.verification import boresights, cost_margins, counted, margin, measured_over
from startrack.verification import margins as margins_of

# ln(error) per unit of a missed margin. Chosen by hand: it must exceed the slope of ln(error) along
# every margin; a larger one makes the valley along a limit narrower.
PENALTY = 10.0
# Largest amount by which mass, power and other costs may miss their limits for a budget to be
# computed. Emulators then know both sides of a limit. Chosen by hand.
MOST_EXCESS = 0.05
LOST = 20.0  # ln(arcsec) of a design without a solved trial; by hand: far above any error


@printed
@dataclass(frozen=True)
class Evaluation:
    """One design that was evaluated.

    coordinates  (d,) in the unit cube
    values       of the variables, SI
    error        radian, the objective by trials; NaN if no trial was solved
    expected     radian, the objective by the analytic budget; NaN if it expects no attitude
    score        the function that is minimised, see `evaluate`
    margins      margins of the requirements, errors and availability included; below 0: not met
    summary      summary of the trials in the design's own condition; None if no trial was run
    note         reason why no trial was run, or empty
    forecast     forecasts by the budget of the margins that trials measured
    tried        number of trials if there is no summary
    cost         SI, the cost that the campaign minimises; NaN if it minimises the error
    """

    coordinates: tuple[float, ...]
    values: dict[str, float]
    error: Annotated[float, Unit("rad", "arcsec")]
    expected: Annotated[float, Unit("rad", "arcsec")]
    score: float
    margins: dict[str, float]
    summary: Summary | None
    note: str
    forecast: Mapping[str, float] = field(default_factory=dict)
    tried: int = 0
    cost: float = math.nan

    @property
    def feasible(self) -> bool:
        """Whether every requirement is met."""
        return self.trials > 0 and all(m >= 0 for m in self.margins.values())

    @property
    def trials(self) -> int:
        """Number of trials that were run."""
        return self.summary.trials if self.summary else self.tried


def evaluate(
    space: DesignSpace,
    campaign: Campaign,
    coordinates: Floats,
    runner: TrialRunner,
    trials: int | None = None,
    correction: Callable[[Floats], float] | None = None,
    spare: bool = False,
    known: Foresight | None = None,
    close: Collection[str] = (),
) -> Evaluation:
    """Score a design by its analytic budget, corrected by trials.

        score = ln(expected / arcsec) + correction(coordinates) + PENALTY sum(max(0, -margin))

    The budget gives the differences between designs without noise. Trials give what the budget
    neglects: the correction, and how often an attitude is found. They have the same attitudes and
    random streams for every design. For several conditions, `expected` is the geometric mean by
    their weights. Conditions of weight 0 have trials only if they are named in `close`, otherwise
    the budget's margins. Over units, `expected` is the level that the required fraction of the
    units does not exceed by their budgets, with the same units for every design. Trials of these
    units give the correction: the error of all units together over its forecast by the budgets. An
    L1 penalty has the same minimum as the constrained problem if PENALTY exceeds the slope of
    ln(error) along the margin (Fletcher 1987, Practical Methods of Optimization, 14.3).

    A campaign that minimises a cost has ln(cost) in place of the first two terms. No trial corrects
    it, and errors count only by the margins of their limits.

    trials      number of trials; None: the campaign's first number
    correction  function: unit-cube coordinates -> ln(error / expected); None: zero
    spare       whether no trials are run if a requirement that needs no trials is missed
    known       forecast of the design; None: it is computed
    close       names of conditions of weight 0 that are also tried
    Returns     an evaluation; its note is the reason if a design cannot be built or rendered
    """
    coordinates = np.clip(coordinates, 0, 1)
    values = space.values(coordinates)
    objective = campaign.goal
    try:
        case = space.design(coordinates)
        judged, cost = campaign.judged(case), campaign.cost(case)
        margins = margins_of(campaign.requirements, judged[0].case)
        given = known.conditions if known else {}
        expected, foreseen = forecasts(judged, objective, runner, known=given)
        tried = {}
        if not (spare and missed(margins)):
            tried = _first_trials(judged, campaign, runner, trials or campaign.trials, close)
    except Refused as reason:
        return _worst(coordinates, values, reason)
    except Exception as fault:
        named_values = ", ".join(f"{name} = {value:g}" for name, value in values.items())
        fault.add_note(f"of the design with {named_values}")
        raise
    by_budget = dict[str, float]()
    for condition in judged if tried else ():
        there = foreseen[condition.name]
        own = there.margins
        if condition.name in tried:
            by_budget |= name_by_condition(condition.name, own)
            own = measured_margins(condition, tried[condition.name], runner.seed, there)
        margins |= name_by_condition(condition.name, own)
    error = combined(judged, tried, objective, foreseen)
    if cost is None:
        minimised = _log_arcsec(expected if expected > 0 else error)
        minimised += correction(coordinates) if correction else 0.0
    else:
        minimised = math.log(cost)
    return Evaluation(
        coordinates=tuple(coordinates),
        values=values,
        error=error,
        expected=expected,
        score=minimised + PENALTY * missed(margins),
        margins=margins,
        summary=summarise(tried[NOMINAL], campaign.requirements.limits) if tried else None,
        note="",
        forecast=by_budget,
        cost=math.nan if cost is None else cost,
    )


def _worst(coordinates: Floats, values: dict[str, float], reason: Refused) -> Evaluation:
    """The evaluation of a design that is refused: it has the worst score, the search goes on."""
    return Evaluation(
        coordinates=tuple(coordinates),
        values=values,
        error=math.nan,
        expected=math.nan,
        score=LOST + PENALTY,
        margins={},
        summary=None,
        note=str(reason),
    )


def _first_trials(
    judged: Sequence[Judged],
    campaign: Campaign,
    runner: TrialRunner,
    count: int,
    close: Collection[str],
) -> dict[str, Rows]:
    """Outcomes of trials in the conditions with a weight, and in those named in `close`."""
    return {
        condition.name: population_of(condition).first_trials(count, campaign.fidelity, runner)
        for condition in judged
        if condition.weight or condition.name in close
    }


def combined(
    judged: Sequence[Judged],
    tried: Mapping[str, Rows],
    objective: Objective,
    foreseen: Mapping[str, Forecast],
) -> float:
    """The objective (radian) over the trials of all conditions that have a weight.

    foreseen  forecast of each condition; its budgets give the ratio of the level over units to the
              error of all trials
    """
    counted = [condition for condition in judged if condition.weight and condition.name in tried]
    errors = [
        float(objective.of(objective.squares(tried[condition.name])))
        * forecast.over_units(condition, tried[condition.name], objective, foreseen[condition.name])
        for condition in counted
    ]
    weights = [condition.weight for condition in counted]
    return objective.over(errors, weights)


class Foresight(NamedTuple):
    """Expected values of a design without a trial.

    expected    ln of the minimised quantity, the objective in arcsec or a cost; NaN if no attitude
                is expected
    margins     margins of the requirements; none if the design cannot be built
    conditions  forecast of each condition that was computed, by its name
    lasting     false if the machine refused the design, for example for lack of memory; no ledger
                keeps such a forecast
    """

    expected: float
    margins: dict[str, float]
    conditions: dict[str, Forecast] = {}  # noqa: RUF012, never changed
    lasting: bool = True

    @property
    def left_out(self) -> bool:
        """Whether the costs miss their limits by so far that no budget was computed."""
        return bool(self.margins) and math.isnan(self.expected) and not self.conditions

    @property
    def reason(self) -> str:
        """Why a condition expects no attitude, or empty."""
        return next((one.reason for one in self.conditions.values() if one.reason), "")

    @property
    def score(self) -> float:
        """Score as for `evaluate`; infinite if no attitude is expected."""
        if math.isnan(self.expected):
            return math.inf
        return self.expected + PENALTY * missed(self.margins)

    def text(self) -> str:
        """The forecast as JSON."""
        return json.dumps(self[:3])

    @classmethod
    def read(cls, text: str) -> Foresight:
        """Inverse of `text`."""
        expected, margins, conditions = json.loads(text)
        return cls(expected, margins, {name: Forecast(*row) for name, row in conditions.items()})


NOTHING = Foresight(math.nan, {})  # forecast of a design that cannot be built


def foresee(space: DesignSpace, campaign: Campaign, coordinates: Floats, seed: int = 1) -> float:
    """The score of a design without a trial; infinite if it cannot be built.

    seed      seed of the units, if the design is judged over units
    Accuracy  model: that of the budget. The result of a search also needs trials, because an
              optimiser favours designs whose error the model underestimates.
    """
    return foresee_all(space, campaign, [coordinates], seed=seed)[0].score


def foresee_all(
    space: DesignSpace,
    campaign: Campaign,
    points: Sequence[Floats],
    runner: TrialRunner | None = None,
    seed: int = 1,
    enough: float = math.inf,
    most_excess: float = MOST_EXCESS,
    known: Mapping[str, Forecast] | None = None,
    progress: Advance | None = None,
) -> list[Foresight]:
    """Forecasts of several designs, each computed by a worker of a runner.

    A runner's ledger keeps them, so that none is computed again after an interruption.

    enough  score above which a design is not forecast in conditions without a weight
    most_excess  excess of costs over their limits above which a design is not forecast
    known   known forecasts of a single design in some conditions
    progress  called with the number of known designs, and then with 1 for each computed one
    """
    cases = [_built(space, coordinates) for coordinates in points]
    seed = runner.seed if runner else seed
    compute = partial(
        _foreseen,
        campaign=campaign,
        seed=seed,
        enough=enough,
        most_excess=most_excess,
        known=known or {},
    )
    if runner is None:
        return [compute(case) for case in cases]
    limits = enough, most_excess
    keys = [runner.forecast_key(case, campaign, limits) if case else b"" for case in cases]
    return _kept_in_ledger(runner, keys, cases, compute, progress)


def _kept_in_ledger(
    runner: TrialRunner,
    keys: Sequence[bytes],
    cases: Sequence[Case | None],
    compute: Callable[[Case], Foresight],
    progress: Advance | None,
) -> list[Foresight]:
    """Forecasts from the ledger of a runner; missing ones are computed and kept in it.

    keys  of the cases in the ledger; empty for a design that cannot be built
    """
    notes = {key: runner.ledger.note(FORECAST, key) for key in keys}
    built = {key: case for key, case in zip(keys, cases, strict=True) if case}
    new = {key: case for key, case in built.items() if not notes[key]}
    if progress and len(keys) > len(new):
        progress(len(keys) - len(new))
    for key in (key for key in built if key not in new):
        runner.watch(built[key], Foresight.read(notes[key]))
    for key, foresight in zip(new, runner.map(compute, new.values(), progress), strict=True):
        notes[key] = foresight.text()
        runner.watch(new[key], foresight)
        if foresight.lasting:
            runner.ledger.keep_note(FORECAST, key, notes[key])
    return [Foresight.read(notes[key]) if key else NOTHING for key in keys]


def _built(space: DesignSpace, coordinates: Floats) -> Case | None:
    """The design of a point; None if it contradicts itself."""
    try:
        return space.design(coordinates)
    except Refused:
        return None


def _foreseen(
    case: Case | None,
    campaign: Campaign,
    seed: int,
    enough: float,
    most_excess: float,
    known: Mapping[str, Forecast],
) -> Foresight:
    """Forecast of a design; NOTHING for None, and if the design contradicts itself."""
    if case is None:
        return NOTHING
    objective = campaign.goal
    try:
        costs, judged = cost_margins(campaign.requirements, case), campaign.judged(case)
        if missed(costs) > most_excess:
            return Foresight(math.nan, costs)
        margins = margins_of(campaign.requirements, case)
        weighted = [condition for condition in judged if condition.weight]
        expected, conditions = forecasts(weighted, objective, seed=seed, known=known)
        cost = campaign.cost(case)
        log = math.log(expected / arcsec if cost is None else cost) if expected > 0 else math.nan
        for last in (False, True):
            for condition in judged:
                if condition.name in conditions:
                    margins |= name_by_condition(condition.name, conditions[condition.name].margins)
            foreseen = Foresight(log, margins, conditions)
            if last or not foreseen.score <= enough:
                break
            _, conditions = forecasts(judged, objective, seed=seed, known={**known, **conditions})
    except Refused as reason:
        return NOTHING._replace(lasting=reason.lasting)
    return foreseen


def _log_arcsec(angle: float) -> float:
    return math.log(angle / arcsec) if angle > 0 else LOST


def measured_margins(
    condition: Judged, outcomes: Rows, seed: int, foreseen: Forecast | None = None
) -> dict[str, float]:
    """The margins that need trials, as measured by the trials, without their intervals.

    foreseen  forecast of the case, if it is judged over units
    """
    needs, every = condition.needs, outcomes
    outcomes = counted(condition.needs, condition.case, seed, outcomes)
    summary = summarise(outcomes, needs.limits)
    worst = needs.sky == "worst" and needs.accuracy
    boresight = boresights(seed, outcomes) if worst else np.empty((0, 3))
    errors = {
        accuracy.name: margin(
            accuracy.most,
            measured_over(accuracy.objective, outcomes, boresight, needs.sky)
            * forecast.over_units(condition, every, accuracy.objective, foreseen),
        )
        for accuracy in needs.accuracy
    }
    return forecast.bounded(errors) | {
        "availability": summary.availability.value - needs.min_availability,
        "false attitudes": -summary.false.value,
    }


def missed(margins: dict[str, float]) -> float:
    """The sum of the amounts by which margins are missed."""
    return sum(max(0.0, -margin) for margin in margins.values())
