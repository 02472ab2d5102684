"""How often something rare befalls trials, by looking more often where it is likelier."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.core import Floats, Streams
from startrack.montecarlo.attitudes import Regions, towards
from startrack.montecarlo.estimate import Mean, plain

DEFENCE = 0.2  # fraction of the trials that look anywhere, so that no weight exceeds 5


def chances(score: Floats) -> Floats:
    """With what probability trials look into each region.

    A defensive mixture: some look anywhere, the others in proportion to the scores.

        q_k = d / K + (1 - d) s_k / sum s

    Source: Hesterberg (1995), Technometrics 37(2), 185.

    score    (K,) not negative: how likely the event seems there; any will do, a good one does more
    Returns  (K,) 1, sums to 1
    """
    total = float(score.sum())
    if not (np.isfinite(score).all() and (score >= 0).all() and total > 0):
        raise ValueError("score must be finite, not negative, and somewhere positive")
    return np.asarray(DEFENCE / len(score) + (1 - DEFENCE) * score / total)


def where_likely(
    seed: int, numbers: Sequence[int], regions: Regions, chance: Floats
) -> tuple[Rotation, Floats]:
    """Attitudes icrs_to_camera that look more often where `chance` is larger, and their weights.

    Returns  attitudes; (n,) 1, true over drawn density. The mean of weight times indicator is the
             probability of the event, whatever the chances were.
    """
    fraction = np.array([Streams(seed, number)("rare").random(4) for number in numbers])
    cell = np.searchsorted(np.cumsum(chance)[:-1], fraction[:, 0], side="right")
    boresight = regions.place(cell, fraction[:, 1:3])
    return towards(boresight, 2 * math.pi * fraction[:, 3]), 1 / (len(regions) * chance[cell])


def probability(happened: NDArray[np.bool_], weight: Floats) -> Mean:
    """Probability of the event with its error, from trials with weights."""
    return plain(happened * weight)
