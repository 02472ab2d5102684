"""A box and requirements enter; a place that meets those which need no trials leaves."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.study.box import Box
from startrack.study.evaluate import missed
from startrack.study.requirements import Requirements
from startrack.study.search import Algorithm, Search, least

PLACES = 120  # that are asked over the whole box, and again around the best of them

Floats = NDArray[np.float64]


class Reached(NamedTuple):
    """The place that comes nearest to the requirements.

    place    in the unit cube; the start where that meets them all
    short    1, by how much their margins are missed there; 0 where none is
    margins  there
    """

    place: Floats
    short: float
    margins: dict[str, float]


def reach(box: Box, requirements: Requirements) -> Reached:
    """Look for a design that meets mass, power and all else that needs no trials.

    Errors  model: a search; a corner that meets them may be missed where it is smaller than a
            part in 120 of the box.
    """

    def short(place: Floats) -> float:
        try:
            return missed(requirements.margins(box.design(place)))
        except ValueError:
            return math.nan

    def enough() -> str:
        return "met" if best == 0 else ""

    best = math.inf

    def score(place: Floats) -> float:
        nonlocal best
        value = short(place)
        best = min(best, value) if math.isfinite(value) else best
        return value

    found = least(score, box.start, Search(evaluations=1), enough)
    if best > 0:
        found = least(score, box.start, Search(Algorithm.DIRECT, PLACES), enough)
    if best > 0:
        found = least(score, found.place, Search(evaluations=PLACES), enough)
    margins = {}
    if math.isfinite(found.score):
        margins = requirements.margins(box.design(found.place))
    return Reached(found.place, found.score, margins)
