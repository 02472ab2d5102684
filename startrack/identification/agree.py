"""Spots, the stars of the image and a rough attitude enter; the matches that agree leave.

Matching and fitting take turns. The first attitude is a few pixels off, so that a false spot may
stand in for a star and hold the fit in a place where half of the stars are missed. Residuals
larger than those of most therefore pull less and less, and matches end where they do.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.identification.fit import fit
from startrack.identification.pair import pair
from startrack.identification.predict import project
from startrack.identification.seen import Seen
from startrack.values import Floats

ROUNDS = 5  # of matching and fitting, if they do not settle before
REACH = 4.0  # sigma, of noise and what else the residuals show: where the matches end
NARROWEST = 1 / 8  # of the match radius
PULL = 2.0  # sigma, from which on a residual pulls less (Cauchy's weights)

Places = NDArray[np.int64]


class Agreed(NamedTuple):
    """Matches and the attitude at which they agree; NaN where they leave it open.

    spot      (k,) places in `seen`, in rising order
    taken     (k,) places in `star`
    distance  (k,) between the two, in the plane
    rotation  (3, 3) icrs_to_camera
    scale     true over believed focal length
    """

    spot: Places
    taken: Places
    distance: Floats
    rotation: Floats
    scale: float


@njit(cache=True, error_model="numpy")
def agree(
    seen: Seen,
    direction: Floats,
    star: Places,
    place: Floats,
    rotation: Floats,
    scale: float,
    reach: float,
    fewest: int,
    without: int = -1,
) -> Agreed:  # pragma: no cover
    """Match and fit until nothing changes.

    star     (m,) places in `direction` of the stars that the image should hold
    place    (m, 2) where these are expected, at the attitude and scale to start from
    reach    1, match radius of the first round
    fewest   fewer matches are not worth to go on
    without  which of the first matches to leave out of the first fit, -1 for none
    """
    widest = np.maximum(seen.radius, REACH * seen.sigma)
    variance = seen.sigma**2
    spot, taken, distance = pair(seen.plane, place, np.full(len(variance), reach))
    weight = 1 / variance
    if 0 <= without < len(spot):
        weight[spot[without]] = 0.0
    for turn in range(ROUNDS):
        if len(spot) < fewest:
            break
        before = spot
        rotation, scale = fit(
            seen.plane, weight, direction, spot, star[taken], rotation, scale, seen.focal, 2
        )
        place = project(direction, star, rotation, scale)
        variance = seen.sigma**2 + _excess(seen, spot, taken, place)
        radius = np.maximum(REACH * np.sqrt(variance), NARROWEST * seen.excess)
        spot, taken, distance = pair(seen.plane, place, np.minimum(radius, widest))
        weight = 1 / variance
        weight[spot] /= 1 + distance**2 / (PULL**2 * variance[spot])
        if turn > 1 and len(spot) == len(before) and (spot == before).all():
            break
    if len(spot) >= fewest:
        rotation, scale = settle(seen, direction, spot, star[taken], rotation, scale)
    return Agreed(spot, taken, distance, rotation, scale)


@njit(cache=True, error_model="numpy")
def settle(
    seen: Seen, direction: Floats, spot: Places, star: Places, rotation: Floats, scale: float
) -> tuple[Floats, float]:  # pragma: no cover
    """Attitude and scale of given matches, each weighed by its noise and what all show beyond it.

    direction   (m, 3) unit vectors of stars, ICRS axes
    spot, star  (k,) which spot is which star
    rotation    (3, 3) icrs_to_camera to start from, as scale
    """
    variance = seen.sigma**2
    for _ in range(2):
        rotation, scale = fit(
            seen.plane, 1 / variance, direction, spot, star, rotation, scale, seen.focal, 3
        )
        place = project(direction, star, rotation, scale)
        variance = seen.sigma**2 + _excess(seen, spot, np.arange(len(spot)), place)
    return rotation, scale


@njit(cache=True, error_model="numpy")
def _excess(seen: Seen, spot: Places, taken: Places, place: Floats) -> float:  # pragma: no cover
    """Variance along each axis that the matches have beyond their noise: distortion, catalogue.

    From the median, which few wrong matches do not move; that of the square of a Gaussian in two
    dimensions is 2 ln 2 of its variance. The fit has taken up some of it.
    """
    square = np.empty(len(spot))
    for i in range(len(spot)):
        x, y = seen.plane[spot[i]] - place[taken[i]]
        square[i] = x * x + y * y
    unknowns = 4 if seen.focal > 0 else 3
    left = max(2 * len(spot) - unknowns, 1) / (2 * len(spot))
    noise = np.median(seen.sigma[spot] ** 2)
    return max(np.median(square) / (2 * math.log(2) * left) - noise, 0.0)
