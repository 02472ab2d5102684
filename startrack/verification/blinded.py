"""Outcomes of trials -> those that count, without those blinded by Sun, Moon or Earth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats
from startrack.design import Case, Requirements
from startrack.montecarlo import at_random
from startrack.scene import BODIES, body_angles


def boresights(seed: int, outcomes: NDArray[np.void]) -> Floats:
    """(n, 3) directions of the boresights of the trials of a seed, ICRS axes."""
    if not len(outcomes):
        return np.empty((0, 3))
    return at_random(seed, outcomes["trial"].tolist()).inv().apply([0.0, 0.0, 1.0])


def counted(
    needs: Requirements, case: Case, seed: int, outcomes: NDArray[np.void]
) -> NDArray[np.void]:
    """The outcomes that count in errors and availability.

    All; or, where blinded trials are left out, those in which no light of the scene among Sun, Moon
    and Earth is nearer to the boresight than its keep-out angle.

    seed  of the trials, which have random attitudes
    """
    limits = {
        name: angle
        for name, angle in needs.min_keep_out.angles.items()
        if name in case.scene.lights
    }
    if needs.blinded == "counted" or not limits:
        return outcomes
    numbers = outcomes["trial"].tolist()
    angles = body_angles(case.scene, seed, numbers, boresights(seed, outcomes))
    kept = np.ones(len(outcomes), bool)
    for name, angle in limits.items():
        kept &= angles[:, BODIES.index(name)] >= angle
    return outcomes[kept]
