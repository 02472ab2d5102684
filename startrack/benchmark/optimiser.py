"""The example's box on the analytic budget: how good a design so many tries find."""

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
LONG = 300  # tries of the search that the others are held against
REFUSED = 50.0  # score of a design that cannot be built, far above all others


class Hill(NamedTuple):
    """A box of variables on the unit cube, where a search begins, and the score to lessen."""

    start: Floats
    score: Callable[[Floats], float]
    prospect: Callable[[], Floats]


def hill() -> Hill:
    """The example's campaign, its designs judged without a trial."""
    design = load_design(shipped("designs/nanosatellite.toml"))
    assert design.campaign
    box, campaign = DesignSpace(design.case, design.campaign.variables), design.campaign
    score = partial(foresee, box, campaign)
    few = replace(campaign, analytic_evaluations=TRIES)
    return Hill(box.start, score, lambda: prospect(box, few, box.start).place)


def finite(score: float) -> float:
    """The score for optimisers that want a number of every place."""
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
            "sbplx": lambda: least(one.score, one.start, Search(evaluations=TRIES)).place,
        },
        lambda place: math.expm1(finite(one.score(place)) - best),
        pieces=TRIES,
    )
