"""Spots and predicted stars enter; one-to-one matches leave, and the attitude that they give."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.core import Camera, Floats, Matches, Spots, quaternion
from startrack.identification.fit import fit
from startrack.identification.parameters import Identification
from startrack.identification.predict import predict, project
from startrack.identification.seen import Seen, see
from startrack.identification.sky import SkyGrid

Places = NDArray[np.int64]


@njit(cache=True, error_model="numpy")
def pair(
    plane: Floats, place: Floats, radius: Floats
) -> tuple[Places, Places, Floats]:  # pragma: no cover
    """Each star takes its nearest spot, each spot its nearest taker.

    plane    (n, 2) spots
    place    (m, 2) predicted stars
    radius   (n,) how far each spot may lie from its star
    Returns  (k,) spots in rising order, (k,) stars, (k,) distances
    """
    taker = np.full(len(plane), -1)
    nearest = radius**2
    order = np.argsort(plane[:, 0])
    x = plane[order, 0]
    widest = np.max(radius) if len(radius) else 0.0
    for j in range(len(place)):
        best, least = -1, np.inf
        for k in range(np.searchsorted(x, place[j, 0] - widest), len(x)):
            if x[k] > place[j, 0] + widest:
                break
            i = order[k]
            square = (plane[i, 0] - place[j, 0]) ** 2 + (plane[i, 1] - place[j, 1]) ** 2
            if square <= radius[i] ** 2 and square < least:
                best, least = i, square
        if best >= 0 and least <= nearest[best]:
            taker[best], nearest[best] = j, least
    spot = np.flatnonzero(taker >= 0)
    return spot, taker[spot], np.sqrt(nearest[spot])


ROUNDS = 5  # of matching and fitting, if they do not settle before
REACH = 4.0  # sigma, of noise and what else the residuals show: where the matches end
NARROWEST = 1 / 8  # of the match radius
PULL = 2.0  # sigma, from which on a residual pulls less (Cauchy's weights)


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


FOCAL_ROUNDS = (
    3  # of taking the distortion off, which is no similarity, with the focal length found
)


def refit(spots: Spots, matches: Matches, camera: Camera, settings: Identification) -> Camera:
    """What `identify` makes of the focal length, once the matches are known.

    camera    as the tracker believes it
    Raises    ValueError where the matches are not solved.
    """
    if matches.icrs_to_camera is None:
        raise ValueError(f"matches must be solved, got {matches.status}: {matches.reason}")
    if settings.focal_tolerance == 0:
        return camera
    every = np.arange(len(matches))
    rotation = matches.icrs_to_camera.as_matrix()
    for _ in range(FOCAL_ROUNDS if camera.distorted else 1):
        seen = see(spots, matches.spot, camera, settings)
        rotation, change = settle(seen, matches.direction, every, every, rotation, 1.0)
        camera = camera.scaled(change)
    return camera
