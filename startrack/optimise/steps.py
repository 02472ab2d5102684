"""The steps of the optimiser: prospect, reach, correction, refine, race, assure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Refused
from startrack.design import Campaign, DesignSpace, Judged, Objective, Requirements
from startrack.metrics import Interval
from startrack.optimise.evaluate import (
    Evaluation,
    evaluate,
    foresee,
    foresee_all,
    missed,
    try_out,
)
from startrack.optimise.runner import FRESH, TrialRunner
from startrack.optimise.search import Found, Search, Together, least, least_of_all
from startrack.optimise.units import errors_of, fresh_units
from startrack.verification import Answer, Looks, YieldClaim, boresights, claims_of, counted
from startrack.verification import margins as margins_of

# Of the evaluations of `prospect` that DIRECT has over the whole space; the rest refine its best.
# Chosen by hand: more find other basins, fewer leave more for the best one.
PROSPECT_FRACTION = 0.6


def prospect(
    space: DesignSpace, campaign: Campaign, start: Floats, runner: TrialRunner | None = None
) -> Found:
    """Search the whole space by DIRECT, then locally by Sbplx, without trials.

    runner    whose workers compute the budgets, with the same result; None: this process
    Accuracy  model: that of `foresee`; the result is a start for a search with trials.
    """

    def score(coordinates: Floats) -> float:
        return foresee(space, campaign, coordinates, runner.seed if runner else 1)

    def scores(points: list[Floats]) -> list[float]:
        return foresee_all(space, campaign, points, runner)

    near = max(1, int((1 - PROSPECT_FRACTION) * campaign.analytic_evaluations))
    far = ceil(PROSPECT_FRACTION * campaign.analytic_evaluations)
    together = None
    if runner and runner.workers > 1:
        conditions = len(campaign.judged(space.design(start)))
        together = Together(scores, runner.workers, max(1, runner.workers // conditions))
    return least_of_all(score, start, far, near, together=together)


# Evaluations of `reach` over the whole space, and again around the best. Chosen by hand: more find
# smaller feasible corners; each takes the margins of one design.
REACH_EVALUATIONS = 120


class Reached(NamedTuple):
    """The design that is nearest to the requirements.

    coordinates  (d,) in the unit cube; those of the start where it meets them all
    short        1, sum of the amounts by which margins are missed; 0 where none is
    margins      of the design
    """

    coordinates: Floats
    short: float
    margins: dict[str, float]


def reach(space: DesignSpace, requirements: Requirements) -> Reached:
    """Search a design that meets mass, power and all other requirements that need no trials.

    Accuracy  model: a feasible corner may be missed where it is smaller than 1 / 120 of the space.
    """

    tried = list[float]()

    def score(coordinates: Floats) -> float:
        try:
            tried.append(missed(margins_of(requirements, space.design(coordinates))))
        except Refused:
            return math.nan
        return tried[-1]

    def enough() -> str:
        return "met" if 0.0 in tried else ""

    found = least_of_all(score, space.start, REACH_EVALUATIONS, REACH_EVALUATIONS, enough)
    margins = {}
    if math.isfinite(found.score):
        margins = margins_of(requirements, space.design(found.coordinates))
    return Reached(found.coordinates, found.score, margins)


# Standard deviations of ln(measured / expected) and of its slope over the cube. Chosen by hand: the
# wider, the more the noise of few designs moves the correction. The slope was 0.9 along the blur of
# the example.
PRIOR = 0.3
PRIOR_SLOPE = 1.0
SCATTER = 0.5  # variance of ln(measured) from one trial; 1/4 for two axes and 1/2 for one, at least


@dataclass(frozen=True, eq=False)
class Correction:
    """ln(measured error / expected error) as a linear function over the cube, and its covariance.

    The relative standard error of n trials is 1 / sqrt(4 n) at best, more than the difference
    between neighbouring designs. The budget has no noise but an error that changes slowly over the
    cube, which the trials of all designs estimate together.

    middle      (d,) unit-cube coordinates
    terms       (d + 1,) the value at the middle, and the slope
    covariance  (d + 1, d + 1) of the terms
    """

    middle: Floats
    terms: Floats
    covariance: Floats

    def __call__(self, coordinates: Floats) -> float:
        """The correction at unit-cube coordinates (d,)."""
        return float(self.terms @ np.append(1.0, coordinates - self.middle))

    def standard_error(self, one: Floats, other: Floats) -> float:
        """Standard error of the difference of the correction between two designs."""
        apart = np.append(0.0, one - other)
        return math.sqrt(float(apart @ self.covariance @ apart))


def correct(tried: Sequence[Evaluation], middle: Floats, reach: float) -> Correction:
    """Fit the correction to the designs within `reach` of the middle along each axis.

    Least squares weighted by the trials of each design, with Gaussian priors on the value and the
    slopes, so that terms that few designs constrain stay near zero.
    """
    near = [
        one
        for one in tried
        if one.error > 0
        and one.expected > 0
        and np.abs(np.array(one.coordinates) - middle).max() <= reach
    ]
    terms = np.array([[1.0, *(np.array(one.coordinates) - middle)] for one in near])
    terms = terms.reshape(-1, len(middle) + 1)
    ratio = np.array([math.log(one.error / one.expected) for one in near])
    weight = np.array([one.trials / SCATTER for one in near])
    prior = np.full(len(middle) + 1, PRIOR_SLOPE)
    prior[0] = PRIOR
    normal = (terms.T * weight) @ terms + np.diag(prior**-2.0)
    covariance = np.asarray(np.linalg.inv(normal), np.float64)
    return Correction(middle, covariance @ (terms.T @ (weight * ratio)), covariance)


# All chosen by hand.
FIRST_STEP = 0.15  # of each range, halved from pass to pass: larger explores, smaller converges
NEAR = 4.0  # first steps around the start of a pass, within which designs fit the correction
PATIENCE = 3  # designs per term of the correction without a gain: evaluations against gain
FRACTION = 0.6  # of the remaining evaluations that a pass may use, unless it is the last
LEAST_GAIN = 2e-3  # of ln(error), below which a gain does not justify more evaluations

Watch = Callable[[Evaluation], None]


def refine(
    space: DesignSpace, start: Floats, campaign: Campaign, runner: TrialRunner, watch: Watch
) -> tuple[list[Evaluation], str]:
    """Search from a start in passes, with twice the trials in each, up to the campaign's most.

    The trials of a pass correct the budget for the next. A design that cannot be the best by its
    score without trials gets none. A pass ends when the best has not improved for some designs by
    more than the standard error of the correction between two designs.

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
        stagnation = _Stagnation(correction)

        def score(
            coordinates: Floats,
            trials: int = trials,
            stagnation: _Stagnation = stagnation,
            tried: list[Evaluation] = tried,
            correction: Correction = correction,
        ) -> float:
            # The first designs of a pass, one per term of the correction, always get trials.
            first = sum(one.trials > 0 for one in tried) < len(correction.terms)
            lead = math.inf if first else min(one.score for one in tried)
            done = evaluate(space, campaign, coordinates, runner, trials, correction, True, lead)
            tried.append(done)
            before.append(done)
            stagnation.see(done)
            watch(done)
            return done.score

        found = least(
            score, start, Search(evaluations=max(1, fraction), first_step=step), stagnation
        )
        left -= found.evaluations
        start, step, ending = found.coordinates, step / 2, found.ending
        if left <= 0:
            break
    return sorted(tried, key=lambda one: (not one.feasible, one.score)), ending


