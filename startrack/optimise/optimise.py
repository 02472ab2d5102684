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

FINALISTS = 4  # designs that are judged on fresh frames, until one meets the requirements there


@dataclass(frozen=True)
class Optimum:
    """How an optimisation ended.

    box          that the best was found in; of the winning branch where there were choices
    branch       which, or empty
    start, best  designs
    evaluations  all that were tried, in order
    fresh        summaries of start and best on frames that neither was tuned on
    factor       error of the start over that of the best, on these trials
    tuning_error  radian, error of the best on the trials that it was tuned on
    optimism     error of the best on fresh frames over that on the tuning trials
    availability  of the best on fresh trials, with bounds that hold with 95 % confidence
    margins      of the best; that of the availability is the lower bound's
    ending       one sentence: why the search stopped
    trials       how many were done, per fidelity
    """

    box: DesignSpace
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
    bench: TrialRunner,
    watch: Watch | None = None,
    watch_fresh: Callable[[int], None] | None = None,
    adapt: Callable[[Case], Case] | None = None,
) -> Optimum:
    """Search the box with Sbplx (Rowan 1990, in nlopt), requirements as L1 penalties.

    The search begins where the analytic budget is best, by DIRECT on the whole box, or at the
    case itself if trials find that better. The budget goes on to tell designs apart, set right by
    trials; these double from pass to pass. Where there are choices, their branches race first.
    The winner is judged on frames that nothing was tuned on, its availability at a bound that
    holds with 95 % confidence.

    watch        called with each evaluation
    watch_fresh  called with the number of fresh trials just done
    adapt        as in Box
    Raises       ValueError where the campaign names no variables.
    Accuracy     model: what trials correct is searched locally; a better design may lie elsewhere.
    """
    boxes = {
        branch.label: DesignSpace(branch.case, campaign.variables, campaign.links, adapt)
        for branch in branches(case, campaign.choices)
    }
    tried = list[Evaluation]()

    def record(done: Evaluation) -> None:
        tried.append(done)
        if watch:
            watch(done)

    nearest = {label: reach(box, campaign.requirements) for label, box in boxes.items()}
    starts = {label: one.place for label, one in nearest.items() if one.short == 0}
    if starts:
        possible = {label: boxes[label] for label in starts}
        for label, box in possible.items() if campaign.analytic_evaluations else ():
            starts[label] = _better(box, starts[label], campaign, bench, record)
        label, start = race(possible, starts, _left(campaign, tried), bench, record)
        finalists, ending = refine(boxes[label], start, _left(campaign, tried), bench, record)
    else:
        label = min(nearest, key=lambda label: nearest[label].short)
        record(evaluate(boxes[label], campaign, nearest[label].place, bench))
        finalists, ending = tried, "no design of the box meets what needs no trials"
    box = boxes[label]
    first = _fresh(case, campaign, bench, watch_fresh)
    best, second, fraction = _verify(box, finalists[:FINALISTS], campaign, bench, watch_fresh)
    objective = Objective.read(campaign.objective)
    summary = summarise(second)
    winner = box.design(np.array(best.place))
    tuning = bench.run(winner, best.trials, campaign.fidelity) if best.trials else second
    before, after = objective.squares(first), objective.squares(second)
    return Optimum(
        box,
        label,
        case,
        winner,
        tuple(tried),
        (summarise(first), summary),
        objective.ratio(before, after, bench.seed),
        best.error,
        objective.ratio(after, objective.squares(tuning), bench.seed, paired=False),
        fraction,
        best.margins | _shown(campaign, summary, fraction),
        ending,
        {fidelity.value: count for fidelity, count in bench.tried.items()},
    )


def _left(campaign: Campaign, tried: Sequence[Evaluation]) -> Campaign:
    """The campaign with the evaluations that are left; one at least."""
    return replace(campaign, evaluations=max(1, campaign.evaluations - len(tried)))


def _better(
    box: DesignSpace, start: Floats, campaign: Campaign, bench: TrialRunner, watch: Watch
) -> Floats:
    """The start, or where the analytic budget is best: whichever trials find better."""
    found = prospect(box, campaign, start)
    tried = [evaluate(box, campaign, place, bench) for place in (start, found.place)]
    for one in tried:
        watch(one)
    return np.array(min(tried, key=measured_score).place)


def _verify(
    box: DesignSpace,
    finalists: Sequence[Evaluation],
    campaign: Campaign,
    bench: TrialRunner,
    watch: Callable[[int], None] | None,
) -> tuple[Evaluation, NDArray[np.void], Interval]:
    """The first finalist that is shown to meet the requirements on fresh trials, else the first.

    Returns  it, its outcomes on fresh frames, and its availability
    """
    results = list[tuple[Evaluation, NDArray[np.void], Interval]]()
    for one in finalists:
        design = box.design(np.array(one.place))
        outcomes = _fresh(design, campaign, bench, watch)
        fraction = availability(design, campaign, bench, outcomes)
        results.append((one, outcomes, fraction))
        margins = one.margins | _shown(campaign, summarise(outcomes), fraction)
        if one.summary and all(margin >= 0 for margin in margins.values()):
            return results[-1]
    return results[0]


def _shown(campaign: Campaign, summary: Summary, fraction: Interval) -> dict[str, float]:
    """The margins that take trials, of what fresh ones have shown."""
    needs = campaign.requirements
    return measured(needs, summary) | {"availability": fraction.low - needs.min_availability}


def _fresh(
    case: Case, campaign: Campaign, bench: TrialRunner, watch: Callable[[int], None] | None
) -> NDArray[np.void]:
    """Outcomes on frames that nothing was tuned on; none where the design cannot be tried."""
    try:
        return bench.run(case, campaign.fresh_trials, Fidelity.FRAME, FRESH, watch)
    except ValueError:
        return np.empty(0, OUTCOMES)
