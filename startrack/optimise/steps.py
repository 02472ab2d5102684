"""The steps of the optimiser: start, forecasts, correction, refinement, confirmation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from startrack import verification
from startrack.core import Floats, Refused, Rows, arcsec
from startrack.design import Campaign, DesignSpace, Judged, Requirements
from startrack.metrics import Interval
from startrack.optimise.evaluate import PENALTY, Evaluation, evaluate, missed
from startrack.optimise.explore import Correction, Explorer
from startrack.optimise.runner import FRESH, TrialRunner
from startrack.optimise.search import Search, algorithms, least, least_of_all
from startrack.optimise.units import fresh_units, likely_errors
from startrack.verification import cost_margins, counted
from startrack.verification import margins as margins_of

EMULATOR = "emulator"
USUAL = 12  # forecasts per variable, as in most searches
RIVAL = 0.1  # of ln(error), by which budgets of branches may be wrong; chosen by hand


class Stage(NamedTuple):
    """How far a search has come.

    name  of what it does
    part  1, of the time that all will take, as on the nanosatellite
    best  arcsec, the objective of the best design so far, as expected; NaN before the first
    """

    name: str
    part: float
    best: float


def explore(
    explorers: Mapping[str, Explorer], starts: Mapping[str, Floats], campaign: Campaign
) -> dict[str, Explorer]:
    """Forecast designs of each branch until no further gain is expected, without a trial.

    A branch is left as soon as none of its designs can be as good as the best of the others.

    Returns   the branches whose best may be the best with trials
    Accuracy  model: that of the budget; the result is a start for trials.
    """
    most, left = max(campaign.analytic_evaluations, 1), dict(explorers)
    for label, branch in explorers.items():
        if campaign.search == EMULATOR:
            branch.begin(starts[label], most)
        else:
            _search(branch, starts[label], most)
    while running := [branch for branch in left.values() if not branch.ending]:
        for branch in running:
            if len(branch.points) < most:
                branch.step(most - len(branch.points))
            else:
                branch.complete()
                branch.ending = "all analytic evaluations were used"
        least = min(branch.score for branch in left.values())
        left = {
            label: branch for label, branch in left.items()
            if branch.score <= least + RIVAL or (not branch.ending and branch.lowest() <= least)
        }  # fmt: skip
    return left


def _search(branch: Explorer, start: Floats, most: int) -> None:
    """Forecast designs where algorithms of nlopt ask for them, from the best so far."""
    names = algorithms(branch.campaign.search)

    def score(point: Floats) -> float:
        return branch.forecast_of(point).score

    branch.forecast([start])
    for name in names:
        seed = branch.runner.seed if branch.runner else branch.seed
        search = Search(name, max(1, most // len(names)), seed=seed % 2**32)
        ended = least(score, branch.best, search)
        branch.ending = ended.ending


# Evaluations of `feasible_start` over the whole space, and again around the best. Chosen by hand:
# more find smaller feasible corners; each takes the margins of one design.
START_EVALUATIONS = 120


class FeasibleStart(NamedTuple):
    """The design that is nearest to the requirements.

    coordinates  (d,) in the unit cube; those of the start where it meets them all
    short        1, sum of the amounts by which margins are missed; 0 where none is
    margins      of the design
    """

    coordinates: Floats
    short: float
    margins: dict[str, float]


def feasible_start(space: DesignSpace, requirements: Requirements) -> FeasibleStart:
    """Search a design that meets mass, power and all other requirements that need no trials.

    Accuracy  model: a feasible corner may be missed where it is smaller than 1 / 120 of the space.
    """
    tried = list[float]()

    def score(coordinates: Floats) -> float:
        try:
            case = space.design(coordinates)
            short = missed(cost_margins(requirements, case))
            # A design that costs too much needs no images to be worse than those that do not.
            tried.append(short + 1 if short else missed(margins_of(requirements, case)))
        except Refused:
            return math.nan
        return tried[-1]

    def enough() -> str:
        return "met" if 0.0 in tried else ""

    end = least_of_all(score, space.start, START_EVALUATIONS, START_EVALUATIONS, enough)
    if not math.isfinite(end.score):
        return FeasibleStart(end.coordinates, end.score, {})
    margins = margins_of(requirements, space.design(end.coordinates))
    return FeasibleStart(end.coordinates, missed(margins), margins)


# Standard deviations of ln(measured / expected) and of its slope over the cube. Chosen by hand: the
# wider, the more the noise of few designs moves the correction.
PRIOR = 0.3
PRIOR_SLOPE = 0.1
SCATTER = 0.5  # variance of ln(measured) from one trial; 1/4 for two axes and 1/2 for one, at least


def correct(tried: Sequence[Evaluation], middle: Floats, radius: float) -> Correction:
    """Fit the correction to the designs within `radius` of the middle along each axis.

    Least squares weighted by the trials of each design, with Gaussian priors on the value and the
    slopes, so that terms that few designs constrain stay near zero.
    """
    near = [
        evaluation
        for evaluation in tried
        if evaluation.error > 0
        and evaluation.expected > 0
        and np.abs(np.array(evaluation.coordinates) - middle).max() <= radius
    ]
    terms = np.array([[1.0, *(np.array(evaluation.coordinates) - middle)] for evaluation in near])
    terms = terms.reshape(-1, len(middle) + 1)
    ratio = np.array([math.log(evaluation.error / evaluation.expected) for evaluation in near])
    weight = np.array([evaluation.trials / SCATTER for evaluation in near])
    prior = np.full(len(middle) + 1, PRIOR_SLOPE)
    prior[0] = PRIOR
    normal = (terms.T * weight) @ terms + np.diag(prior**-2.0)
    covariance = np.asarray(np.linalg.inv(normal), np.float64)
    return Correction(middle, covariance @ (terms.T @ (weight * ratio)), covariance)


# All chosen by hand.
TRIED = 0.02  # of each range: trials of nearer designs say the same
POLISH = 4  # forecasts at most until a design at a limit meets it
FINALISTS = 2  # designs that have the campaign's most trials at the end
EVERYWHERE = 1.0  # of each range: trials of all designs fit the correction

Watch = Callable[[Evaluation], None]


def refine(
    explorer: Explorer, campaign: Campaign, runner: TrialRunner, watch: Watch
) -> tuple[list[Evaluation], str]:
    """Trials of the designs that may be the best, until they move the best no more.

    Trials correct the budget over the space. The next design is the one that the corrected budget
    expects to be the best, if its own forecast is as good as the best one; or, where that has been
    tried, the one that is expected to gain most of those where the score without trials is within
    the precision: the noise of the trials counts.

    Returns  the evaluations, those with most trials first and of these the best, and a sentence on
             how it ended
    """
    tried, ending = list[Evaluation](), "all evaluations were used"
    for _ in range(max(1, campaign.evaluations - FINALISTS)):
        correction = correct(tried, explorer.best, EVERYWHERE)
        point = _next(explorer, correction, tried, campaign.precision)
        if point is None:
            ending = explorer.ending
            break
        tried.append(_tried(explorer, campaign, point, runner, None, correction))
        watch(tried[-1])
    correction = correct(tried, explorer.best, EVERYWHERE)

    def corrected(evaluation: Evaluation) -> float:
        if not evaluation.expected > 0:
            return evaluation.score
        log, at = math.log(evaluation.expected / arcsec), np.array(evaluation.coordinates)
        return log + correction(at) + PENALTY * missed(evaluation.margins)

    tried.sort(key=lambda evaluation: (not evaluation.feasible, corrected(evaluation)))
    last = list[Evaluation]()
    for finalist in tried[:FINALISTS]:
        point, most = np.array(finalist.coordinates), campaign.most_trials
        last.append(_tried(explorer, campaign, point, runner, most, correction))
        watch(last[-1])
    last.sort(key=lambda evaluation: (not evaluation.feasible, evaluation.score))
    return [*last, *tried[FINALISTS:]], ending


def _tried(
    explorer: Explorer, campaign: Campaign, point: Floats, runner: TrialRunner, trials: int | None,
    correction: Correction | None = None,
) -> Evaluation:  # fmt: skip
    """A design by trials, with the forecast that is known of it."""
    known = explorer.forecast_of(point)
    return evaluate(explorer.space, campaign, point, runner, trials, correction, known=known)


def _next(
    explorer: Explorer, correction: Correction, tried: Sequence[Evaluation], precision: float
) -> Floats | None:
    """The next design for trials; None where none is expected to gain as much as is asked."""

    def corrected(point: Floats) -> float:
        return explorer.forecast_of(point).score + correction(point)

    for _ in range(POLISH):
        model = explorer.emulators
        here, score = model.least(explorer.starts(), correction=correction)
        if not _is_new(here, tried):
            break
        explorer.forecast([here])
        value = explorer.values[-1]
        # Where the objective leaps, an emulator's best may be far worse than the best forecast.
        near = value.score + correction(here) <= corrected(explorer.best) + precision
        if near and not missed(value.margins):
            return here
    least = corrected(explorer.best) + precision
    if all(corrected(np.array(evaluation.coordinates)) > least for evaluation in tried):
        return explorer.best
    ends = [end for span in explorer.spans(here) for end in (span.at_low, span.at_high)]
    points = np.array([end for end in ends if _is_new(end, tried)])
    if not len(points):
        return None
    expected = model.score(points) + np.array([correction(point) for point in points])
    sigma = np.array([max(correction.standard_error(point, here), 1e-12) for point in points])
    ahead = (score - expected) / sigma
    gain = sigma * (ahead * ndtr(ahead) + np.exp(-(ahead**2) / 2) / math.sqrt(2 * math.pi))
    return points[int(gain.argmax())] if gain.max() > precision else None


def _is_new(point: Floats, tried: Sequence[Evaluation]) -> bool:
    others = (np.array(evaluation.coordinates) for evaluation in tried)
    return all(np.abs(point - other).max() > TRIED for other in others)


def best_branch(
    explorers: Mapping[str, Explorer], campaign: Campaign, runner: TrialRunner, watch: Watch
) -> str:
    """The label of the branch whose best is the best with trials, of those that forecasts leave.

    The trials of each correct its own forecast as far as their noise bears.
    """
    if len(explorers) == 1:
        return next(iter(explorers))
    scores = {}
    for label, explorer in explorers.items():
        point = explorer.best
        done = _tried(explorer, campaign, point, runner, campaign.most_trials)
        watch(done)
        scores[label] = done.score + correct([done], point, EVERYWHERE)(point)
    return min(scores, key=scores.__getitem__)


LOOKS = 4  # at 1, 2, 4 and 8 times the fresh trials; chosen by hand: trials against a decision
UNIT_LOOKS = 2  # at 1 and 2 times the fresh units, each of which needs plans of its own


def confirm_requirements(
    condition: Judged, campaign: Campaign, runner: TrialRunner, outcomes: Rows
) -> dict[str, Confirmed]:
    """The errors that are limited, and the availability, with bounds for their requirements.

    While a requirement is undecided, the trials are doubled, up to three times, with the campaign's
    own fidelity, which has the distribution of frames in less time. The bounds are those of `Claim`
    with a tail of 0.05 / 4 (one minus the confidence of the requirements, over four looks), so that
    at most 5 % of the designs have a wrong bound at any of the looks (Bonferroni). Over
    units, an error is shown by the share of them that keep its limit, in two looks.

    outcomes  of the fresh frames that exist already
    Returns   the value over all trials, its bounds and its margin by the bound that must hold
    """
    units = condition.units
    most = LOOKS if units is None else UNIT_LOOKS
    # So many looks; their sizes are not used.
    tails = verification.Looks(2, 2**most, 1 - condition.needs.confidence).tails(1)
    first, claims = FRESH + len(outcomes), verification.claims_of(condition.needs)
    confirmed = dict[str, Confirmed]()
    for look in range(most if len(outcomes) else 0):
        judged = counted(condition.needs, condition.case, runner.seed, outcomes)
        boresight = verification.boresights(runner.seed, judged)
        for claim in claims:
            if units is not None and claim.accuracy:
                asked = verification.YieldClaim(units.fraction)
                objective = claim.accuracy.objective
                errors = likely_errors(objective, condition, judged, campaign, runner)
                bounds = asked.bounds(errors <= claim.limit, *tails)
                decided = asked.answer(bounds) is not verification.Answer.NOT_SHOWN
                confirmed[claim.name] = Confirmed(bounds, asked.margin(bounds.low), decided)
                continue
            bounds = claim.bounds(judged, boresight, *tails)
            shown = bounds.high if claim.accuracy else bounds.low
            decided = claim.answer(bounds) is not verification.Answer.NOT_SHOWN
            confirmed[claim.name] = Confirmed(bounds, claim.margin(shown), decided)
        if all(result.decided for result in confirmed.values()) or look == most - 1:
            break
        if units is not None:
            done = len(outcomes) // campaign.trials_per_unit
            more = fresh_units(condition, campaign, runner, done, done)
            outcomes = np.concatenate([outcomes, more])
            continue
        # Repeated numbers would repeat the attitudes.
        more = runner.run(condition.case, len(outcomes), campaign.fidelity, first)
        first, outcomes = first + len(more), np.concatenate([outcomes, more])
    return confirmed


class Confirmed(NamedTuple):
    """A requirement on the best design, by fresh trials.

    bounds   of its value
    margin   by the bound that must hold
    decided  whether the trials decide it
    """

    bounds: Interval
    margin: float
    decided: bool
