"""Campaign, TrialRunner -> the best design that was found, and how good it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats
from startrack.design import Campaign, Case, DesignSpace, Fidelity, Objective, branches
from startrack.metrics import Interval, Summary, summarise
from startrack.optimise.evaluate import Evaluation, evaluate, measured, measured_score
from startrack.optimise.runner import FRESH, TrialRunner
from startrack.optimise.steps import Watch, availability, prospect, race, reach, refine
from startrack.trial import OUTCOMES

# Designs at most that are judged on fresh frames, until one meets the requirements there. Chosen by
# hand: each costs the fresh trials of the campaign.
FINALISTS = 4


@dataclass(frozen=True)
class Optimum:
    """How an optimisation ended.

    space         design space of the best; of the winning branch where there were choices
    branch        label of the winning branch, or empty
    start, best   designs
    evaluations   all, in order
    fresh         summaries of start and best on frames that no tuning used
    factor        error of the start over that of the best, on these trials
    tuning_error  radian, error of the best on the trials that tuned it
    optimism      error of the best on fresh frames over that on the tuning trials
    availability  of the best on fresh trials, with bounds at 95 % confidence
    margins       of the best; that of the availability is the lower bound's
    ending        one sentence: why the search stopped
    trials        number that were done, per fidelity
    """

    space: DesignSpace
    branch: str
    start: Case
    best: Case
    evaluations: tuple[Evaluation, ...]
    fresh: tuple[Summary, Summary]
    factor: Interval
    tuning_error: float
    optimism: Interval
    availability: Interval
    margins: dict[str, float]
    ending: str
    trials: dict[str, int]

    @property
    def feasible(self) -> bool:
        """Whether the best met every requirement, on fresh frames too."""
        return all(margin >= 0 for margin in self.margins.values())

    @property
    def lacking(self) -> dict[str, float]:
        """The margins that are not met, the least violated first."""
        short = {name: margin for name, margin in self.margins.items() if not margin >= 0}
        return dict(sorted(short.items(), key=lambda one: -one[1]))


def optimize(
    case: Case,
    campaign: Campaign,
    runner: TrialRunner,
    watch: Watch | None = None,
    watch_fresh: Callable[[int], None] | None = None,
    adapt: Callable[[Case], Case] | None = None,
) -> Optimum:
    """Search the design space by Sbplx (Rowan 1990, in nlopt), requirements as L1 penalties.

    The search begins where the analytic budget is best, by DIRECT on the whole space, or at the
    case itself if trials show a lower error there. Designs are compared by the budget, corrected by
    trials, whose number doubles from pass to pass. Where there are choices, their branches race
    first. The winner is judged on frames that no tuning used, its availability by a bound with
    95 % confidence.

    watch        called with each evaluation
    watch_fresh  called with the number of fresh trials just done
    adapt        as in DesignSpace
    Raises       ValueError where the campaign names no variables.
    Accuracy     model: the search with trials is local; a better design may lie elsewhere.
    """
    spaces = {
        branch.label: DesignSpace(branch.case, campaign.variables, campaign.links, adapt)
        for branch in branches(case, campaign.choices)
    }
    tried = list[Evaluation]()

    def record(done: Evaluation) -> None:
        tried.append(done)
        if watch:
            watch(done)

    nearest = {label: reach(space, campaign.requirements) for label, space in spaces.items()}
    starts = {label: one.coordinates for label, one in nearest.items() if one.short == 0}
    if starts:
        possible = {label: spaces[label] for label in starts}
        for label, space in possible.items() if campaign.analytic_evaluations else ():
            starts[label] = _better(space, starts[label], campaign, runner, record)
        label, start = race(possible, starts, _left(campaign, tried), runner, record)
        finalists, ending = refine(spaces[label], start, _left(campaign, tried), runner, record)
    else:
        label = min(nearest, key=lambda label: nearest[label].short)
        record(evaluate(spaces[label], campaign, nearest[label].coordinates, runner))
        finalists, ending = (
            tried,
            "no design in the design space meets the requirements that need no trials",
        )
    space = spaces[label]
    first = _fresh(case, campaign, runner, watch_fresh)
    best, second, fraction = _verify(space, finalists[:FINALISTS], campaign, runner, watch_fresh)
    objective = Objective.read(campaign.objective)
    summary = summarise(second)
    winner = space.design(np.array(best.coordinates))
    tuning = runner.run(winner, best.trials, campaign.fidelity) if best.trials else second
    before, after = objective.squares(first), objective.squares(second)
    return Optimum(
        space,
        label,
        case,
        winner,
        tuple(tried),
        (summarise(first), summary),
        objective.ratio(before, after, runner.seed),
        best.error,
        objective.ratio(after, objective.squares(tuning), runner.seed, paired=False),
        fraction,
        best.margins | _shown(campaign, summary, fraction),
        ending,
        {fidelity.value: count for fidelity, count in runner.tried.items()},
    )


def _left(campaign: Campaign, tried: Sequence[Evaluation]) -> Campaign:
    """The campaign with the remaining evaluations; one at least."""
    return replace(campaign, evaluations=max(1, campaign.evaluations - len(tried)))


def _better(
    space: DesignSpace, start: Floats, campaign: Campaign, runner: TrialRunner, watch: Watch
) -> Floats:
    """The start, or the minimum of the analytic budget, by trials the better of both."""
    found = prospect(space, campaign, start)
    tried = [
        evaluate(space, campaign, coordinates, runner) for coordinates in (start, found.coordinates)
    ]
    for one in tried:
        watch(one)
    return np.array(min(tried, key=measured_score).coordinates)


def _verify(
    space: DesignSpace,
    finalists: Sequence[Evaluation],
    campaign: Campaign,
    runner: TrialRunner,
    watch: Callable[[int], None] | None,
) -> tuple[Evaluation, NDArray[np.void], Interval]:
    """The first finalist that meets the requirements on fresh trials, else the first.

    Returns  it, its outcomes on fresh frames, and its availability
    """
    results = list[tuple[Evaluation, NDArray[np.void], Interval]]()
    for one in finalists:
        design = space.design(np.array(one.coordinates))
        outcomes = _fresh(design, campaign, runner, watch)
        fraction = availability(design, campaign, runner, outcomes)
        results.append((one, outcomes, fraction))
        margins = one.margins | _shown(campaign, summarise(outcomes), fraction)
        if one.summary and all(margin >= 0 for margin in margins.values()):
            return results[-1]
    return results[0]


def _shown(campaign: Campaign, summary: Summary, fraction: Interval) -> dict[str, float]:
    """The margins that need trials, from fresh ones."""
    needs = campaign.requirements
    return measured(needs, summary) | {"availability": fraction.low - needs.min_availability}


def _fresh(
    case: Case, campaign: Campaign, runner: TrialRunner, watch: Callable[[int], None] | None
) -> NDArray[np.void]:
    """Outcomes on frames that no tuning used; empty where the design cannot be built."""
    try:
        return runner.run(case, campaign.fresh_trials, Fidelity.FRAME, FRESH, watch)
    except ValueError:
        return np.empty(0, OUTCOMES)
