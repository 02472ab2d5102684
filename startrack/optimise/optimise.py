"""Campaign, TrialRunner -> the best design that was found, and how good it is."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

import numpy as np

from startrack import design
from startrack.core import Advance, Refused, Rows, Unit, printed
from startrack.design import Campaign
from startrack.metrics import Interval, Summary, summarise
from startrack.optimise import steps
from startrack.optimise.evaluate import PENALTY, Evaluation, evaluate, missed, try_out
from startrack.optimise.explore import Explorer, Landscape, landscape_of
from startrack.optimise.forecast import named
from startrack.optimise.runner import FRESH, TrialRunner
from startrack.optimise.steps import Stage
from startrack.optimise.units import ComparedUnits, compare_units, fresh_units
from startrack.trial import OUTCOMES
from startrack.verification import margins as margins_of

# Designs at most that are judged on fresh frames, until one meets the requirements there. Chosen by
# hand: each costs the fresh trials of the campaign.
FINALISTS = 4


@printed
@dataclass(frozen=True)
class Candidate:
    """The best design of a search that is no better than the start, on fresh trials.

    design   it
    factor   error of the start over its error
    margins  of the requirements, as of `Optimum`
    """

    design: design.Case
    factor: Interval
    margins: dict[str, float]


@printed
@dataclass(frozen=True)
class Optimum:
    """How an optimisation ended.

    Where no design is better than the start, the start stays: it is `best`, the factor is 1, and
    the design that the search found is `candidate`.

    space         design space of the best; of the winning branch where there were choices
    branch        label of the winning branch, or empty
    start, best   designs
    evaluations   all, in order
    fresh         summaries of start and best on frames that no tuning used
    factor        error of the start over that of the best, on these trials
    tuning_error  radian, error of the best on the trials that tuned it
    optimism      error of the best on fresh frames over that on the tuning trials
    availability  of the best on fresh trials, with bounds at 95 % confidence
    margins       of the best; those of errors and availability are of the bounds that must hold
    ending        one sentence: why the search stopped
    trials        number that were done, per fidelity, before an interruption too
    units         start and best over fresh units; None: they are judged as designed
    landscape     what forecasts say of the space; None where no design is possible
    candidate     None where the best is better than the start
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
    ending: str
    trials: dict[str, int]
    units: ComparedUnits | None = None
    landscape: Landscape | None = None
    candidate: Candidate | None = None

    @property
    def feasible(self) -> bool:
        """Whether the best met every requirement, on fresh frames too."""
        return all(margin >= 0 for margin in self.margins.values())

    @property
    def lacking(self) -> dict[str, float]:
        """The margins that are not met, the least violated first."""
        return lacking(self.margins)


def lacking(margins: Mapping[str, float]) -> dict[str, float]:
    """The margins that are not met, the least violated first."""
    short = {name: margin for name, margin in margins.items() if not margin >= 0}
    return dict(sorted(short.items(), key=lambda pair: -pair[1]))


# Of the time, until forecasts and until trials of the search have ended: on the nanosatellite.
FORECAST, TRIED = 0.7, 0.75
FRESH_SETS = 3  # of fresh trials: of the start, of the best, and of the best at rest


class _Progress:
    """The stages of an optimisation, as they are reported."""

    def __init__(self, campaign: Campaign, watch: Callable[[Stage], None] | None) -> None:
        self._campaign, self._watch, self._best = campaign, watch, math.nan
        self._tried, self._fresh = 0, 0

    def forecast(self, explorers: Mapping[str, Explorer]) -> None:
        """Report that designs were forecast."""
        count = sum(len(explorer.points) for explorer in explorers.values())
        usual = sum(steps.USUAL * len(explorer.space) for explorer in explorers.values())
        score = min(explorer.score for explorer in explorers.values())
        if math.isfinite(score):
            self._best = math.exp(score)
        if not self._tried:
            self._tell(f"{count} forecasts", FORECAST * min(count / usual, 1.0))

    def tried(self) -> None:
        """Report that a design was tried."""
        self._tried += 1
        part = min(self._tried / self._campaign.evaluations, 1.0)
        self._tell(f"{self._tried} designs tried", FORECAST + (TRIED - FORECAST) * part)

    def fresh(self, trials: int) -> None:
        """Report that so many more fresh trials were done."""
        self._fresh, campaign = self._fresh + trials, self._campaign
        trials_of_units = campaign.fresh_units * campaign.trials_per_unit
        over = trials_of_units if campaign.units else campaign.fresh_trials
        part = min(self._fresh / over / FRESH_SETS, 1.0)
        self._tell(f"{self._fresh} fresh trials", TRIED + (1 - TRIED) * part)

    def _tell(self, name: str, part: float) -> None:
        if self._watch:
            self._watch(Stage(name, part, self._best))


