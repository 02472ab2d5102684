"""A box enters; the place where the analytic budget alone is best leaves, to begin a search at."""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import NDArray

from startrack.study.box import Box
from startrack.study.campaign import Campaign
from startrack.study.evaluate import foresee
from startrack.study.search import Found, least_of_all

SHARE = 0.6  # of the places are spread over the whole box, the rest around the best of them

Floats = NDArray[np.float64]


def prospect(box: Box, campaign: Campaign, start: Floats) -> Found:
    """Look over the whole box by DIRECT, then nearer by Sbplx, without a trial.

    Errors  model: that of `foresee`; the place is one to begin at, never one to end with.
    """

    def score(place: Floats) -> float:
        return foresee(box, campaign, place)

    near = max(1, int((1 - SHARE) * campaign.prospects))
    return least_of_all(score, start, ceil(SHARE * campaign.prospects), near)