def growth(first: int, most: int) -> Iterator[int]:
    """Trials of each pass: doubled until the most."""
    while first < most:
        yield first
        first = min(2 * first, most)
    yield most


class _Stagnation:
    """Ends a pass that no longer gains more than its noise."""

    def __init__(self, correction: Correction) -> None:
        self._correction = correction
        self._anchor: Evaluation | None = None  # the best at the last gain
        self._since = 0

    def see(self, done: Evaluation) -> None:
        self._since += 1
        if self._anchor is None or self._gain(done, self._anchor):
            self._anchor, self._since = done, 0

    def __call__(self) -> str:
        patience = PATIENCE * len(self._correction.terms)
        return "a further gain would be within the noise" if self._since >= patience else ""

    def _gain(self, done: Evaluation, anchor: Evaluation) -> bool:
        noise = self._correction.standard_error(
            np.array(done.coordinates), np.array(anchor.coordinates)
        )
        return anchor.score - done.score > max(noise, LEAST_GAIN)


ROUND = 4  # evaluations at most of a branch in a round, per variable and one more; chosen by hand
# Of the evaluations that all rounds together may use; the rest refine the winner. Chosen by hand.
RACE_FRACTION = 2 / 3
# Confidence at which a branch is worse than the leader: 3 sigma. Chosen by hand: a lower one saves
# evaluations and loses good branches more often.
SURE = 0.997


@dataclass
class _Branch:
    """A branch, its best design so far, and the first step of its next search."""

    label: str
    space: DesignSpace
    coordinates: Floats
    step: float = FIRST_STEP
    best: Evaluation | None = None


