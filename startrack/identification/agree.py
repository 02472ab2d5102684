"""One-to-one matches of spots and predicted stars, and the attitude that they give."""

import math
from typing import NamedTuple

import numpy as np

from startrack import core
from startrack.core import Floats, Ints, Refused, first_not_below, kernel, median, order, quaternion
from startrack.identification.fit import fit
from startrack.identification.grids import SkyGrid
from startrack.identification.parameters import Identification
from startrack.identification.seen import Seen, predict, project, see


@kernel
def pair(plane: Floats, place: Floats, radius: Floats) -> tuple[Ints, Ints, Floats]:
    """Match each star with its nearest spot; if stars share a spot, keep the nearest star.

    plane    (n, 2) spots, in the image plane
    place    (m, 2) predicted stars, in the image plane
    radius   (n,) largest distance of each spot from its star, in the image plane
    Returns  (k,) spots in rising order, (k,) stars, (k,) distances
    """
    n = len(plane)
    taker, nearest = np.empty(n, np.int64), np.empty(n)
    x, rising = np.empty(n), np.empty(n)
    widest = 0.0
    for i in range(n):
        taker[i], nearest[i], x[i] = -1, radius[i] ** 2, plane[i, 0]
        widest = max(widest, radius[i])
    along_x = order(x)
    for k in range(n):
        rising[k] = x[along_x[k]]
    for j in range(len(place)):
        best, least = -1, np.inf
        for k in range(first_not_below(rising, place[j, 0] - widest), n):
            if rising[k] > place[j, 0] + widest:
                break
            i = along_x[k]
            square = (plane[i, 0] - place[j, 0]) ** 2 + (plane[i, 1] - place[j, 1]) ** 2
            if square <= radius[i] ** 2 and square < least:
                best, least = i, square
        if best >= 0 and least <= nearest[best]:
            taker[best], nearest[best] = j, least
    spot, star, distance = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n)
    count = 0
    for i in range(n):
        if taker[i] >= 0:
            spot[count], star[count], distance[count] = i, taker[i], math.sqrt(nearest[i])
            count += 1
    return spot[:count], star[:count], distance[:count]


# Chosen by hand.
ROUNDS = 5  # most rounds of matching and fitting; ends when the matches stay the same
# Match radius, in sigma of noise and excess of the residuals. A larger radius matches more false
# spots, a smaller one loses stars. A Gaussian in two dimensions exceeds 4 sigma with a probability
# of 0.03 %.
REACH = 4.0
NARROWEST = 1 / 8  # least radius of a round, as a fraction of the match radius
# Scale of Cauchy's weights, in sigma. A scale of 2.385 has 95 % efficiency for Gaussian residuals
# (Holland and Welsch 1977, Commun. Statist. A6(9), 813); a smaller one suppresses outliers more.
PULL = 2.0


class Agreed(NamedTuple):
    """Matches, with attitude and scale from them; NaN if the attitude is not observable.

    spot      (k,) indices into `seen`, in rising order
    taken     (k,) indices into `star`
    distance  (k,) distances of spot and star, in the image plane
    rotation  (3, 3) icrs_to_camera
    scale     true over believed focal length
    """

    spot: Ints
    taken: Ints
    distance: Floats
    rotation: Floats
    scale: float


@kernel
def agree(
    seen: Seen,
    direction: Floats,
    star: Ints,
    place: Floats,
    rotation: Floats,
    scale: float,
    match_radius: float,
    fewest: int,
) -> Agreed:
    """Match and fit alternately until the matches stay the same.

    The first attitude is wrong by a few pixels. A false spot may then be matched to a star, and
    keep the fit at an attitude where half of the stars are missed. Therefore large residuals get
    less weight (Cauchy), and the match radius is adapted to the residuals.

    direction     (s, 3) unit vectors of stars, ICRS axes
    star          (m,) indices into `direction` of the stars that the image should hold
    place         (m, 2) their expected positions, at the attitude and scale to start from
    rotation      (3, 3) icrs_to_camera to start from, as scale
    match_radius  1, radius of the first round in the image plane
    fewest        least number of matches; with fewer, the iteration ends
    """
    n = len(seen.sigma)
    radius, weight = np.empty(n), np.empty(n)
    for i in range(n):
        radius[i], weight[i] = match_radius, 1 / seen.sigma[i] ** 2
    spot, taken, distance = pair(seen.plane, place, radius)
    for turn in range(ROUNDS):
        if len(spot) < fewest:
            break
        before = spot
        rotation, scale = fit(
            seen.plane, weight, direction, spot, star[taken], rotation, scale, seen.focal, 2
        )
        place = project(direction, star, rotation, scale)
        excess = excess_variance(seen, spot, taken, place)
        for i in range(n):
            sigma = math.sqrt(seen.sigma[i] ** 2 + excess)
            widest = max(seen.radius, REACH * seen.sigma[i])
            radius[i] = min(max(REACH * sigma, NARROWEST * seen.excess), widest)
            weight[i] = 1 / (seen.sigma[i] ** 2 + excess)
        spot, taken, distance = pair(seen.plane, place, radius)
        for k in range(len(spot)):
            variance = seen.sigma[spot[k]] ** 2 + excess
            weight[spot[k]] /= 1 + distance[k] ** 2 / (PULL**2 * variance)
        if turn > 1 and _equal(spot, before):
            break
    if len(spot) >= fewest:
        rotation, scale = fit_matches(seen, direction, spot, star[taken], rotation, scale)
    return Agreed(spot, taken, distance, rotation, scale)


