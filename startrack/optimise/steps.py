"""The steps of the optimiser: start, forecasts, correction, refinement, confirmation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from startrack import verification
from startrack.core import Floats, Refused, Rows
from startrack.design import Campaign, Case, DesignSpace, Judged, Requirements
from startrack.optimise.correction import Correction, fit_correction
from startrack.optimise.evaluate import Evaluation, evaluate, missed
from startrack.optimise.explorer import Explorer
from startrack.optimise.forecast import name_by_condition
from startrack.optimise.limit import Evidence, Limit
from startrack.optimise.population import FIRST_ROUND, Confirmed, FreshTrials, population_of
from startrack.optimise.runner import TrialRunner
from startrack.optimise.search import Search, algorithms, least, least_of_all
from startrack.problem import SearchSettings
from startrack.verification import cost_margins, counted
from startrack.verification import margins as margins_of

EMULATOR = "emulator"
USUAL = 12  # forecasts per variable, as in most searches
RESUMED = 3  # forecasts per variable at most after trials that show a limit missed
RIVAL = 0.1  # of ln(error), by which budgets of branches may be wrong; chosen by hand


class SearchStage(NamedTuple):
    """Stage of a search.

    name  of what it does
    part  1, of the time that all will take, as on the nanosatellite
    best  what is made small of the best design so far, as expected; NaN before the first
    unit  of it
    """

    name: str
    part: float
    best: float
    unit: str = "arcsec"


def explore(
    explorers: Mapping[str, Explorer], starts: Mapping[str, Floats], settings: SearchSettings
) -> dict[str, Explorer]:
    """Forecast designs of each branch until no further gain is expected, without a trial.

    A branch is left as soon as none of its designs can be as good as the best of the others.

    Returns   the branches whose best may be the best with trials
    Accuracy  model: that of the budget; the result is a start for trials.
    """
    most, left = max(settings.analytic_evaluations, 1), dict(explorers)
    for label, branch in explorers.items():
        if settings.search == EMULATOR:
            branch.begin(starts[label], most)
        else:
            _search(branch, starts[label], most)
    return _run(left, most)


def resume(explorer: Explorer) -> None:
    """Forecast further designs where trials have moved the limits."""
    explorer.reopen()
    _run({explorer.label: explorer}, len(explorer.points) + RESUMED * len(explorer.source.names))


def _run(left: dict[str, Explorer], most: int) -> dict[str, Explorer]:
    while running := [branch for branch in left.values() if not branch.ending]:
        for branch in running:
            if len(branch.points) < most:
                branch.step(most - len(branch.points))
            else:
                branch.complete()
                branch.ending = "all analytic evaluations were used"
        least = min(branch.score for branch in left.values())
        left = {
            label: branch
            for label, branch in left.items()
            if branch.score <= least + RIVAL or (not branch.ending and branch.lowest() <= least)
        }
    return left


def _search(branch: Explorer, start: Floats, most: int) -> None:
    """Forecast designs where algorithms of nlopt ask for them, from the best so far."""
    names = algorithms(branch.source.search)

    def score(point: Floats) -> float:
        return branch.forecast_of(point).score

    branch.forecast([start])
    for name in names:
        seed = branch.source.seed % 2**32
        search = Search(name, max(1, most // len(names)), seed=seed)
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


def unmet_costs(spaces: Sequence[DesignSpace], requirements: Requirements) -> dict[str, float]:
    """The largest margin of each cost that exceeds its limit in all designs, without a forecast.

    Accuracy  model: as for `feasible_start`.
    """
    unmet = dict[str, float]()
    for name in cost_margins(requirements, spaces[0].case):
        best = -math.inf
        for space in spaces:
            best = max(best, _largest_margin(space, requirements, name))
            if best >= 0:
                break
        if -math.inf < best < 0:
            unmet[name] = best
    return unmet


def _largest_margin(space: DesignSpace, requirements: Requirements, name: str) -> float:
    """That of one cost; the first that is not missed, and minus infinity if all are refused."""
    largest = -math.inf

    def score(coordinates: Floats) -> float:
        nonlocal largest
        try:
            margin = cost_margins(requirements, space.design(coordinates))[name]
        except Refused:
            return math.nan
        largest = max(largest, margin)
        return -margin

    def enough() -> str:
        return "met" if largest >= 0 else ""

    least_of_all(score, space.start, START_EVALUATIONS, START_EVALUATIONS, enough)
    return largest


# All chosen by hand.
TRIED = 0.02  # of each range: trials of nearer designs say the same
POLISH = 4  # forecasts at most until a design at a limit meets it
FINALISTS = 2  # designs that have the campaign's most trials at the end
EVERYWHERE = 1.0  # of each range: trials of all designs fit the correction

Watch = Callable[[Evaluation], None]
# Trials of a design, at unit-cube coordinates: None for the first number of trials.
TryDesign = Callable[[Floats, int | None, Correction | None], Evaluation]


def refine(
    explorer: Explorer,
    evaluations: int,
    most_trials: int,
    try_design: TryDesign,
    watch: Watch,
    before: Sequence[Evaluation] = (),
    shown: Sequence[Shown] = (),
) -> tuple[list[Evaluation], str]:
    """Trials of the designs that may be the best, until they move the best no more.

    Trials correct the budget over the space, and each margin that they decide in the conditions
    that have a weight and in those where a limit is close. The next design is the one that the
    corrected budget expects to be the best, if its own forecast is as good as the best one; or,
    where that has been tried, the one that is expected to gain most of those where the score
    without trials is within the precision: the noise of the trials counts.

    evaluations  at most, those before among them
    most_trials  of each of the best designs at the end
    before   evaluations of this branch so far
    shown    what fresh trials showed of designs that missed a limit there
    Returns  the evaluations, those with most trials first and of these the best, and a sentence on
             how it ended
    """
    tried, ending = list(before), "all evaluations were used"
    for _ in range(max(1, evaluations - FINALISTS)):
        explorer.learn(evidence_of(explorer, tried, shown))
        correction = fit_correction(tried, explorer.best, EVERYWHERE)
        point = _next(explorer, correction, tried, explorer.source.precision)
        if point is None:
            ending = explorer.ending
            break
        tried.append(try_design(point, None, correction))
        watch(tried[-1])

    def ranked(designs: Sequence[Evaluation]) -> list[Evaluation]:
        explorer.learn(evidence_of(explorer, tried, shown))
        correction = fit_correction(tried, explorer.best, EVERYWHERE)
        return sorted(designs, key=lambda design: _rank(explorer, correction, design))

    last = list[Evaluation]()
    missed_before = {design.point for design in shown}
    left = [design for design in tried if design.coordinates not in missed_before]
    for finalist in ranked(list({design.coordinates: design for design in left}.values()))[
        :FINALISTS
    ]:
        point = np.array(finalist.coordinates)
        correction = fit_correction(tried, explorer.best, EVERYWHERE)
        last.append(try_design(point, most_trials, correction))
        watch(last[-1])
    tried += last
    last = ranked(last)
    return [*last, *(design for design in tried if design not in last)], ending


def _rank(explorer: Explorer, correction: Correction, design: Evaluation) -> tuple[bool, float]:
    """Whether a design that was tried misses a limit, and its score, both corrected by trials."""
    point = np.array(design.coordinates)
    met = design.trials > 0 and design.margins.get("false attitudes", 0.0) >= 0
    score = explorer.forecast_of(point).score + correction(point)
    if not math.isfinite(score):
        score = design.score
    return not (met and explorer.met(point)), score


class Shown(NamedTuple):
    """Results of fresh trials of a design.

    point    unit-cube coordinates
    margins  as they found them, and their number, by the margin's name
    """

    point: tuple[float, ...]
    margins: dict[str, tuple[float, int]]


def corrected_score(
    explorer: Explorer, tried: Sequence[Evaluation]
) -> Callable[[tuple[float, ...]], float]:
    """ln of what is made small of any design, as trials correct its forecast, without limits."""
    correction = fit_correction(tried, explorer.best, EVERYWHERE)

    def score(coordinates: tuple[float, ...]) -> float:
        point = np.array(coordinates)
        return explorer.forecast_of(point).expected + correction(point)

    return score


def evidence_of(
    explorer: Explorer, tried: Sequence[Evaluation], shown: Sequence[Shown]
) -> dict[str, list[Evidence]]:
    """All that trials say of each margin that has a limit."""
    evidence: dict[str, list[Evidence]] = {name: [] for name in explorer.limits}
    for design in tried:
        for name in design.forecast.keys() & evidence.keys():
            point = np.array(design.coordinates)
            pair = design.forecast[name], design.margins[name]
            evidence[name].append(Evidence(point, *pair, design.trials))
    for found in shown:
        forecast = explorer.unlimited(np.array(found.point)).margins
        for name in found.margins.keys() & evidence.keys() & forecast.keys():
            measured, trials = found.margins[name]
            pair = forecast[name], measured
            evidence[name].append(Evidence(np.array(found.point), *pair, trials))
    return evidence


def limits_of(case: Case, campaign: Campaign) -> dict[str, Limit]:
    """The margins that trials decide, by name, and what the fresh trials of a campaign can show."""
    limits = dict[str, Limit]()
    for condition in campaign.judged(case):
        tail, _ = _tails(condition)
        units = population_of(condition)
        trials = units.most_fresh(campaign)
        own = {
            accuracy.name: units.limit(accuracy, trials, tail)
            for accuracy in condition.needs.accuracy
        }
        least = condition.needs.min_availability
        if least < 1:
            own["availability"] = Limit.of_chance(least, trials, tail)
        limits |= name_by_condition(condition.name, own)
    return limits


def trials_of_tracker(
    explorer: Explorer, space: DesignSpace, campaign: Campaign, runner: TrialRunner
) -> TryDesign:
    """Trials of a star tracker's designs, with the forecasts that are known of them."""

    def try_design(point: Floats, trials: int | None, correction: Correction | None) -> Evaluation:
        known, close = explorer.forecast_of(point), explorer.close(point)
        return evaluate(
            space, campaign, point, runner, trials, correction, known=known, close=close
        )

    return try_design


