"""An attitude enters; what it makes of all spots and all stars of the catalogue leaves."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.identification.fit import fit, quaternion
from startrack.identification.pair import pair
from startrack.identification.predict import predict, project
from startrack.identification.seen import Seen
from startrack.identification.sky import SkyGrid
from startrack.values import Floats

ROUNDS = 3  # of matching and fitting; each improves the radius of the next
REACH = 4.0  # sigma, of noise and what else the residuals show: where the matches end
NARROWEST = 1 / 8  # of the match radius

Places = NDArray[np.int64]


class Gathered(NamedTuple):
    """All matches and what they say of the camera; NaN where they leave the attitude open.

    spot        (k,) in rising order
    star        (k,) of the catalogue
    direction   (k, 3) of these, ICRS axes
    rotation    (3, 3) icrs_to_camera
    quaternion  (4,) the same, scalar last
    scale       true over believed focal length
    """

    spot: Places
    star: Places
    direction: Floats
    rotation: Floats
    quaternion: Floats
    scale: float


@njit(cache=True, error_model="numpy")
def gather(
    seen: Seen, faint: SkyGrid, magnitude: Floats, rotation: Floats, scale: float
) -> Gathered:  # pragma: no cover
    """Match all spots to the stars in the image, with the focal length and attitude they give.

    faint      all stars of the catalogue
    magnitude  (stars,) of these, in the catalogue's order
    """
    star, place = _brightest(seen, faint, magnitude, rotation, scale)
    weight = seen.sigma**-2.0
    radius = np.maximum(seen.excess, REACH * seen.sigma)
    spot, taken, distance = pair(seen.plane, place, radius)
    for _ in range(ROUNDS):
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
    rotation, scale = fit(
        seen.plane, weight, faint.direction, spot, star[taken], rotation, scale, seen.focal, 2
    )
    matched = star[taken]
    names = faint.member[matched].astype(np.int64)
    return Gathered(spot, names, faint.direction[matched], rotation, quaternion(rotation), scale)


@njit(cache=True, error_model="numpy")
def _brightest(
    seen: Seen, faint: SkyGrid, magnitude: Floats, rotation: Floats, scale: float
) -> tuple[Places, Floats]:  # pragma: no cover
    """The brightest stars in the image and their places, so few that chance matches are rare."""
    star, place = predict(seen, faint, rotation, scale)
    most = 2 * len(seen.plane) + 50
    if len(star) > most:
        chosen = np.argsort(magnitude[faint.member[star]])[:most]
        star, place = star[chosen], place[chosen]
    return star, place
