"""Whole trials on real skies, and a search of a design space on the analytic budget."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from startrack.benchmark.stage import BenchmarkStage
from startrack.core import Floats, arcsec, deg
from startrack.design import Case, DesignSpace, Fidelity, load_design
from startrack.io import shipped
from startrack.optimise import Explorer, Search, TrackerSource, foresee, minimise
from startrack.trial import run_trials

SEED, TRIALS, SIDE = 5, 32, 1024
FALSE = 0.5 * deg  # an attitude with a larger error is not counted


def example() -> Case:
    """The shipped design, with the number of pixels of the peers' examples."""
    return sized(load_design(shipped("designs/noise_only.toml")).case, SIDE)


def sized(case: Case, pixels: int) -> Case:
    """The same field and lens on another number of pixels a side."""
    instrument = case.instrument
    detector = instrument.detector
    pitch = detector.pixel_pitch * detector.columns / pixels
    detector = replace(detector, columns=pixels, rows=pixels, pixel_pitch=pitch)
    return replace(case, instrument=replace(instrument, detector=detector))


def montecarlo() -> BenchmarkStage:
    """All fidelities on the same skies; answers are angles across the boresight, radian."""
    case = example()

    def angles(fidelity: Fidelity) -> Floats:
        outcomes = run_trials(case, SEED, range(TRIALS), fidelity)
        return np.where(
            outcomes["solved"], np.hypot(outcomes["error_x"], outcomes["error_y"]), np.nan
        )

    def judge(angle: Floats) -> float:
        correct = angle[np.isfinite(angle) & (angle < FALSE)]
        return float(np.sqrt(np.mean(correct**2) / 2)) / arcsec if len(correct) else math.nan

    return BenchmarkStage(
        "montecarlo",
        f"a trial of the example on {SIDE} x {SIDE} pixels: render, detect, identify, solve, judge",
        f"rms per axis across the boresight of {TRIALS} trials, arcsec",
        {fidelity.value: partial(angles, fidelity) for fidelity in Fidelity},
        judge,
        pieces=TRIALS,
    )


TRIES = 100
LONG = 300  # tries of the reference search
REFUSED = 50.0  # score of a design that cannot be built, far above all others


class Hill(NamedTuple):
    """The start of a search in the unit cube, and the score to minimise."""

    start: Floats
    score: Callable[[Floats], float]
    prospect: Callable[[], Floats]


def hill() -> Hill:
    """The example's campaign, its designs judged without a trial."""
    design = load_design(shipped("designs/noise_only.toml"))
    assert design.campaign
    space, campaign = DesignSpace(design.case, design.campaign.variables), design.campaign
    score = partial(foresee, space, campaign)
    return Hill(
        space.start, score, lambda: explored(Explorer(TrackerSource(space, campaign)), space.start)
    )


def explored(explorer: Explorer, start: Floats) -> Floats:
    """The best of a number of forecasts; fewer, if these suffice."""
    explorer.begin(start, TRIES)
    while not explorer.ending and len(explorer.points) < TRIES:
        explorer.step(TRIES - len(explorer.points))
    return explorer.best


def finite(score: float) -> float:
    """The score for optimisers that need a finite number everywhere."""
    return score if math.isfinite(score) else REFUSED


def optimiser() -> BenchmarkStage:
    """Answers are unit-cube coordinates."""
    search = hill()
    best = minimise(search.score, search.prospect(), Search(evaluations=LONG, last_step=1e-5)).score
    return BenchmarkStage(
        "optimiser",
        f"a search of the example's box on the analytic budget with {TRIES} tries",
        "error of the design that it finds, over that of a search three times as long, less one",
        {
            "prospect": search.prospect,
            "sbplx": lambda: (
                minimise(search.score, search.start, Search(evaluations=TRIES)).coordinates
            ),
        },
        lambda coordinates: math.expm1(finite(search.score(coordinates)) - best),
        pieces=TRIES,
    )
