"""A box and requirements enter; a place that meets those which need no trials leaves."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.study.box import Box
from startrack.study.evaluate import missed
from startrack.study.requirements import Requirements
from startrack.study.search import least_of_all

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

    tried = list[float]()

    def score(place: Floats) -> float:
        try:
            tried.append(missed(requirements.margins(box.design(place))))
        except ValueError:
            return math.nan
        return tried[-1]

    def enough() -> str:
        return "met" if 0.0 in tried else ""

    found = least_of_all(score, box.start, PLACES, PLACES, enough)
    margins = {}
    if math.isfinite(found.score):
        margins = requirements.margins(box.design(found.place))
    return Reached(found.place, found.score, margins)