def optimize(
    case: design.Case, campaign: Campaign, runner: TrialRunner, watch: steps.Watch | None = None,
    watch_stage: Callable[[Stage], None] | None = None,
    adapt: Callable[[design.Case], design.Case] | None = None,
) -> Optimum:  # fmt: skip
    """Forecast designs where they tell most, then run trials where they decide.

    The analytic budget of some designs over the space, and then of those that may be the best,
    makes emulators of the objective and of all margins (`Explorer`), until no gain above the
    campaign's precision is expected. Trials of the best designs correct the budget (`refine`).
    Where there are choices, all branches are forecast, and trials of the best designs of those that
    are close decide. The winner is judged on frames that no tuning used, its availability by a
    bound with 95 % confidence; over units, on units that no tuning used, in the campaign's
    fidelity.

    watch        called with each evaluation
    watch_stage  called with how far it has come
    adapt        as in DesignSpace; it refuses a design by `Refused`
    Raises       ValueError where the campaign names no variables.
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

    label, finalists, ending, landscape = _search(spaces, campaign, runner, tried, record, progress)
    space = spaces[label]
    first = _fresh_frames(campaign.judged(case), campaign, runner, progress.fresh)
    likely = finalists[:FINALISTS]
    best, second, margins, availability = _verify(space, likely, campaign, runner, progress.fresh)
    objective, needs = design.Objective.read(campaign.objective), campaign.requirements
    winner = space.design(np.array(best.coordinates))
    counted = [condition for condition in campaign.judged(winner) if condition.weight]
    weights = [condition.weight for condition in counted]
    tuning = second
    if best.trials:
        tuning = {
            condition.name: try_out(condition, best.trials, campaign.fidelity, runner)
            for condition in counted
        }
    began = [condition for condition in campaign.judged(case) if condition.weight]
    start, end = (began, list(first.values())), (counted, list(second.values()))
    units = compare_units(campaign, start, end, best.error, runner)
    before, after, tuned = (
        [objective.squares(rows) for rows in trials.values()] for trials in (first, second, tuning)
    )
    if units:
        factor, optimism = units.factor, units.optimism
    else:
        factor = objective.ratio(before, after, weights)
        optimism = objective.ratio(after, tuned, weights, paired=False)
    fresh = [summarise(trials[design.NOMINAL], needs.limits) for trials in (first, second)]
    found = Optimum(
        space=space,
        branch=label,
        start=case,
        best=winner,
        evaluations=tuple(tried),
        fresh=(fresh[0], fresh[1]),
        factor=factor,
        tuning_error=best.error,
        optimism=optimism,
        availability=availability,
        margins=best.margins | margins,
        ending=ending,
        trials={fidelity.value: count for fidelity, count in runner.tried.items()},
        units=units,
        landscape=landscape,
    )
    if found.feasible and not found.factor.value < 1:
        return found
    shown, availability = _shown(campaign.judged(case), campaign, runner, first, progress.fresh)
    return _better(found, margins_of(needs, case) | shown, availability)


def _better(found: Optimum, margins: dict[str, float], availability: Interval) -> Optimum:
    """What a search found, or the start where that is better on fresh trials.

    A design that meets all requirements is better than one that does not; of two that do, the one
    of the smaller error; of two that do not, the one of the smaller score of the search.

    margins, availability  of the start
    """
    met = not lacking(margins)
    ahead = math.log(found.factor.value) if found.factor.value > 0 else math.nan
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
        availability=availability,
        margins=margins,
        units=None,
        landscape=None,
        candidate=Candidate(found.best, found.factor, found.margins),
    )


def _search(
    spaces: Mapping[str, design.DesignSpace], campaign: Campaign, runner: TrialRunner,
    tried: Sequence[Evaluation], record: steps.Watch, progress: _Progress,
) -> tuple[str, Sequence[Evaluation], str, Landscape | None]:  # fmt: skip
    """Forecasts of all branches, then trials of the best designs; of the nearest one if none fits.

    tried, record  the evaluations so far, and what adds one
    Returns  the branch of the best designs, these, why the search ended, and what forecasts say
    """
    nearest = {
        label: steps.feasible_start(space, campaign.requirements) for label, space in spaces.items()
    }
    starts = {label: start.coordinates for label, start in nearest.items() if start.short == 0}
    if not starts:
        label = min(nearest, key=lambda label: nearest[label].short)
        record(evaluate(spaces[label], campaign, nearest[label].coordinates, runner))
        ending = "no design in the design space meets the requirements that need no trials"
        return label, tried, ending, None
    explorers = {label: Explorer(spaces[label], campaign, runner, label) for label in starts}
    for explorer in explorers.values():
        explorer.watch = partial(progress.forecast, explorers)
    left = steps.explore(explorers, starts, campaign)
    label = steps.best_branch(left, campaign, runner, record)
    rest = replace(campaign, evaluations=max(1, campaign.evaluations - len(tried)))
    finalists, ending = steps.refine(left[label], rest, runner, record)
    landscape = landscape_of(left[label], np.array(finalists[0].coordinates))
    return label, finalists, ending, landscape


Confirmed = tuple[Evaluation, dict[str, Rows], dict[str, float], Interval]


def _verify(
    space: design.DesignSpace, finalists: Sequence[Evaluation], campaign: Campaign,
    runner: TrialRunner, watch: Advance | None,
) -> Confirmed:  # fmt: skip
    """The first finalist that meets the requirements on fresh trials, else the first.

    Returns  it; its outcomes on fresh frames in each condition that has a weight; what these show:
             margins, and the availability in its own condition
    """
    results = list[Confirmed]()
    for finalist in finalists:
        judged = campaign.judged(space.design(np.array(finalist.coordinates)))
        fresh = _fresh_frames(judged, campaign, runner, watch)
        shown, availability = _shown(judged, campaign, runner, fresh, watch)
        results.append((finalist, fresh, shown, availability))
        margins = finalist.margins | shown
        if finalist.summary and all(margin >= 0 for margin in margins.values()):
            return results[-1]
    return results[0]


def _shown(
    judged: Sequence[design.Judged], campaign: Campaign, runner: TrialRunner,
    fresh: Mapping[str, Rows], watch: Advance | None,
) -> tuple[dict[str, float], Interval]:  # fmt: skip
    """The margins that need trials, from fresh ones, of the bound that must hold; availability."""
    margins, fraction = dict[str, float](), Interval(math.nan, 0.0, 1.0)
    for condition in judged:
        outcomes = fresh.get(condition.name)
        if outcomes is None:
            outcomes = _fresh(condition, campaign, runner, campaign.fidelity, watch)
        confirmed = steps.confirm_requirements(condition, campaign, runner, outcomes)
        summary = summarise(outcomes, condition.needs.limits)
        shown = {name: result.margin for name, result in confirmed.items()}
        if not confirmed:
            shown = {"availability": -condition.needs.min_availability}
        elif condition.name == design.NOMINAL:
            fraction = confirmed["availability"].bounds
        margins |= named(condition.name, shown | {"false attitudes": -summary.false.value})
    return margins, fraction


def _fresh_frames(
    judged: Sequence[design.Judged], campaign: Campaign, runner: TrialRunner, watch: Advance | None
) -> dict[str, Rows]:
    """Outcomes on frames that no tuning used, in each condition that has a weight."""
    frame = design.Fidelity.FRAME
    weighted = (condition for condition in judged if condition.weight)
    return {
        condition.name: _fresh(condition, campaign, runner, frame, watch) for condition in weighted
    }


def _fresh(
    judged: design.Judged, campaign: Campaign, runner: TrialRunner, fidelity: design.Fidelity,
    watch: Advance | None,
) -> Rows:  # fmt: skip
    """Outcomes of trials that no tuning used, none where the design cannot be built."""
    try:
        if judged.units is not None:
            return fresh_units(judged, campaign, runner, watch=watch)
        return runner.run(judged.case, campaign.fresh_trials, fidelity, FRESH, watch)
    except Refused:
        return np.empty(0, OUTCOMES)
