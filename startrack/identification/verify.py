"""A hypothesis from four stars enters; how many spots it explains, and how well, leaves."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.identification.chance import log_chance
from startrack.identification.code import separation
from startrack.identification.fit import align, fit, turned
from startrack.identification.sky import SkyGrid, cone
from startrack.values import Floats

FIRST_RADIUS = 2.0  # times the match radius: four stars predict the rest less well than all do
RADII = 4  # each half the one before: good centroids earn a sharper test, and need not be believed
DEPTHS = (10, 20, 40)  # stars per field that may be seen: so may few and bright ones
LOG_TESTS = math.log(RADII * len(DEPTHS))


class Seen(NamedTuple):
    """The spots that vote, as the believed camera sees them.

    plane           (n, 2) x / z and y / z
    direction       (n, 3) unit vectors, camera axes
    sigma           (n,) radian, of the centroids
    low, high       (2,) x / z and y / z of the corners of the image
    corner          radian, from the boresight to the farthest corner
    radius          1, match radius in the plane
    disc            1, its area over that of the image
    focal           relative, tolerance of the focal length
    log_hypotheses  ln of how many hypotheses there are
    """

    plane: Floats
    direction: Floats
    sigma: Floats
    low: Floats
    high: Floats
    corner: float
    radius: float
    disc: float
    focal: float
    log_hypotheses: float


@njit(cache=True, error_model="numpy")
def verify(
    seen: Seen,
    spots: NDArray[np.int64],
    sky: SkyGrid,
    rank: NDArray[np.int16],
    four: NDArray[np.int64],
    fewest: int,
) -> tuple[Floats, float, int, float]:  # pragma: no cover
    """Fit a hypothesis, predict the stars of the image, match them to spots, fit again.

    spots    (4,) places in `seen`
    sky      the stars that vote
    rank     (n,) of these among their neighbours
    four     (4,) places in `sky`
    fewest   matches that are worth the test
    Returns  icrs_to_camera, scale, matches, ln of the chance bound (0 where there is no match)
    """
    nothing = (np.eye(3), 1.0, 0, 0.0)
    free = seen.focal > 0
    farthest = seen.focal + seen.radius / seen.corner  # the second term is what noise can do
    a, b = sky.direction[four[0]], sky.direction[four[1]]
    u, v = seen.direction[spots[0]], seen.direction[spots[1]]
    rotation = align(a, b, u, v)
    scale = separation(u, v) / separation(a, b) if free else 1.0
    rotation, scale = fit(seen.plane, sky.direction, spots, four, rotation, scale, free, 2)
    if not abs(scale - 1) <= 2 * farthest:
        return nothing

    star, place = predict(seen, sky, rotation, scale)
    if len(star) < fewest:
        return nothing
    radius = FIRST_RADIUS * seen.radius
    matched_spot, matched_star, distance = pair(seen.plane, place, radius)
    for _ in range(2):
        if len(matched_spot) < fewest:
            return nothing
        rotation, scale = fit(
            seen.plane, sky.direction, matched_spot, star[matched_star], rotation, scale, free, 2
        )
        if not abs(scale - 1) <= farthest:
            return nothing
        place = project(sky.direction, star, rotation, scale)
        matched_spot, matched_star, distance = pair(seen.plane, place, seen.radius)

    best, matches = 0.0, 0
    star_rank, matched_rank = rank[star], rank[star[matched_star]]
    for depth in DEPTHS:
        expected = int(np.sum(star_rank < depth))
        for halving in range(RADII):
            inside = int(np.sum((distance <= seen.radius / 2**halving) & (matched_rank < depth)))
            if inside < fewest:
                break
            disc = seen.disc / 4**halving
            log_p = LOG_TESTS + log_chance(
                inside, len(seen.plane), expected, disc, seen.log_hypotheses
            )
            if log_p < best:
                best, matches = log_p, inside
    return rotation, scale, matches, best


@njit(cache=True, error_model="numpy")
def predict(
    seen: Seen, sky: SkyGrid, rotation: Floats, scale: float
) -> tuple[NDArray[np.int64], Floats]:  # pragma: no cover
    """Which stars (m,) the image should hold, and where (m, 2) in the plane."""
    near = cone(sky, rotation[2], 1.02 * seen.corner / min(scale, 1.0))
    star = np.empty(len(near), np.int64)
    place = np.empty((len(near), 2))
    count = 0
    for s in near:
        x, y, z = turned(rotation, sky.direction[s])
        if z <= 0:
            continue
        x, y = scale * x / z, scale * y / z
        if seen.low[0] <= x <= seen.high[0] and seen.low[1] <= y <= seen.high[1]:
            star[count] = s
            place[count] = x, y
            count += 1
    return star[:count], place[:count]


@njit(cache=True, error_model="numpy")
def project(
    direction: Floats, star: NDArray[np.int64], rotation: Floats, scale: float
) -> Floats:  # pragma: no cover
    """Where (m, 2) the chosen stars fall in the plane."""
    place = np.empty((len(star), 2))
    for i in range(len(star)):
        x, y, z = turned(rotation, direction[star[i]])
        place[i] = scale * x / z, scale * y / z
    return place


@njit(cache=True, error_model="numpy")
def pair(
    plane: Floats, place: Floats, radius: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:  # pragma: no cover
    """One-to-one matches: each star takes its nearest spot, each spot its nearest taker.

    plane    (n, 2) spots
    place    (m, 2) predicted stars
    Returns  (k,) spots in rising order, (k,) stars, (k,) distances up to the radius
    """
    taker = np.full(len(plane), -1)
    nearest = np.full(len(plane), radius * radius)
    for j in range(len(place)):
        best, square = -1, radius * radius
        for i in range(len(plane)):
            dx = plane[i, 0] - place[j, 0]
            if dx * dx <= square:
                d = dx * dx + (plane[i, 1] - place[j, 1]) ** 2
                if d <= square:
                    best, square = i, d
        if best >= 0 and square <= nearest[best]:
            taker[best], nearest[best] = j, square
    spot = np.flatnonzero(taker >= 0)
    return spot, taker[spot], np.sqrt(nearest[spot])
