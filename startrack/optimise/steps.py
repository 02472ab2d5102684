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
from startrack.optimise.search import Search, algorithms, minimise, minimise_globally
from startrack.problem import SearchSettings
from startrack.verification import cost_margins, counted
from startrack.verification import margins as margins_of

EMULATOR = "emulator"
USUAL_FORECASTS = 12  # per variable, in most searches
RESUMED = 3  # largest number of forecasts per variable after trials that show a limit missed
BRANCH_TOLERANCE = 0.1  # error of ln(error) in the budgets of branches; chosen by hand


class SearchStage(NamedTuple):
    """Stage of a search.

    name  of the stage
    part  1, fraction of the search's time, as in the design `nanosatellite`
    best  expected objective of the best design so far; NaN before the first design
    unit  of `best`
    """

    name: str
    part: float
    best: float
    unit: str = "arcsec"


def explore(
    explorers: Mapping[str, Explorer], starts: Mapping[str, Floats], settings: SearchSettings
) -> dict[str, Explorer]:
    """Forecast designs of each branch until no further gain is expected. No trial is run.

    A branch ends when none of its designs can be as good as the best of the other branches.

    explorers, starts  of each branch, by its label; starts (d,) in the unit cube
    Returns   the branches whose best design may be the best one after trials
    Accuracy  model: that of the budget; the result is a start for trials.
    """
    most, left = max(settings.analytic_evaluations, 1), dict(explorers)
    for label, branch in explorers.items():
        if settings.search == EMULATOR:
            branch.begin(starts[label], most)
        else:
            _search_by_nlopt(branch, starts[label], most)
    return _forecast_until_ended(left, most)


def resume(explorer: Explorer) -> None:
    """Forecast further designs after trials have corrected the limits."""
    explorer.reopen()
    _forecast_until_ended(
        {explorer.label: explorer}, len(explorer.points) + RESUMED * len(explorer.source.names)
    )


def _forecast_until_ended(left: dict[str, Explorer], most: int) -> dict[str, Explorer]:
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
            if branch.score <= least + BRANCH_TOLERANCE
            or (not branch.ending and branch.lowest() <= least)
        }
    return left