@kernel
def _equal(some: Ints, other: Ints) -> bool:
    equal = len(some) == len(other)
    for k in range(min(len(some), len(other))):
        equal &= some[k] == other[k]
    return equal


@kernel
def fit_matches(
    seen: Seen, direction: Floats, spot: Ints, star: Ints, rotation: Floats, scale: float
) -> tuple[Floats, float]:
    """Attitude and scale of given matches, weighted by their noise plus their common excess.

    direction   (m, 3) unit vectors of stars, ICRS axes
    spot, star  (k,) indices of matched spots and stars
    rotation    (3, 3) icrs_to_camera to start from, as scale
    """
    weight, every = np.empty(len(seen.sigma)), np.empty(len(spot), np.int64)
    for k in range(len(spot)):
        every[k] = k
    excess = 0.0
    for _ in range(2):
        for i in range(len(weight)):
            weight[i] = 1 / (seen.sigma[i] ** 2 + excess)
        rotation, scale = fit(
            seen.plane, weight, direction, spot, star, rotation, scale, seen.focal, 3
        )
        excess = excess_variance(seen, spot, every, project(direction, star, rotation, scale))
    return rotation, scale


@kernel
def excess_variance(seen: Seen, spot: Ints, taken: Ints, place: Floats) -> float:
    """Variance per axis of the residuals beyond the noise: distortion and catalogue errors.

    It follows from the median, which is robust against few false matches: the median squared length
    of a two-dimensional Gaussian is 2 ln 2 times its variance per axis. It is corrected for the
    degrees of freedom of the fit.
    """
    square, variance = np.empty(len(spot)), np.empty(len(spot))
    for i in range(len(spot)):
        x = seen.plane[spot[i], 0] - place[taken[i], 0]
        y = seen.plane[spot[i], 1] - place[taken[i], 1]
        square[i] = x * x + y * y
        variance[i] = seen.sigma[spot[i]] ** 2
    unknowns = 4 if seen.focal > 0 else 3
    left = max(2 * len(spot) - unknowns, 1) / (2 * len(spot))
    return max(median(square) / (2 * math.log(2) * left) - median(variance), 0.0)


class Gathered(NamedTuple):
    """All matches, with attitude and scale from them; NaN if the attitude is not observable.

    spot        (k,) indices of spots, in rising order
    star        (k,) indices of stars of the catalogue
    direction   (k, 3) unit vectors of these stars, ICRS axes
    rotation    (3, 3) icrs_to_camera
    quaternion  (4,) icrs_to_camera, scalar last
    scale       true over believed focal length
    """

    spot: Ints
    star: Ints
    direction: Floats
    rotation: Floats
    quaternion: Floats
    scale: float


@kernel
def gather(
    seen: Seen, faint: SkyGrid, magnitude: Floats, rotation: Floats, scale: float
) -> Gathered:
    """Match all spots to the stars in the image; fit attitude and focal length.

    faint      all stars of the catalogue
    magnitude  (stars,) their magnitudes, in the order of the catalogue
    """
    star, place = _brightest(seen, faint, magnitude, rotation, scale)
    match_radius = max(seen.excess, REACH * median(seen.sigma))
    agreed = agree(seen, faint.direction, star, place, rotation, scale, match_radius, 2)
    matched = star[agreed.taken]
    return Gathered(
        agreed.spot,
        faint.member[matched].astype(np.int64),
        faint.direction[matched],
        agreed.rotation,
        quaternion(agreed.rotation),
        min(max(agreed.scale, 1 - seen.focal), 1 + seen.focal),
    )


@kernel
def _brightest(
    seen: Seen, faint: SkyGrid, magnitude: Floats, rotation: Floats, scale: float
) -> tuple[Ints, Floats]:
    """The brightest stars in the image (m,) and their positions (m, 2).

    At most 2 n + 50 stars for n spots. Chosen by hand: more stars would include fainter ones, but
    also cause more chance matches.
    """
    star, place = predict(seen, faint, rotation, scale)
    most = 2 * len(seen.plane) + 50
    if len(star) > most:
        brightness = np.empty(len(star))
        for k in range(len(star)):
            brightness[k] = magnitude[faint.member[star[k]]]
        chosen = order(brightness)[:most]
        star, place = star[chosen], place[chosen]
    return star, place


# Number of distortion corrections. Distortion is not a similarity, so each correction uses the last
# focal length. Chosen by hand, for convergence against time.
FOCAL_ROUNDS = 3


def refit(
    spots: core.Spots, matches: core.Matches, camera: core.Camera, settings: Identification
) -> core.Camera:
    """The camera with the focal length that `identify` would find from these matches.

    camera    the camera that the tracker assumes
    Returns   Camera; the same camera if `settings.focal_tolerance` is 0
    Raises    ValueError if the matches are not solved.
    """
    if matches.icrs_to_camera is None:
        raise Refused(f"matches must be solved, got {matches.status}: {matches.reason}")
    if settings.focal_tolerance == 0:
        return camera
    every = np.arange(len(matches))
    rotation = matches.icrs_to_camera.as_matrix()
    for _ in range(FOCAL_ROUNDS if camera.distorted else 1):
        seen = see(spots, matches.spot, camera, settings)
        rotation, change = fit_matches(seen, matches.direction, every, every, rotation, 1.0)
        camera = camera.scaled(change)
    return camera
