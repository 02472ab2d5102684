"""The example's design space on the analytic budget: the best score within a number of tries."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from startrack.benchmark.stage import Stage
from startrack.core import Floats
from startrack.design import DesignSpace, load_design
from startrack.io import shipped
from startrack.optimise import Search, foresee, least, prospect

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
    few = replace(campaign, analytic_evaluations=TRIES)
    return Hill(space.start, score, lambda: prospect(space, few, space.start).coordinates)


def finite(score: float) -> float:
    """The score for optimisers that need a finite number everywhere."""
    return score if math.isfinite(score) else REFUSED


def optimiser() -> Stage:
    """Answers are unit-cube coordinates."""
    one = hill()
    best = least(one.score, one.prospect(), Search(evaluations=LONG, last_step=1e-5)).score
    return Stage(
        "optimiser",
        f"a search of the example's box on the analytic budget with {TRIES} tries",
        "error of the design that it finds, over that of a search three times as long, less one",
        {
            "prospect": one.prospect,
            "sbplx": lambda: least(one.score, one.start, Search(evaluations=TRIES)).coordinates,
        },
        lambda coordinates: math.expm1(finite(one.score(coordinates)) - best),
        pieces=TRIES,
    )
