"""Case -> number of stars, availability and error over the sky."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from startrack.budget.analytic import BLIND, of_fields
from startrack.budget.fields import boresights, fields
from startrack.catalog import Sky
from startrack.core import Floats, Refused
from startrack.design import Case

DIRECTIONS = 3072


@dataclass(frozen=True, eq=False)
class Survey:
    """Stars, availability and error in m directions that lie evenly over the sky.

    direction      (m, 3) unit vectors of the boresight, ICRS axes
    stars          (m,) 1, expected number of detected stars
    solved         (m,) 1, probability that they are enough for an attitude
    across, about  (m,) radian, rms error across (per axis) and about the boresight; NaN where
                   there is no attitude
    """

    direction: Floats
    stars: Floats
    solved: Floats
    across: Floats
    about: Floats

    def fraction(self, stars: float) -> float:
        """Fraction of the sky with at least so many stars."""
        return float((self.stars >= stars - 0.5).mean())


def survey(case: Case, places: int = DIRECTIONS) -> Survey:
    """The analytic budget in each direction. Raises and accuracy as `analytic`."""
    view = fields(case.catalog, case.instrument.camera, boresights, places)
    solved = of_fields(case, view)
    if solved is None:
        raise Refused(BLIND)
    found, law = solved.attitudes, solved.budget.whole.spread
    square = np.where(found.solved[:, None] > 0, law.mean**2 + law.sigma**2, np.nan)
    return Survey(
        view.attitude.inv().apply([0.0, 0.0, 1.0]),
        found.stars,
        found.solved,
        np.sqrt(square[:, :2].mean(axis=1)),
        np.sqrt(square[:, 2]),
    )


def circles(sky: Sky, radius: float, places: int = DIRECTIONS) -> Floats:
    """Number of stars (m,) in circles that lie evenly over the sky.

    radius  radian
    """
    direction = boresights(places).inv().apply([0.0, 0.0, 1.0])
    return np.array([len(one) for one in sky.cones(direction, radius)])
