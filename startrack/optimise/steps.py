"""The steps of the optimiser: prospect, reach, correction, refine, race, assure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats
from startrack.design import Campaign, Case, DesignSpace, Objective, Requirements
from startrack.metrics import Interval, fraction_interval
from startrack.optimise.evaluate import Evaluation, evaluate, foresee, missed
from startrack.optimise.margins import margins as margins_of
from startrack.optimise.runner import FRESH, TrialRunner
from startrack.optimise.search import Found, Search, least, least_of_all

PROSPECT_FRACTION = (
    0.6  # of the places are spread over the whole box, the rest around the best of them
)


def prospect(box: DesignSpace, campaign: Campaign, start: Floats) -> Found:
    """Look over the whole box by DIRECT, then nearer by Sbplx, without a trial.

    Accuracy  model: that of `foresee`; the place is one to begin at, never one to end with.
    """

    def score(place: Floats) -> float:
        return foresee(box, campaign, place)

    near = max(1, int((1 - PROSPECT_FRACTION) * campaign.analytic_evaluations))
    return least_of_all(score, start, ceil(PROSPECT_FRACTION * campaign.analytic_evaluations), near)


PLACES = 120  # that are asked over the whole box, and again around the best of them


class Reached(NamedTuple):
    """The place that comes nearest to the requirements.

    place    in the unit cube; the start where that meets them all
    short    1, by how much their margins are missed there; 0 where none is
    margins  there
    """

    place: Floats
    short: float
    margins: dict[str, float]


def reach(box: DesignSpace, requirements: Requirements) -> Reached:
    """Look for a design that meets mass, power and all else that needs no trials.

    Accuracy  model: a search; a corner that meets them may be missed where it is smaller than a
              part in 120 of the box.
    """

    tried = list[float]()

    def score(place: Floats) -> float:
        try:
            tried.append(missed(margins_of(requirements, box.design(place))))
        except ValueError:
            return math.nan
        return tried[-1]

    def enough() -> str:
        return "met" if 0.0 in tried else ""

    found = least_of_all(score, box.start, PLACES, PLACES, enough)
    margins = {}
    if math.isfinite(found.score):
        margins = margins_of(requirements, box.design(found.place))
    return Reached(found.place, found.score, margins)


PRIOR = 0.3  # standard deviation of ln(measured / expected), chosen by hand
PRIOR_SLOPE = 1.0  # of its slope over the cube; 0.9 was found along the blur of the example
SCATTER = 0.5  # variance of ln(measured) from one trial; 1/4 for two axes and 1/2 for one, at least


@dataclass(frozen=True, eq=False)
class Correction:
    """ln(measured error / expected error), a plane over the cube, and how well it is known.

    The error of n trials is known to 1 / sqrt(4 n) at best, which is more than what neighbouring
    designs differ by. The budget has no noise, but is wrong by a factor that changes slowly;
    all designs that were tried together show by which.

    middle      (d,) place
    terms       (d + 1,) the value there, and the slope
    covariance  (d + 1, d + 1) of these
    """

    middle: Floats
    terms: Floats
    covariance: Floats

    def __call__(self, place: Floats) -> float:
        """At a place (d,)."""
        return float(self.terms @ np.append(1.0, place - self.middle))

    def doubt(self, one: Floats, other: Floats) -> float:
        """Standard error of the difference between two places."""
        apart = np.append(0.0, one - other)
        return math.sqrt(float(apart @ self.covariance @ apart))


def correct(tried: Sequence[Evaluation], middle: Floats, reach: float) -> Correction:
    """The plane through the designs that were tried within `reach` of a place along each axis.

    Least squares, each design with the weight of its trials, with Gaussian priors on the value
    and the slopes, so that what few designs leave open stays near zero.
    """
    near = [
        one
        for one in tried
        if one.error > 0
        and one.expected > 0
        and np.abs(np.array(one.place) - middle).max() <= reach
    ]
    terms = np.array([[1.0, *(np.array(one.place) - middle)] for one in near])
    terms = terms.reshape(-1, len(middle) + 1)
    ratio = np.array([math.log(one.error / one.expected) for one in near])
    weight = np.array([one.trials / SCATTER for one in near])
    prior = np.full(len(middle) + 1, PRIOR_SLOPE)
    prior[0] = PRIOR
    normal = (terms.T * weight) @ terms + np.diag(prior**-2.0)
    covariance = np.asarray(np.linalg.inv(normal), np.float64)
    return Correction(middle, covariance @ (terms.T @ (weight * ratio)), covariance)


FIRST_STEP = 0.15  # of each range; each pass starts with half the step of the one before
NEAR = 4.0  # first steps around the start of a pass, within which the budget is corrected
PATIENCE = 3  # designs for each variable and one more, without a gain above the noise; by hand
FRACTION = 0.6  # of the evaluations left that a pass may take, unless it is the last; by hand
LEAST_GAIN = 2e-3  # of ln(error), less than which is no gain; chosen by hand

Watch = Callable[[Evaluation], None]


def refine(
    box: DesignSpace, start: Floats, campaign: Campaign, bench: TrialRunner, watch: Watch
) -> tuple[list[Evaluation], str]:
    """Search from a start with the campaign's trials, then with twice as many, to its most.

    What a pass has tried corrects the budget for the next; a design that cannot lead is not tried,
    which leaves the trials to those that can. A pass ends when the best has not
    gained for a while by more than the standard error of that correction between two places: what
    is won beyond that is the noise's.

    Returns  the evaluations of the last pass, best first, and a sentence on how it ended
    """
    left, step, ending = campaign.evaluations, FIRST_STEP, ""
    tried, before = list[Evaluation](), list[Evaluation]()
    plan = list(growth(campaign.trials, campaign.most_trials))
    for trials in plan:
        last = trials == plan[-1]
        fraction = left if last else math.ceil(FRACTION * left)
        tried = []
        correction = correct(before, start, NEAR * step)
        settled = _Settled(correction)

        def score(
            place: Floats,
            trials: int = trials,
            settled: _Settled = settled,
            tried: list[Evaluation] = tried,
            correction: Correction = correction,
        ) -> float:
            # The first designs of a pass, one a term of the plane, are always tried.
            tell = sum(one.trials > 0 for one in tried) < len(correction.terms)
            lead = math.inf if tell else min(one.score for one in tried)
            done = evaluate(box, campaign, place, bench, trials, correction, True, lead)
            tried.append(done)
            before.append(done)
            settled.see(done)
            watch(done)
            return done.score

        found = least(score, start, Search(evaluations=max(1, fraction), first_step=step), settled)
        left -= found.evaluations
        start, step, ending = found.place, step / 2, found.ending
        if left <= 0:
            break
    return sorted(tried, key=lambda one: (not one.feasible, one.score)), ending


def growth(first: int, most: int) -> Iterator[int]:
    """Trials of each pass: doubled until the most."""
    while first < most:
        yield first
        first = min(2 * first, most)
    yield most


class _Settled:
    """Whether a pass still gains more than its noise."""

    def __init__(self, correction: Correction) -> None:
        self._correction = correction
        self._anchor: Evaluation | None = None  # the best when it last gained
        self._quiet = 0

    def see(self, done: Evaluation) -> None:
        self._quiet += 1
        if self._anchor is None or self._gain(done, self._anchor):
            self._anchor, self._quiet = done, 0

    def __call__(self) -> str:
        patience = PATIENCE * len(self._correction.terms)
        return "a further gain would be within the noise" if self._quiet >= patience else ""

    def _gain(self, done: Evaluation, anchor: Evaluation) -> bool:
        doubt = self._correction.doubt(np.array(done.place), np.array(anchor.place))
        return anchor.score - done.score > max(doubt, LEAST_GAIN)


ROUND = 4  # evaluations for each variable, and once more, that a branch has in a round at most
RACE_FRACTION = (
    2 / 3
)  # of the evaluations that all rounds together may take; the rest refine the winner
SURE = 0.997  # confidence at which a branch is worse than the leader: 3 sigma


@dataclass
class _Runner:
    """A branch, its best place so far, and the step that its next search begins with."""

    label: str
    box: DesignSpace
    place: Floats
    step: float = FIRST_STEP
    best: Evaluation | None = None


def race(
    boxes: Mapping[str, DesignSpace],
    starts: Mapping[str, Floats],
    campaign: Campaign,
    bench: TrialRunner,
    watch: Watch,
) -> tuple[str, Floats]:
    """Search all branches in rounds; each round keeps the better half, and no clear loser.

    Source: successive halving, Jamieson and Talwalkar (2016), with the test of a race (Maron and
    Moore 1994), here in pairs on the same trials.

    campaign  of whose evaluations it takes two thirds at most, but one a branch in each round
    Returns   the winner and its best place; at once where there is one branch alone
    """
    field = [_Runner(label, box, starts[label]) for label, box in boxes.items()]
    runs = _runs(len(field))
    each = max(1, int(RACE_FRACTION * campaign.evaluations) // runs) if runs else 0
    while len(field) > 1:
        for runner in field:
            _run(runner, each, campaign, bench, watch)
        field.sort(key=_score)
        half = field[: math.ceil(len(field) / 2)]
        field = [
            one for one in half if one is half[0] or not _beaten(one, half[0], campaign, bench)
        ]
    return field[0].label, field[0].place


def _runs(branches: int) -> int:
    """How often branches run in all rounds of a race in which none is beaten early."""
    return branches + _runs(math.ceil(branches / 2)) if branches > 1 else 0


def _run(runner: _Runner, most: int, campaign: Campaign, bench: TrialRunner, watch: Watch) -> None:
    def score(place: Floats) -> float:
        done = evaluate(runner.box, campaign, place, bench, spare=True)
        watch(done)
        if runner.best is None or done.score < runner.best.score:
            runner.best = done
        return done.score

    evaluations = min(most, ROUND * (len(runner.box) + 1))
    search = Search(evaluations=evaluations, first_step=runner.step)
    runner.place = least(score, runner.place, search).place
    runner.step /= 2


def _score(runner: _Runner) -> float:
    return runner.best.score if runner.best else math.inf


def _beaten(one: _Runner, leader: _Runner, campaign: Campaign, bench: TrialRunner) -> bool:
    if not (one.best and leader.best and one.best.error > 0 and leader.best.error > 0):
        return False
    rms = Objective(Objective.read(campaign.objective).axes)
    mine, theirs = (
        rms.squares(bench.run(each.box.design(each.place), campaign.trials, campaign.fidelity))
        for each in (one, leader)
    )
    return rms.ratio(mine, theirs, bench.seed, confidence=SURE).low > 1


LOOKS = 4  # at 1, 2, 4 and 8 times the fresh trials
WRONG = 0.05  # probability that any of these looks finds a bound that does not hold


def availability(
    case: Case, campaign: Campaign, bench: TrialRunner, outcomes: NDArray[np.void]
) -> Interval:
    """The fraction of trials with a right attitude, known as well as the requirement asks.

    Where the interval holds the required fraction, the trials are doubled, up to three times, with
    the campaign's own fidelity, which has the distribution of frames at a tenth of their time. Each
    bound is one of Clopper and Pearson (1934) with a tail of 0.05 / 4, so that it is wrong at most
    once in twenty designs, however many looks there were (Bonferroni).

    outcomes  of the fresh frames that are there already
    Returns   the fraction of all that were tried, and its bounds
    """
    tried, hits = len(outcomes), _right(outcomes)
    asked = campaign.requirements.min_availability
    first = FRESH + tried  # the same numbers would be the same skies
    for look in range(LOOKS):
        fraction = fraction_interval(hits, tried, 1 - 2 * WRONG / LOOKS)
        if not tried or not fraction.low < asked <= fraction.high or look == LOOKS - 1:
            break
        more = bench.run(case, tried, campaign.fidelity, first)
        first, tried, hits = first + tried, 2 * tried, hits + _right(more)
    return fraction


def _right(outcomes: NDArray[np.void]) -> int:
    return int((outcomes["solved"] & ~outcomes["false"]).sum())