def _next(
    explorer: Explorer, correction: Correction, tried: Sequence[Evaluation], precision: float
) -> Floats | None:
    """The next design for trials; None where none is expected to gain as much as is asked."""

    def corrected(point: Floats) -> float:
        return explorer.forecast_of(point).score + correction(point)

    for _ in range(POLISH):
        model = explorer.emulators
        here, score = model.least(explorer.starts(), correction=correction, steps=explorer.source)
        if not _is_new(here, tried):
            break
        explorer.forecast([here])
        value = explorer.values[-1]
        # Where the objective jumps, an emulator's best may be far worse than the best forecast.
        near = value.score + correction(here) <= corrected(explorer.best) + precision
        if near and not missed(value.margins):
            return here
    points = [np.array(evaluation.coordinates) for evaluation in tried]
    least = corrected(explorer.best) + precision
    rivals = [point for point in points if explorer.met(point) and corrected(point) <= least]
    if not rivals and not any((point == explorer.best).all() for point in points):
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
    explorers: Mapping[str, Explorer],
    try_designs: Mapping[str, TryDesign],
    trials: int,
    watch: Watch,
) -> str:
    """The label of the branch whose best is the best with trials, of those that forecasts leave.

    The trials of each correct its own forecast as far as their noise bears.
    """
    if len(explorers) == 1:
        return next(iter(explorers))
    scores = {}
    for label, explorer in explorers.items():
        point = explorer.best
        done = try_designs[label](point, trials, None)
        watch(done)
        scores[label] = done.score + fit_correction([done], point, EVERYWHERE)(point)
    return min(scores, key=scores.__getitem__)


