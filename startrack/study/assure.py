"""Fresh outcomes of a design enter; its availability, and a bound that holds, leave."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from startrack.case import Case
from startrack.error import Interval, share_interval
from startrack.study.bench import FRESH, Bench
from startrack.study.campaign import Campaign

LOOKS = 4  # at 1, 2, 4 and 8 times the fresh trials
WRONG = 0.05  # probability that any of these looks finds a bound that does not hold


def availability(
    case: Case, campaign: Campaign, bench: Bench, outcomes: NDArray[np.void]
) -> Interval:
    """The share of trials with a right attitude, known as well as the requirement asks.

    Where the interval holds the required share, the trials are doubled, up to three times, with
    the campaign's own fidelity, for it has the law of frames at a tenth of their time. Each bound
    is one of Clopper and Pearson (1934) with a tail of 0.05 / 4, so that it is wrong at most once
    in twenty designs, however many looks there were (Bonferroni).

    outcomes  of the fresh frames that are there already
    Returns   the share of all that were tried, and its bounds
    """
    tried, hits = len(outcomes), _right(outcomes)
    asked = campaign.requirements.min_availability
    first = FRESH + tried  # the same numbers would be the same skies
    for look in range(LOOKS):
        share = share_interval(hits, tried, 1 - 2 * WRONG / LOOKS)
        if not tried or not share.low < asked <= share.high or look == LOOKS - 1:
            break
        more = bench.run(case, tried, campaign.fidelity, first)
        first, tried, hits = first + tried, 2 * tried, hits + _right(more)
    return share


def _right(outcomes: NDArray[np.void]) -> int:
    return int((outcomes["solved"] & ~outcomes["false"]).sum())
