"""Campaign, TrialRunner -> the best design that was found, judged by fresh trials."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, NamedTuple

import numpy as np

from startrack import design
from startrack.core import Advance, Refused, Rows, Unit, printed
from startrack.design import Campaign
from startrack.metrics import Interval, Summary, summarise
from startrack.optimise import steps
from startrack.optimise.evaluate import PENALTY, Evaluation, evaluate, missed
from startrack.optimise.explorer import Explorer
from startrack.optimise.forecast import name_by_condition
from startrack.optimise.landscape import Landscape
from startrack.optimise.population import FIRST_ROUND, FreshTrials, population_of
from startrack.optimise.runner import TrialRunner
from startrack.optimise.source import TrackerSource
from startrack.optimise.steps import SearchStage
from startrack.optimise.units import ComparedUnits, compare_units
from startrack.trial import OUTCOMES
from startrack.verification import margins as margins_of


@printed
@dataclass(frozen=True)
class Candidate:
    """The best design of a search, if it is not better than the start on fresh trials.

    design   the design
    factor   error of the start over the error of this design, or ratio of costs
    margins  of the requirements, as for `Optimum`
    """

    design: design.Case
    factor: Interval
    margins: dict[str, float]


@printed
@dataclass(frozen=True)
class Optimum:
    """Result of an optimisation.

    If no design is better than the start, `best` is the start, the factor is 1, and the design that
    the search found is `candidate`.

    space         design space of the best; with choices, that of the winning branch
    branch        label of the winning branch, or empty
    start, best   designs
    evaluations   all, in order
    fresh         summaries of start and best on frames that no tuning used
    factor        error of the start over the error of the best, on these trials; if the campaign
                  minimises a cost, the ratio of the costs
    tuning_error  radian, error of the best on the trials that tuned it
    optimism      error of the best on fresh frames over that on the tuning trials
    availability  of the best on fresh trials, with bounds at 95 % confidence
    margins       margins of the best; for errors and availability, of the bounds that must hold
    errors        radian, the objective of the best by fresh trials in each condition
    rounds        of fresh trials, until a design met all limits or the search ended
    ending        one sentence: why the search stopped
    trials        number of trials per fidelity, including trials before an interruption
    units         start and best over fresh units; None: they are judged as designed
    landscape     ranges and prices by forecasts; None if no design is possible
    candidate     the design that the search found; None if the best is better than the start
    """

    space: design.DesignSpace
    branch: str
    start: design.Case
    best: design.Case
    evaluations: tuple[Evaluation, ...]
    fresh: tuple[Summary, Summary]
    factor: Interval
    tuning_error: Annotated[float, Unit("rad", "arcsec")]
    optimism: Interval
    availability: Interval
    margins: dict[str, float]
    errors: dict[str, float]
    rounds: int
    ending: str
    trials: dict[str, int]
    units: ComparedUnits | None = None
    landscape: Landscape | None = None
    candidate: Candidate | None = None

    @property
    def feasible(self) -> bool:
        """Whether the best met every requirement, also on fresh frames."""
        return all(margin >= 0 for margin in self.margins.values())

    @property
    def lacking(self) -> dict[str, float]:
        """The margins that are not met, the worst first."""
        return lacking(self.margins)


def lacking(margins: Mapping[str, float]) -> dict[str, float]:
    """The margins that are not met, the worst first."""
    short = {name: margin for name, margin in margins.items() if not margin >= 0}
    return dict(sorted(short.items(), key=lambda pair: pair[1]))


# Fractions of the time after which forecasts, and trials, of a search end; for `nanosatellite`.
FORECAST_PART, TRIED_PART = 0.7, 0.75
FRESH_SETS = 3  # of fresh trials: of the start, of the best, and of the best at rest


class _Progress:
    """The stages of an optimisation, as they are reported."""

    def __init__(self, campaign: Campaign, watch: Callable[[SearchStage], None] | None) -> None:
        self._campaign, self._watch, self._best = campaign, watch, math.nan
        self._tried, self._fresh = 0, 0

    def forecast(self, explorers: Mapping[str, Explorer]) -> None:
        """Report that designs were forecast."""
        count = sum(len(explorer.points) for explorer in explorers.values())
        usual = sum(
            steps.USUAL_FORECASTS * len(explorer.source.names) for explorer in explorers.values()
        )
        score = min(explorer.score for explorer in explorers.values())
        if math.isfinite(score):
            self._best = math.exp(score)
        if not self._tried:
            self._tell(f"{count} forecasts", FORECAST_PART * min(count / usual, 1.0))

    def tried(self) -> None:
        """Report that a design was tried."""
        self._tried += 1
        part = min(self._tried / self._campaign.evaluations, 1.0)
        self._tell(
            f"{self._tried} designs tried", FORECAST_PART + (TRIED_PART - FORECAST_PART) * part
        )

    def fresh(self, trials: int) -> None:
        """Report that more fresh trials were done."""
        self._fresh, campaign = self._fresh + trials, self._campaign
        trials_of_units = campaign.fresh_units * campaign.trials_per_unit
        over = trials_of_units if campaign.units else campaign.fresh_trials
        part = min(self._fresh / over / FRESH_SETS, 1.0)
        self._tell(f"{self._fresh} fresh trials", TRIED_PART + (1 - TRIED_PART) * part)

    def _tell(self, name: str, part: float) -> None:
        if self._watch:
            self._watch(SearchStage(name, part, self._best, self._campaign.made_small[1]))


def optimize(
    case: design.Case,
    campaign: Campaign,
    runner: TrialRunner,
    watch: steps.Watch | None = None,
    watch_stage: Callable[[SearchStage], None] | None = None,
    adapt: Callable[[design.Case], design.Case] | None = None,
) -> Optimum:
    """Forecast designs where they are most informative, then run trials where they decide.

    The search computes the analytic budget of some designs over the space, and then of designs that
    may be the best. It fits emulators of the objective and of all margins to these (`Explorer`),
    until it expects no gain above the campaign's precision. Trials of the best designs correct the
    budget (`refine`). With choices, it forecasts all branches; trials of the best designs of close
    branches decide. The winner is judged on frames that no tuning used, its availability by a bound
    with 95 % confidence; over units, on units that no tuning used, in the campaign's fidelity.
    If the winner misses a limit, these trials correct the forecasts of its margins. The search then
    tries another design, judged on other frames, in at most ROUNDS rounds.

    watch        called with each evaluation
    watch_stage  called with the stage that the search has reached
    adapt        as in DesignSpace; it refuses a design by `Refused`
    Raises       ValueError if the campaign names no variables.
    Accuracy     model: that of the budget, where trials are too few to correct it.
    """
    spaces = {
        branch.label: design.DesignSpace(branch.case, campaign.variables, campaign.links, adapt)
        for branch in design.branches(case, campaign.choices)
    }
    tried, progress = list[Evaluation](), _Progress(campaign, watch_stage)

    def record(done: Evaluation) -> None:
        tried.append(done)
        progress.tried()
        if watch:
            watch(done)

    label, explorer = _search(spaces, campaign, runner, tried, record, progress)
    space = spaces[label]
    judge = _Judge(space, campaign, runner, progress.fresh)
    landscape, rounds, ending = None, 1, NO_DESIGN
    if explorer is None:
        confirmed = judge.confirm(tried[-1], FIRST_ROUND)
    else:
        confirmed, ending, rounds = _rounds(
            explorer, space, campaign, runner, record, judge, len(tried)
        )
        landscape = explorer.landscape(np.array(confirmed.design.coordinates))
    judged, needs = campaign.judged(case), campaign.requirements
    frames = _fresh_frames(judged, campaign, runner, confirmed.fresh, progress.fresh)
    winner = space.design(np.array(confirmed.design.coordinates))
    gain = _gain(case, frames, winner, confirmed, campaign, runner)
    start, best = (
        summarise(outcomes[design.NOMINAL], needs.limits) for outcomes in (frames, confirmed.frames)
    )
    found = Optimum(
        space=space,
        branch=label,
        start=case,
        best=winner,
        evaluations=tuple(tried),
        fresh=(start, best),
        factor=gain.factor,
        tuning_error=confirmed.design.error,
        optimism=gain.optimism,
        availability=confirmed.availability,
        margins=confirmed.margins,
        errors=confirmed.errors,
        rounds=rounds,
        ending=ending,
        trials={fidelity.value: count for fidelity, count in runner.tried.items()},
        units=gain.units,
        landscape=landscape,
    )
    if found.feasible and not found.factor.value < 1:
        return found
    shown = _shown(judged, campaign, runner, frames, confirmed.fresh, progress.fresh)
    return _better(found, margins_of(needs, case) | shown.margins, shown)


class _Gain(NamedTuple):
    """`factor`, `optimism` and `units` of an `Optimum`."""

    factor: Interval
    optimism: Interval
    units: ComparedUnits | None


def _gain(
    case: design.Case,
    frames: Mapping[str, Rows],
    winner: design.Case,
    confirmed: _Confirmed,
    campaign: Campaign,
    runner: TrialRunner,
) -> _Gain:
    """Compare the start with the best, and the best with the trials that tuned it.

    frames     outcomes of the start, by condition, on the frames of `confirmed`
    winner     the design that was confirmed
    """
    began, counted = (
        [condition for condition in campaign.judged(judged) if condition.weight]
        for judged in (case, winner)
    )
    best, tuning = confirmed.design, confirmed.frames
    if best.trials:
        tuning = {
            condition.name: population_of(condition).first_trials(
                best.trials, campaign.fidelity, runner
            )
            for condition in counted
        }
    start, end = (began, list(frames.values())), (counted, list(confirmed.frames.values()))
    units = compare_units(campaign, start, end, best.error, runner)
    if units:
        factor, optimism = units.factor, units.optimism
    else:
        objective, weights = campaign.goal, [condition.weight for condition in counted]
        before, after, tuned = (
            [objective.squares(outcomes) for outcomes in by_condition.values()]
            for by_condition in (frames, confirmed.frames, tuning)
        )
        factor = objective.ratio(before, after, weights)
        optimism = objective.ratio(after, tuned, weights, paired=False)
    costs = campaign.cost(case), campaign.cost(winner)
    if costs[0] and costs[1]:
        factor = Interval(*[costs[0] / costs[1]] * 3)
    return _Gain(factor, optimism, units)


def _better(found: Optimum, margins: dict[str, float], shown: _Shown) -> Optimum:
    """Result of a search, or the start where that is better on fresh trials.

    A design that meets all requirements is better than one that does not. Of two that meet them,
    the one with the smaller error is better. Of two that do not, the one with the smaller score of
    the search is better.

    margins, shown  of the start
    """
    met = not lacking(margins)
    ahead = math.log(found.factor.value) if found.factor.value > 0 else math.nan
    if math.isnan(ahead) and math.isfinite(found.fresh[0].across.value):
        ahead = -math.inf  # the start alone has an attitude
    ahead += PENALTY * (missed(margins) - missed(found.margins))
    if not met and (found.feasible or not ahead <= 0):
        return found
    unknown = Interval(math.nan, math.nan, math.nan)
    return replace(
        found,
        branch="",
        best=found.start,
        fresh=(found.fresh[0], found.fresh[0]),
        factor=Interval(1.0, 1.0, 1.0),
        tuning_error=math.nan,
        optimism=unknown,
        availability=shown.availability,
        margins=margins,
        errors=shown.errors,
        units=None,
        landscape=None,
        candidate=Candidate(found.best, found.factor, found.margins),
    )


NO_DESIGN = "no design in the design space meets the requirements that need no trials"


def _search(
    spaces: Mapping[str, design.DesignSpace],
    campaign: Campaign,
    runner: TrialRunner,
    tried: Sequence[Evaluation],
    record: steps.Watch,
    progress: _Progress,
) -> tuple[str, Explorer | None]:
    """Forecasts of all branches, then trials of the best designs of the close branches.

    tried, record  the evaluations so far, and the function that adds one
    Returns  the branch of the best designs, and its forecasts; None if no design meets the
             requirements that need no trials: then the nearest design was tried
    """
    nearest = {
        label: steps.feasible_start(space, campaign.requirements) for label, space in spaces.items()
    }
    starts = {label: start.coordinates for label, start in nearest.items() if start.short == 0}
    if not starts:
        label = min(nearest, key=lambda label: nearest[label].short)
        record(evaluate(spaces[label], campaign, nearest[label].coordinates, runner))
        return label, None
    explorers = {
        label: Explorer(TrackerSource(spaces[label], campaign, runner), label) for label in starts
    }
    for label, explorer in explorers.items():
        explorer.watch = partial(progress.forecast, explorers)
        explorer.limits = steps.limits_of(spaces[label].case, campaign)
    left = steps.explore(explorers, starts, campaign)
    try_designs = {
        label: steps.trials_of_tracker(explorer, spaces[label], campaign, runner)
        for label, explorer in left.items()
    }
    label = steps.best_branch(left, try_designs, campaign.most_trials, record)
    return label, left[label]


def _rounds(
    explorer: Explorer,
    space: design.DesignSpace,
    campaign: Campaign,
    runner: TrialRunner,
    record: steps.Watch,
    judge: _Judge,
    count: int,
) -> tuple[_Confirmed, str, int]:
    """Search, and judge the best design on fresh trials, until one meets all limits there.

    The fresh trials of a round correct the forecasts of the next round, which has other fresh
    trials. Another round may also follow a design that meets all limits: if evaluations are left,
    and the corrected forecasts predict that another design is better by more than the precision.

    count    number of evaluations so far
    Returns  results of the best design that meets all limits, or of the one that misses them least;
             why the last search ended; number of rounds
    """
    tried, shown, results, ending = (
        list[Evaluation](),
        list[steps.FreshMargins](),
        list[_Confirmed](),
        "",
    )
    most = campaign.evaluations - count
    try_design = steps.trials_of_tracker(explorer, space, campaign, runner)
    for number in range(steps.ROUNDS):
        left = max(most - len(tried), 1 + steps.FINALISTS if number else 1)
        before = {design.point for design in shown}
        tried, ending = steps.refine(
            explorer, left, campaign.most_trials, try_design, record, tried, shown
        )
        new = next((design for design in tried if design.coordinates not in before), None)
        met = [result for result in results if not lacking(result.margins)]
        if new is None or (met and not _may_be_better(explorer, tried, met, new.coordinates)):
            break
        results.append(judge.confirm(new, FreshTrials.of_round(number, campaign)))
        shown.append(steps.FreshMargins(new.coordinates, results[-1].found))
        explorer.correct_limits(steps.evidence_of(explorer, tried, shown))
        steps.resume(explorer)
        met = [result for result in results if not lacking(result.margins)]
        used_up = len(tried) + 1 + steps.FINALISTS > most
        if met and (used_up or not _may_be_better(explorer, tried, met, tuple(explorer.best))):
            break
    met = [result for result in results if not lacking(result.margins)]
    if met:
        score = steps.corrected_score(explorer, tried)
        best = min(met, key=lambda result: score(result.design.coordinates))
    else:
        best = min(results, key=lambda result: result.score)
    return best, ending, len(results)


def _may_be_better(
    explorer: Explorer,
    tried: Sequence[Evaluation],
    met: Sequence[_Confirmed],
    point: tuple[float, ...],
) -> bool:
    """Whether a design may meet all limits with a smaller error than all confirmed designs."""
    score = steps.corrected_score(explorer, tried)
    least = min(score(result.design.coordinates) for result in met)
    return explorer.met(np.array(point)) and score(point) < least - explorer.source.precision


@dataclass(frozen=True)
class _Shown:
    """Results of fresh trials of a design.

    margins       of the bounds that must hold
    found         margins as they were found, and the number of trials, by name
    errors        radian, the objective in each condition
    availability  in its own condition
    """

    margins: dict[str, float]
    found: dict[str, tuple[float, int]]
    errors: dict[str, float]
    availability: Interval


@dataclass(frozen=True)
class _Confirmed:
    """A design that was judged on fresh trials.

    frames   outcomes on fresh frames in each condition that has a weight
    margins  all margins; those that need trials are margins of the bounds that must hold
    found    as for `_Shown`
    fresh    numbers of the trials
    """

    design: Evaluation
    frames: dict[str, Rows]
    margins: dict[str, float]
    found: dict[str, tuple[float, int]]
    errors: dict[str, float]
    availability: Interval
    fresh: FreshTrials

    @property
    def score(self) -> float:
        """Score as in a search, by the margins of the fresh trials."""
        error = self.design.error if self.design.error > 0 else math.inf
        cost = self.design.cost
        return math.log(cost if math.isfinite(cost) else error) + PENALTY * missed(self.margins)


@dataclass(frozen=True)
class _Judge:
    """Fresh trials of designs of a space."""

    space: design.DesignSpace
    campaign: Campaign
    runner: TrialRunner
    watch: Advance | None

    def confirm(self, best: Evaluation, fresh: FreshTrials) -> _Confirmed:
        """Results of a design's fresh trials in a round."""
        judged = self.campaign.judged(self.space.design(np.array(best.coordinates)))
        frames = _fresh_frames(judged, self.campaign, self.runner, fresh, self.watch)
        shown = _shown(judged, self.campaign, self.runner, frames, fresh, self.watch)
        margins = best.margins | shown.margins
        return _Confirmed(
            design=best,
            frames=frames,
            margins=margins,
            found=shown.found,
            errors=shown.errors,
            availability=shown.availability,
            fresh=fresh,
        )