def _search_by_nlopt(branch: Explorer, start: Floats, most: int) -> None:
    """Forecast the designs that algorithms of nlopt ask for; each starts from the best design."""
    names = algorithms(branch.source.search)

    def score(point: Floats) -> float:
        return branch.forecast_of(point).score

    branch.forecast([start])
    for name in names:
        seed = branch.source.seed % 2**32
        search = Search(name, max(1, most // len(names)), seed=seed)
        ended = minimise(score, branch.best, search)
        branch.ending = ended.ending


# Evaluations of `feasible_start` over the whole space; the same number follows around the best
# design. Chosen by hand: more evaluations find smaller feasible regions; each computes the margins
# of one design.
START_EVALUATIONS = 120


class FeasibleStart(NamedTuple):
    """The design that is nearest to meeting the requirements.

    coordinates  (d,) in the unit cube; those of the start if it meets all requirements
    short        1, sum of the negative margins, as a positive number; 0 if no margin is missed
    margins      margins of the design, by name
    """

    coordinates: Floats
    short: float
    margins: dict[str, float]


def feasible_start(space: DesignSpace, requirements: Requirements) -> FeasibleStart:
    """Search a design that meets mass, power and all other requirements that need no trials.

    Accuracy  model: a feasible region smaller than 1 / 120 of the space may be missed.
    """
    tried = list[float]()

    def score(coordinates: Floats) -> float:
        try:
            case = space.design(coordinates)
            short = missed(cost_margins(requirements, case))
            # A design whose costs exceed a limit ranks below all others; further margins do not
            # count.
            tried.append(short + 1 if short else missed(margins_of(requirements, case)))
        except Refused:
            return math.nan
        return tried[-1]

    def enough() -> str:
        return "met" if 0.0 in tried else ""

    end = minimise_globally(score, space.start, START_EVALUATIONS, START_EVALUATIONS, enough)
    if not math.isfinite(end.score):
        return FeasibleStart(end.coordinates, end.score, {})
    margins = margins_of(requirements, space.design(end.coordinates))
    return FeasibleStart(end.coordinates, missed(margins), margins)


def unmet_costs(spaces: Sequence[DesignSpace], requirements: Requirements) -> dict[str, float]:
    """Largest margin over all designs, of each cost that exceeds its limit in every design.

    No forecast is made.

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
    """Largest margin of one cost, or the first that is met; minus infinity if all are refused."""
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

    minimise_globally(score, space.start, START_EVALUATIONS, START_EVALUATIONS, enough)
    return largest


# All chosen by hand.
TRIED = 0.02  # distance, as a fraction of each range, within which trials of two designs agree
POLISH = 4  # largest number of forecasts until a design at a limit meets it
FINALISTS = 2  # designs that get the campaign's largest number of trials at the end
EVERYWHERE = 1.0  # fraction of each range: trials of all designs fit the correction

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
    shown: Sequence[FreshMargins] = (),
) -> tuple[list[Evaluation], str]:
    """Run trials of the designs that may be the best, until these no longer change the best one.

    Trials correct the budget over the space. They also correct each margin that trials decide, in
    conditions that have a weight and in conditions where a limit is close. The next design is the
    one with the best corrected budget, if its forecast is as good as the best one. If this design
    has been tried, the next one has the largest expected gain among designs whose forecast is
    within the precision; the expected gain includes the noise of the trials.

    evaluations  largest number, `before` included
    most_trials  number of trials of each of the best designs at the end
    before   evaluations of this branch so far
    shown    margins by fresh trials, of the designs that missed a limit in fresh trials
    Returns  the evaluations, sorted by number of trials (most first), then by score (best first); a
             sentence on why the search ended
    """
    tried, ending = list(before), "all evaluations were used"
    for _ in range(max(1, evaluations - FINALISTS)):
        explorer.correct_limits(evidence_of(explorer, tried, shown))
        correction = fit_correction(tried, explorer.best, EVERYWHERE)
        point = _next_for_trials(explorer, correction, tried, explorer.source.precision)
        if point is None:
            ending = explorer.ending
            break
        tried.append(try_design(point, None, correction))
        watch(tried[-1])

    def ranked(designs: Sequence[Evaluation]) -> list[Evaluation]:
        explorer.correct_limits(evidence_of(explorer, tried, shown))
        correction = fit_correction(tried, explorer.best, EVERYWHERE)
        return sorted(designs, key=lambda design: _rank_by_trials(explorer, correction, design))

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


def _rank_by_trials(
    explorer: Explorer, correction: Correction, design: Evaluation
) -> tuple[bool, float]:
    """Whether a tried design misses a limit, and its score; trials correct both."""
    point = np.array(design.coordinates)
    met = design.trials > 0 and design.margins.get("false attitudes", 0.0) >= 0
    score = explorer.forecast_of(point).score + correction(point)
    if not math.isfinite(score):
        score = design.score
    return not (met and explorer.met(point)), score


class FreshMargins(NamedTuple):
    """Margins of a design by fresh trials.

    point    coordinates in the unit cube
    margins  by name: the margin, and the number of trials
    """

    point: tuple[float, ...]
    margins: dict[str, tuple[float, int]]


def corrected_score(
    explorer: Explorer, tried: Sequence[Evaluation]
) -> Callable[[tuple[float, ...]], float]:
    """ln of the objective of any design: its forecast, corrected by trials; limits do not count."""
    correction = fit_correction(tried, explorer.best, EVERYWHERE)

    def score(coordinates: tuple[float, ...]) -> float:
        point = np.array(coordinates)
        return explorer.forecast_of(point).expected + correction(point)

    return score


def evidence_of(
    explorer: Explorer, tried: Sequence[Evaluation], shown: Sequence[FreshMargins]
) -> dict[str, list[Evidence]]:
    """Forecast and trials of each margin that has a limit, by the margin's name."""
    evidence: dict[str, list[Evidence]] = {name: [] for name in explorer.limits}
    for design in tried:
        for name in design.forecast.keys() & evidence.keys():
            point = np.array(design.coordinates)
            pair = design.forecast[name], design.margins[name]
            evidence[name].append(Evidence(point, *pair, design.trials))
    for found in shown:
        forecast = explorer.uncorrected_forecast(np.array(found.point)).margins
        for name in found.margins.keys() & evidence.keys() & forecast.keys():
            measured, trials = found.margins[name]
            pair = forecast[name], measured
            evidence[name].append(Evidence(np.array(found.point), *pair, trials))
    return evidence


def limits_of(case: Case, campaign: Campaign) -> dict[str, Limit]:
    """Limits that fresh trials of a campaign can show, for each margin that trials decide."""
    limits = dict[str, Limit]()
    for condition in campaign.judged(case):
        tail, _ = _tail_probabilities(condition)
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
    """Function that runs trials of a star tracker's designs, which takes known forecasts."""

    def try_design(point: Floats, trials: int | None, correction: Correction | None) -> Evaluation:
        known, close = explorer.forecast_of(point), explorer.near_limits(point)
        return evaluate(
            space, campaign, point, runner, trials, correction, known=known, close=close
        )

    return try_design


def _next_for_trials(
    explorer: Explorer, correction: Correction, tried: Sequence[Evaluation], precision: float
) -> Floats | None:
    """The next design for trials; None where the expected gain of each is below the precision."""

    def corrected(point: Floats) -> float:
        return explorer.forecast_of(point).score + correction(point)

    for _ in range(POLISH):
        model = explorer.emulators
        here, score = model.least(explorer.starts(), correction=correction, steps=explorer.source)
        if not _is_new(here, tried):
            break
        explorer.forecast([here])
        value = explorer.values[-1]
        # If the objective is discontinuous, the best by an emulator may be far from the true best.
        near = value.score + correction(here) <= corrected(explorer.best) + precision
        if near and not missed(value.margins):
            return here
    known = [np.array(evaluation.coordinates) for evaluation in tried]
    least = corrected(explorer.best) + precision
    rivals = [point for point in known if explorer.met(point) and corrected(point) <= least]
    if not rivals and not any((point == explorer.best).all() for point in known):
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
    """Label of the branch whose best design is the best by trials.

    The trials of a design correct its forecast, with a weight that follows from their noise.
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


def _tail_probabilities(condition: Judged, part: float = 1.0) -> tuple[float, float]:
    looks = population_of(condition).looks
    return verification.tails(looks, part * (1 - condition.needs.confidence), 1)


def confirm_requirements(
    condition: Judged,
    campaign: Campaign,
    runner: TrialRunner,
    outcomes: Rows,
    fresh: FreshTrials = FIRST_ROUND,
) -> dict[str, Confirmed]:
    """Errors that have a limit, and the availability, with bounds that confirm the requirements.

    While a requirement is undecided, the number of trials is doubled, up to three times. They have
    the campaign's fidelity, which gives the same distribution as frames in less time. The bounds
    are those of `Claim` with a tail probability of 0.05 / 4: one minus the confidence level of the
    requirements, over four looks. Therefore at most 5 % of the designs have a wrong bound at any
    look (Bonferroni). The tail probability is halved in each further round of fresh trials, so that
    all rounds of a search together have at most 10 %. Over units, the fraction of units that meet a
    limit confirms the error, in two looks.

    outcomes  outcomes of the fresh frames so far
    fresh     round of fresh trials of these outcomes
    Returns   by claim: the value over all trials, its bounds, and the margin by the bound that must
              meet the limit
    """
    units, tails = population_of(condition), _tail_probabilities(condition, fresh.part)
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