ROUNDS = 5  # of fresh trials at most, until one shows that all limits are met; chosen by hand


def _tails(condition: Judged, part: float = 1.0) -> tuple[float, float]:
    looks = population_of(condition).looks
    return verification.tails(looks, part * (1 - condition.needs.confidence), 1)


def confirm_requirements(
    condition: Judged,
    campaign: Campaign,
    runner: TrialRunner,
    outcomes: Rows,
    fresh: FreshTrials = FIRST_ROUND,
) -> dict[str, Confirmed]:
    """The errors that are limited, and the availability, with bounds for their requirements.

    While a requirement is undecided, the trials are doubled, up to three times, with the campaign's
    own fidelity, which has the distribution of frames in less time. The bounds are those of `Claim`
    with a tail of 0.05 / 4 (one minus the confidence of the requirements, over four looks), so that
    at most 5 % of the designs have a wrong bound at any of the looks (Bonferroni); half of
    that in the second round of fresh trials, a quarter in the third, so that all rounds of a search
    together have at most 10 %. Over units, an error is shown by the share of them that keep its
    limit, in two looks.

    outcomes  of the fresh frames that exist already
    fresh     the round that they are of
    Returns   the value over all trials, its bounds and its margin by the bound that must hold
    """
    units, tails = population_of(condition), _tails(condition, fresh.part)
    claims, confirmed = verification.claims_of(condition.needs), dict[str, Confirmed]()
    for look in range(units.looks if len(outcomes) else 0):
        judged = counted(condition.needs, condition.case, runner.seed, outcomes)
        for claim in claims:
            confirmed[claim.name] = units.confirmed(claim, judged, campaign, runner, tails)
        if all(result.decided for result in confirmed.values()) or look == units.looks - 1:
            break
        more = units.fresh(campaign, runner, campaign.fidelity, fresh, len(outcomes))
        outcomes = np.concatenate([outcomes, more])
    return confirmed
