"""nlopt on the Monte Carlo of the whole chain."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

import nlopt
import numpy as np
from numpy.typing import NDArray

from startrack.case import Case
from startrack.error import Interval, Summary, summarise
from startrack.study.box import Box
from startrack.study.campaign import Campaign
from startrack.study.montecarlo import run

FRESH = 10**6  # first trial of the fresh ones: no tuning reaches it
PENALTY = 10.0  # ln(error) that a margin missed by its full size costs
LOST = 20.0  # ln(arcsec) of a design that no trial solves
FIRST_STEP = 0.15  # of each range
RESAMPLES = 4000

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Evaluation:
    """One design that was tried.

    place    in the unit cube
    values   of the variables, SI
    score    what nlopt minimises: ln(rms / arcsec) plus penalties
    margins  of the requirements, availability with them; below 0, not met
    summary  of the trials, None where the requirements alone refuse the design
    note     why it was refused, or empty
    """

    place: tuple[float, ...]
    values: dict[str, float]
    score: float
    margins: dict[str, float]
    summary: Summary | None
    note: str

    @property
    def feasible(self) -> bool:
        """Whether every requirement is met."""
        return self.summary is not None and all(m >= 0 for m in self.margins.values())

    def rms(self, objective: str) -> float:
        """Radian, the rms error across or about the boresight; NaN where no trial was solved."""
        return math.nan if self.summary is None else getattr(self.summary, objective).value


@dataclass(frozen=True)
class Optimum:
    """How an optimisation ended.

    start, best  designs
    evaluations  all that were tried, in order
    fresh        summaries of start and best on trials that neither was tuned on
    factor       rms error of the start over that of the best, on these trials
    promised     radian, rms error of the best on the trials that it was tuned on
    feasible     whether the best met every requirement there
    ending       one sentence: why nlopt stopped
    """

    start: Case
    best: Case
    evaluations: tuple[Evaluation, ...]
    fresh: tuple[Summary, Summary]
    factor: Interval
    promised: float
    feasible: bool
    ending: str


def evaluate(
    box: Box, campaign: Campaign, place: Floats, seed: int, executor: Executor, workers: int
) -> Evaluation:
    """Score a design on the campaign's trials: the same skies and streams for every design."""
    place = np.clip(place, 0, 1)
    values = box.values(place)
    try:
        case = box.design(place)
        margins = campaign.requirements.margins(case)
        outcomes = run(case, campaign.trials, seed, executor, workers=workers)
    except ValueError as error:  # a design that cannot be built is a bad one, not the end
        return Evaluation(tuple(place), values, LOST + PENALTY, {}, None, str(error))
    summary = summarise(outcomes)
    margins["availability"] = summary.availability.value - campaign.requirements.min_availability
    margins["false attitudes"] = -summary.false.value
    rms = getattr(summary, campaign.objective).value
    score = math.log(np.degrees(rms) * 3600) if rms > 0 else LOST
    score += PENALTY * sum(max(0.0, -margin) for margin in margins.values())
    return Evaluation(tuple(place), values, score, margins, summary, "")


def optimize(
    case: Case,
    campaign: Campaign,
    seed: int,
    executor: Executor,
    workers: int = 1,
    watch: Callable[[Evaluation], None] | None = None,
    watch_fresh: Callable[[int], None] | None = None,
) -> Optimum:
    """Search the box with Sbplx (Rowan 1990, in nlopt), requirements as L1 penalties.

    Every design sees the same skies and the same streams of noise, so that differences between
    designs are larger than their noise. The winner is judged on fresh trials.

    watch        called with each evaluation
    watch_fresh  called with the number of fresh trials just done
    Errors       ValueError where the campaign names no variables.
                 model: a local search; nothing says that no better design lies elsewhere.
    """
    box = Box(case, campaign.variables)
    evaluations: list[Evaluation] = []

    def objective(place: Floats, _gradient: Floats) -> float:
        # nlopt hands over one buffer that it uses again.
        done = evaluate(box, campaign, np.array(place), seed, executor, workers)
        evaluations.append(done)
        if watch:
            watch(done)
        return done.score

    search = nlopt.opt(nlopt.LN_SBPLX, len(box))
    search.set_min_objective(objective)
    search.set_lower_bounds(np.zeros(len(box)))
    search.set_upper_bounds(np.ones(len(box)))
    search.set_initial_step(np.where(box.start + FIRST_STEP <= 1, FIRST_STEP, -FIRST_STEP))
    search.set_xtol_abs(np.full(len(box), 2e-3))
    search.set_maxeval(campaign.evaluations)
    try:
        search.optimize(box.start)
        ending = {
            nlopt.MAXEVAL_REACHED: "all evaluations were used",
            nlopt.XTOL_REACHED: "the steps became too small to matter",
        }.get(search.last_optimize_result(), "nlopt was content")
    except nlopt.RoundoffLimited:
        ending = "rounding errors stopped nlopt; its best design is kept"
    except RuntimeError as error:
        # nlopt's own failures have no class of their own; those of a worker have, and go on.
        if type(error) is not RuntimeError or not evaluations:
            raise
        ending = f"nlopt failed ({error}); its best design is kept"
    # The best that was seen, whatever nlopt returns: a feasible one where there is any.
    best = min(evaluations, key=lambda one: (not one.feasible, one.score))
    winner = box.design(np.array(best.place))
    fresh = [
        run(one, campaign.fresh_trials, seed, executor, FRESH, workers, watch_fresh)
        for one in (case, winner)
    ]
    return Optimum(
        case,
        winner,
        tuple(evaluations),
        (summarise(fresh[0]), summarise(fresh[1])),
        improvement(fresh[0], fresh[1], campaign.objective, seed),
        best.rms(campaign.objective),
        best.feasible,
        ending,
    )


def improvement(
    start: NDArray[np.void], best: NDArray[np.void], objective: str, seed: int
) -> Interval:
    """Ratio of the rms errors of two designs on the same skies, with its 95 % interval.

    Trials are resampled in pairs (bootstrap percentiles); one that a design did not solve
    counts for the other design alone.
    """
    squares = [_squares(one, objective) for one in (start, best)]
    if not all(np.isfinite(one).any() for one in squares):
        return Interval(math.nan, math.nan, math.nan)
    rng = np.random.default_rng(np.random.SeedSequence((seed, FRESH)))
    chosen = rng.integers(0, len(start), (RESAMPLES, len(start)))
    ratio = np.sqrt(np.nanmean(squares[0][chosen], 1) / np.nanmean(squares[1][chosen], 1))
    low, high = np.nanquantile(ratio, [0.025, 0.975])
    whole = math.sqrt(np.nanmean(squares[0]) / np.nanmean(squares[1]))
    return Interval(whole, float(low), float(high))


def _squares(outcomes: NDArray[np.void], objective: str) -> Floats:
    """Squared error of each trial, NaN where there is no right attitude."""
    if objective == "across":
        squares = (outcomes["error_x"] ** 2 + outcomes["error_y"] ** 2) / 2
    else:
        squares = outcomes["error_z"] ** 2
    return np.where(outcomes["solved"] & ~outcomes["false"], squares, np.nan)
