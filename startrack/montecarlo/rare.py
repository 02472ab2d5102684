"""Probability of a rare event, with more trials where it is likelier."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.core import Floats, Refused, Streams
from startrack.montecarlo.attitudes import Regions, towards
from startrack.montecarlo.estimate import Mean, plain

DEFENCE = 0.2  # fraction of the trials in all regions alike, so that no weight exceeds 5


def chances(score: Floats) -> Floats:
    """Probability of trials in each region.

    A defensive mixture: a part uniform, the others in proportion to the scores.

        q_k = d / K + (1 - d) s_k / sum s

    Source: Hesterberg (1995), Technometrics 37(2), 185.

    score    (K,) not negative, rough likelihood of the event there; any is valid, a good one
             reduces the variance
    Returns  (K,) 1, sums to 1
    """
    total = float(score.sum())
    if not (np.isfinite(score).all() and (score >= 0).all() and total > 0):
        raise Refused("score must be finite, not negative, and somewhere positive")
    return np.asarray(DEFENCE / len(score) + (1 - DEFENCE) * score / total)


def where_likely(
    seed: int, numbers: Sequence[int], regions: Regions, chance: Floats
) -> tuple[Rotation, Floats]:
    """Attitudes icrs_to_camera, more of them where `chance` is larger, and their weights.

    Returns  attitudes; (n,) 1, uniform density over that drawn from. The mean of weight times
             indicator is the probability of the event, for any chances.
    """
    fraction = np.array([Streams(seed, number)("rare").random(4) for number in numbers])
    cell = np.searchsorted(np.cumsum(chance)[:-1], fraction[:, 0], side="right")
    boresight = regions.place(cell, fraction[:, 1:3])
    return towards(boresight, 2 * math.pi * fraction[:, 3]), 1 / (len(regions) * chance[cell])


def probability(happened: NDArray[np.bool_], weight: Floats) -> Mean:
    """Probability of the event with its error, from trials with weights."""
    return plain(happened * weight)