def _shown(
    judged: Sequence[design.Judged],
    campaign: Campaign,
    runner: TrialRunner,
    frames: Mapping[str, Rows],
    fresh: FreshTrials,
    watch: Advance | None,
) -> _Shown:
    """Results of fresh trials of a design in all its conditions."""
    shown = _Shown({}, {}, {}, Interval(math.nan, 0.0, 1.0))
    objective = campaign.goal
    for condition in judged:
        outcomes = frames.get(condition.name)
        if outcomes is None:
            outcomes = _fresh(condition, campaign, runner, campaign.fidelity, fresh, watch)
        confirmed = steps.confirm_requirements(condition, campaign, runner, outcomes, fresh)
        summary = summarise(outcomes, condition.needs.limits)
        margins = {name: result.margin for name, result in confirmed.items()}
        found = {name: (result.found, result.trials) for name, result in confirmed.items()}
        if not confirmed:
            margins = {"availability": -condition.needs.min_availability}
        elif condition.name == design.NOMINAL:
            shown = replace(shown, availability=confirmed["availability"].bounds)
        margins |= {"false attitudes": -summary.false.value}
        shown.margins.update(name_by_condition(condition.name, margins))
        shown.found.update(name_by_condition(condition.name, found))
        shown.errors[condition.name] = float(objective.of(objective.squares(outcomes)))
    return shown


def _fresh_frames(
    judged: Sequence[design.Judged],
    campaign: Campaign,
    runner: TrialRunner,
    fresh: FreshTrials,
    watch: Advance | None,
) -> dict[str, Rows]:
    """Outcomes on frames that no tuning used, in each condition that has a weight."""
    frame = design.Fidelity.FRAME
    weighted = (condition for condition in judged if condition.weight)
    return {
        condition.name: _fresh(condition, campaign, runner, frame, fresh, watch)
        for condition in weighted
    }


def _fresh(
    judged: design.Judged,
    campaign: Campaign,
    runner: TrialRunner,
    fidelity: design.Fidelity,
    fresh: FreshTrials,
    watch: Advance | None,
) -> Rows:
    """Outcomes of trials that no tuning used, none where the design cannot be built."""
    try:
        return population_of(judged).fresh(campaign, runner, fidelity, fresh, watch=watch)
    except Refused:
        return np.empty(0, OUTCOMES)
