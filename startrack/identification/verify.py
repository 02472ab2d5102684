"""A hypothesis from four stars enters; how many spots it explains, and how well, leaves."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.identification.code import separation
from startrack.identification.evidence import LOG_ATTITUDES, log_evidence
from startrack.identification.fit import align, derivatives, fit, turned
from startrack.identification.sky import SkyGrid, cone
from startrack.values import Floats

FIRST_RADIUS = 2.0  # times the match radius: four stars predict the rest less well than all do


class Seen(NamedTuple):
    """The spots that vote, as the believed camera sees them.

    plane      (n, 2) x / z and y / z
    direction  (n, 3) unit vectors, camera axes
    sigma      (n,) radian, of the centroids
    low, high  (2,) x / z and y / z of the corners of the image
    corner     radian, from the boresight to the farthest corner
    radius     1, match radius in the plane
    area       1, of the image in the plane
    focal      relative, tolerance of the focal length
    """

    plane: Floats
    direction: Floats
    sigma: Floats
    low: Floats
    high: Floats
    corner: float
    radius: float
    area: float
    focal: float


@njit(cache=True, error_model="numpy")
def verify(
    seen: Seen,
    spots: NDArray[np.int64],
    sky: SkyGrid,
    magnitude: Floats,
    four: NDArray[np.int64],
    fewest: int,
) -> tuple[Floats, float, int, float]:  # pragma: no cover
    """Fit a hypothesis, predict the stars of the image, match them to spots, fit again.

    spots    (4,) places in `seen`
    sky      the stars that vote
    magnitude  (n,) of these
    four     (4,) places in `sky`
    fewest   matches that are worth the test
    Returns  icrs_to_camera, scale, matches, ln of the bound on chance (0 where there is no match)
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

    evidence = weigh(
        seen, sky, magnitude, star, matched_spot, matched_star, distance, rotation, scale
    )
    return rotation, scale, len(matched_spot), min(-evidence, 0.0)


@njit(cache=True, error_model="numpy")
def weigh(
    seen: Seen,
    sky: SkyGrid,
    magnitude: Floats,
    star: NDArray[np.int64],
    matched_spot: NDArray[np.int64],
    matched_star: NDArray[np.int64],
    distance: Floats,
    rotation: Floats,
    scale: float,
) -> float:  # pragma: no cover
    """ln of the evidence that a match is no chance, nothing being known of the attitude.

    star          (m,) places in `sky` of the stars that the image should hold
    matched_spot  (k,) places in `seen`
    matched_star  (k,) places in `star`
    distance      (k,) between the two, in the plane
    """
    unknowns = 4 if seen.focal > 0 else 3
    prior, log_prior = np.zeros((unknowns, unknowns)), -LOG_ATTITUDES
    if seen.focal > 0:
        prior[3, 3] = seen.focal**-2
        log_prior -= 0.5 * ((scale - 1) / seen.focal) ** 2 + math.log(
            seen.focal * math.sqrt(2 * math.pi)
        )
    return weigh_prior(
        seen,
        sky,
        magnitude,
        star,
        matched_spot,
        matched_star,
        distance,
        rotation,
        scale,
        prior,
        log_prior,
    )


@njit(cache=True, error_model="numpy")
def weigh_prior(
    seen: Seen,
    sky: SkyGrid,
    magnitude: Floats,
    star: NDArray[np.int64],
    matched_spot: NDArray[np.int64],
    matched_star: NDArray[np.int64],
    distance: Floats,
    rotation: Floats,
    scale: float,
    prior: Floats,
    log_prior: float,
) -> float:  # pragma: no cover
    """The same where something is known: `prior` and `log_prior` as in `log_evidence`."""
    unknowns = len(prior)
    brightness = magnitude[star]
    brighter = np.empty(len(matched_star), np.int64)
    rows = np.empty((len(matched_star), 2, unknowns))
    for i in range(len(matched_star)):
        brighter[i] = np.sum(brightness < brightness[matched_star[i]])
        rows[i] = derivatives(rotation, sky.direction[star[matched_star[i]]], scale)[:, :unknowns]
    return log_evidence(
        distance**2,
        seen.sigma[matched_spot] ** 2,
        brighter,
        rows,
        prior,
        log_prior,
        len(seen.plane),
        len(star),
        seen.area,
        seen.radius,
    )


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