def race(
    spaces: Mapping[str, DesignSpace],
    starts: Mapping[str, Floats],
    campaign: Campaign,
    runner: TrialRunner,
    watch: Watch,
) -> tuple[str, Floats]:
    """Search all branches in rounds; each keeps the better half, without those clearly worse.

    Source: successive halving, Jamieson and Talwalkar (2016), with the test of a race (Maron and
    Moore 1994), here paired on the same trials.

    campaign  two thirds of its evaluations are used at most, but one per branch in each round
    Returns   label of the winner and its best coordinates; at once where there is one branch only
    """
    field = [_Branch(label, space, starts[label]) for label, space in spaces.items()]
    runs = _runs(len(field))
    each = max(1, int(RACE_FRACTION * campaign.evaluations) // runs) if runs else 0
    while len(field) > 1:
        for branch in field:
            _run(branch, each, campaign, runner, watch)
        field.sort(key=_score)
        half = field[: math.ceil(len(field) / 2)]
        field = [
            one for one in half if one is half[0] or not _beaten(one, half[0], campaign, runner)
        ]
    return field[0].label, field[0].coordinates


def _runs(branches: int) -> int:
    """Number of searches in all rounds of a race in which no branch is beaten early."""
    return branches + _runs(math.ceil(branches / 2)) if branches > 1 else 0


def _run(branch: _Branch, most: int, campaign: Campaign, runner: TrialRunner, watch: Watch) -> None:
    def score(coordinates: Floats) -> float:
        done = evaluate(branch.space, campaign, coordinates, runner, spare=True)
        watch(done)
        if branch.best is None or done.score < branch.best.score:
            branch.best = done
        return done.score

    evaluations = min(most, ROUND * (len(branch.space) + 1))
    search = Search(evaluations=evaluations, first_step=branch.step)
    branch.coordinates = least(score, branch.coordinates, search).coordinates
    branch.step /= 2


def _score(branch: _Branch) -> float:
    return branch.best.score if branch.best else math.inf


def _beaten(one: _Branch, leader: _Branch, campaign: Campaign, runner: TrialRunner) -> bool:
    if not (one.best and leader.best and one.best.error > 0 and leader.best.error > 0):
        return False
    rms = Objective(Objective.read(campaign.objective).axes)
    mine, theirs = (
        rms.squares(
            try_out(
                campaign.judged(each.space.design(each.coordinates))[0],
                campaign.trials,
                campaign.fidelity,
                runner,
            )
        )
        for each in (one, leader)
    )
    return rms.ratio(mine, theirs, runner.seed, confidence=SURE).low > 1


LOOKS = 4  # at 1, 2, 4 and 8 times the fresh trials; chosen by hand: trials against a decision
UNIT_LOOKS = 2  # at 1 and 2 times the fresh units, each of which needs plans of its own


def assure(
    one: Judged, campaign: Campaign, runner: TrialRunner, outcomes: NDArray[np.void]
) -> dict[str, Assured]:
    """The errors that are limited, and the availability, with bounds for their requirements.

    While a requirement is undecided, the trials are doubled, up to three times, with the campaign's
    own fidelity, which has the distribution of frames in less time. The bounds are those of `Claim`
    with a tail of 0.05 / 4 (one minus the confidence of the requirements, over four looks), so that
    at most 5 % of the designs have a wrong bound at any of the looks (Bonferroni). Over
    units, an error is shown by the share of them that keep its limit, in two looks.

    outcomes  of the fresh frames that exist already
    Returns   the value over all trials, its bounds and its margin by the bound that must hold
    """
    units = one.units
    most = LOOKS if units is None else UNIT_LOOKS
    looks = Looks(2, 2**most, 1 - one.needs.confidence)  # so many of them; sizes are not used
    tails = looks.tails(1)
    first, claims, found = FRESH + len(outcomes), claims_of(one.needs), dict[str, Assured]()
    for look in range(most if len(outcomes) else 0):
        judged = counted(one.needs, one.case, runner.seed, outcomes)
        boresight = boresights(runner.seed, judged)
        for claim in claims:
            if units is not None and claim.accuracy:
                asked = YieldClaim(units.fraction)
                errors = errors_of(claim.accuracy.objective, judged, units, campaign)
                bounds = asked.bounds(errors <= claim.limit, *tails)
                decided = asked.answer(bounds) is not Answer.NOT_SHOWN
                found[claim.name] = Assured(bounds, asked.margin(bounds.low), decided)
                continue
            bounds = claim.bounds(judged, boresight, *tails)
            shown = bounds.high if claim.accuracy else bounds.low
            decided = claim.answer(bounds) is not Answer.NOT_SHOWN
            found[claim.name] = Assured(bounds, claim.margin(shown), decided)
        if all(each.decided for each in found.values()) or look == most - 1:
            break
        if units is not None:
            done = len(outcomes) // campaign.trials_per_unit
            more = fresh_units(one, campaign, runner, done, done)
            outcomes = np.concatenate([outcomes, more])
            continue
        # Repeated numbers would repeat the attitudes.
        more = runner.run(one.case, len(outcomes), campaign.fidelity, first)
        first, outcomes = first + len(more), np.concatenate([outcomes, more])
    return found


class Assured(NamedTuple):
    """A requirement on the best design, by fresh trials.

    bounds   of its value
    margin   by the bound that must hold
    decided  whether the trials decide it
    """

    bounds: Interval
    margin: float
    decided: bool
