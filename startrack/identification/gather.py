"""An attitude enters; what it makes of all spots and all stars of the catalogue leaves."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.identification.fit import fit
from startrack.identification.pair import pair
from startrack.identification.predict import predict, project
from startrack.identification.seen import Seen
from startrack.identification.sky import SkyGrid
from startrack.values import Floats

ROUNDS = 3  # of matching and fitting; each improves the radius of the next
REACH = 4.0  # sigma, of noise and what else the residuals show: where the matches end
NARROWEST = 1 / 8  # of the match radius

Places = NDArray[np.int64]


@njit(cache=True, error_model="numpy")
def gather(
    seen: Seen, faint: SkyGrid, magnitude: Floats, rotation: Floats, scale: float
) -> tuple[Places, Places, Floats, float]:  # pragma: no cover
    """Match all spots to the stars in the image, with the focal length and attitude they give.

    faint      all stars of the catalogue
    magnitude  (stars,) of these, in the catalogue's order
    Returns    spots in rising order, stars of the catalogue, icrs_to_camera, scale; NaN where
               too few are left for an attitude
    """
    star, place = _brightest(seen, faint, magnitude, rotation, scale)
    weight = seen.sigma**-2.0
    radius = np.maximum(seen.excess, REACH * seen.sigma)
    spot, taken, distance = pair(seen.plane, place, radius)
    for _ in range(ROUNDS):
        if len(spot) < 2:
            break
        rotation, scale = fit(
            seen.plane, weight, faint.direction, spot, star[taken], rotation, scale, seen.focal, 2
        )
        scale = min(max(scale, 1 - seen.focal), 1 + seen.focal)
        place = project(faint.direction, star, rotation, scale)
        # What the residuals show beyond the noise, along each axis: distortion, the catalogue.
        noise = np.mean(seen.sigma[spot] ** 2)
        excess = max(np.mean(distance**2) / 2 - noise, 0.0)
        for i in range(len(radius)):
            variance = seen.sigma[i] ** 2 + excess
            weight[i] = 1 / variance
            wide = max(seen.excess, REACH * seen.sigma[i])
            narrow = max(REACH * math.sqrt(variance), NARROWEST * seen.excess)
            radius[i] = min(narrow, wide)
        spot, taken, distance = pair(seen.plane, place, radius)
    if len(spot) < 2:
        return spot, spot, np.full((3, 3), np.nan), np.nan
    rotation, scale = fit(
        seen.plane, weight, faint.direction, spot, star[taken], rotation, scale, seen.focal, 2
    )
    return spot, faint.member[star[taken]].astype(np.int64), rotation, scale


@njit(cache=True, error_model="numpy")
def _brightest(
    seen: Seen, faint: SkyGrid, magnitude: Floats, rotation: Floats, scale: float
) -> tuple[Places, Floats]:  # pragma: no cover
    """The brightest stars in the image and their places, so few that chance matches are rare."""
    star = np.empty(len(faint.member), np.int64)
    place = np.empty((len(star), 2))
    count = predict(seen, faint, rotation, scale, star, place)
    star, place = star[:count], place[:count]
    most = 2 * len(seen.plane) + 50
    if count > most:
        chosen = np.argsort(magnitude[faint.member[star]])[:most]
        star, place = star[chosen], place[chosen]
    return star, place
