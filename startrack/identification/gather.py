"""An attitude enters; what it makes of all spots and all stars of the catalogue leaves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.identification.agree import REACH, agree
from startrack.identification.predict import predict
from startrack.identification.seen import Seen
from startrack.identification.sky import SkyGrid
from startrack.turns import quaternion
from startrack.values import Floats

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
    reach = max(seen.excess, REACH * float(np.median(seen.sigma)))
    found = agree(seen, faint.direction, star, place, rotation, scale, reach, 2)
    matched = star[found.taken]
    return Gathered(
        found.spot,
        faint.member[matched].astype(np.int64),
        faint.direction[matched],
        found.rotation,
        quaternion(found.rotation),
        min(max(found.scale, 1 - seen.focal), 1 + seen.focal),
    )


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
