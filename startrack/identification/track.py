"""Matches from spots and a predicted attitude."""

import math
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.core import Floats, Ints, Refused, assign, kernel, order, rotated
from startrack.identification.agree import Agreed
from startrack.identification.fit import derivatives, fit
from startrack.identification.grids import VerificationStars
from startrack.identification.identify import identify, refined
from startrack.identification.index import PatternIndex
from startrack.identification.parameters import Identification, matches_by_code
from startrack.identification.seen import Seen, keep_brightest, predict, project, see, usable
from startrack.identification.verify import log_evidence_with_prior

# Squared radius of a window over its variance: one of 3000 true spots lies outside. Chosen by hand:
# a larger window matches more false spots.
WINDOW = 16.0
FEWEST = 2  # stars that determine an attitude
MOST_CHAINS = 200  # chosen by hand: success with uncertain predictions against time


@kernel
def follow(
    seen: Seen, voters: VerificationStars, predicted: Floats, covariance: Floats
) -> tuple[Floats, int, float]:
    """The chain of matches with the greatest evidence.

    Each pair of a spot and a star within the window of the prediction starts a chain. The pair
    updates the attitude and its covariance. The other stars, brightest first, are matched within
    their smaller windows, and each updates the attitude again (a Kalman filter without time).

    voters      the stars that may be detected
    predicted   (3, 3) icrs_to_camera
    covariance  (3, 3) radian^2, of the small rotation about the camera's axes
    Returns     icrs_to_camera, matches (0 for none), ln of the bound on chance
    """
    sky = voters.sky
    star, place = predict(seen, sky, predicted, 1.0)
    by_brightness = order(voters.magnitude[star])
    star, place = star[by_brightness], place[by_brightness]
    weight = seen.sigma**-2.0
    rows = np.empty((len(star), 2, 3))
    for j in range(len(star)):
        for axis, of_axis in enumerate(derivatives(predicted, sky.direction[star[j]], 1.0)):
            assign(rows[j, axis], of_axis[:3])
    information = np.linalg.inv(covariance).astype(np.float64)
    # ln of the density of the Gaussian prediction at its centre.
    log_peak = -0.5 * math.log(np.linalg.det(covariance)) - 1.5 * math.log(2 * math.pi)

    best, best_rotation, most = 0.0, predicted, 0
    chains = 0
    start = np.zeros(3)
    for first in range(len(star)):
        for spot in range(len(seen.plane)):
            if _misfit(seen, spot, place[first], rows[first], start, covariance) > WINDOW:
                continue
            chains += 1
            if chains > MOST_CHAINS:
                return best_rotation, most, best
            spots, stars = _chain(seen, spot, first, place, rows, covariance)
            if len(spots) < FEWEST:
                continue
            rotation, _ = fit(
                seen.plane, weight, sky.direction, spots, star[stars], predicted, 1.0, 0.0, 3
            )
            away = _away(predicted, rotation)
            fitted = project(sky.direction, star[stars], rotation, 1.0)
            distance = np.empty(len(spots))
            for i in range(len(spots)):
                dx, dy = seen.plane[spots[i]] - fitted[i]
                distance[i] = math.hypot(dx, dy)
            log_prior = log_peak - 0.5 * np.dot(away, np.dot(information, away))
            match = Agreed(spots, stars, distance, rotation, 1.0)
            log_p = -log_evidence_with_prior(seen, voters, star, match, information, log_prior)
            if log_p < best:
                best, best_rotation, most = log_p, rotation, len(spots)
    return best_rotation, most, best


@kernel
def _chain(
    seen: Seen, spot: int, first: int, place: Floats, rows: Floats, covariance: Floats
) -> tuple[Ints, Ints]:
    """Spots and stars of the chain that begins with one pair."""
    state, spread = _update(seen, spot, place[first], rows[first], np.zeros(3), covariance)
    taken = np.zeros(len(seen.plane), np.bool_)
    taken[spot] = True
    spots, stars = np.empty(len(place), np.int64), np.empty(len(place), np.int64)
    spots[0], stars[0], count = spot, first, 1
    for j in range(len(place)):
        if j == first:
            continue
        nearest, least = -1, WINDOW
        for i in range(len(seen.plane)):
            if not taken[i]:
                misfit = _misfit(seen, i, place[j], rows[j], state, spread)
                if misfit < least:
                    nearest, least = i, misfit
        if nearest >= 0:
            state, spread = _update(seen, nearest, place[j], rows[j], state, spread)
            taken[nearest] = True
            spots[count], stars[count] = nearest, j
            count += 1
    return spots[:count], stars[:count]


@kernel
def _innovation(
    seen: Seen, spot: int, place: Floats, row: Floats, state: Floats, spread: Floats
) -> tuple[float, float, float, float, float]:
    """Offset x, y of a spot from the expected star; xx, xy, yy of the offset's inverse
    covariance."""
    dx = seen.plane[spot, 0] - place[0]
    dy = seen.plane[spot, 1] - place[1]
    xx = yy = seen.sigma[spot] ** 2
    xy = 0.0
    for a in range(3):
        dx -= row[0, a] * state[a]
        dy -= row[1, a] * state[a]
        for b in range(3):
            xx += row[0, a] * spread[a, b] * row[0, b]
            xy += row[0, a] * spread[a, b] * row[1, b]
            yy += row[1, a] * spread[a, b] * row[1, b]
    determinant = xx * yy - xy * xy
    return dx, dy, yy / determinant, -xy / determinant, xx / determinant


@kernel
def _misfit(
    seen: Seen, spot: int, place: Floats, row: Floats, state: Floats, spread: Floats
) -> float:
    """Squared distance of a spot from the expected position of a star, over its variance."""
    dx, dy, xx, xy, yy = _innovation(seen, spot, place, row, state, spread)
    return dx * dx * xx + 2 * dx * dy * xy + dy * dy * yy


@kernel
def _update(
    seen: Seen, spot: int, place: Floats, row: Floats, state: Floats, spread: Floats
) -> tuple[Floats, Floats]:
    """State (3,) and covariance (3, 3) of the attitude after a match."""
    dx, dy, xx, xy, yy = _innovation(seen, spot, place, row, state, spread)
    cross = np.zeros((3, 2))
    for a in range(3):
        for b in range(3):
            cross[a, 0] += spread[a, b] * row[0, b]
            cross[a, 1] += spread[a, b] * row[1, b]
    after, smaller = np.empty(3), np.empty((3, 3))
    for a in range(3):
        gain_x = cross[a, 0] * xx + cross[a, 1] * xy
        gain_y = cross[a, 0] * xy + cross[a, 1] * yy
        after[a] = state[a] + gain_x * dx + gain_y * dy
        for b in range(3):
            smaller[a, b] = spread[a, b] - gain_x * cross[b, 0] - gain_y * cross[b, 1]
    return after, smaller


@kernel
def _away(source: Floats, target: Floats) -> Floats:
    """The small rotation vector (3,) from one attitude to another, about the camera's axes."""
    away = np.zeros(3)
    for k in range(3):
        x, y, z = rotated(target, source[k])
        # Axis k of the source, in the camera axes of the target, is column k of the rotation.
        column = (x, y, z)
        away[(k + 1) % 3] -= 0.5 * column[(k + 2) % 3]
        away[(k + 2) % 3] += 0.5 * column[(k + 1) % 3]
    return away


EDGE = 3.0  # sigma of the prediction, margin around the image; by hand: stars against time


def track(
    spots: core.Spots,
    camera: core.Camera,
    stars: core.Stars,
    index: PatternIndex,
    predicted: Rotation,
    covariance: Floats,
    settings: Identification,
) -> core.Matches:
    """Match spots with stars near a predicted attitude. Two stars may be enough.

    The evidence is that of `identify`, except that the prior of the attitude is the prediction's
    Gaussian. `settings.max_false_track` bounds the probability that a frame of false spots alone
    is matched. If the evidence is too weak, `identify` is called.

    spots       brightest first; those without a finite position are left out
    camera      camera with the focal length of the last frame, which is kept fixed
    predicted   icrs_to_camera at the middle of this exposure
    covariance  (3, 3) radian^2, of the small rotation about the camera's axes
    Returns     as `identify`
    Raises      ValueError if the covariance is not positive definite.
    Accuracy    model: windows are linear in the error of the prediction, which holds up to a few
                degrees.
    """
    covariance = np.array(covariance, float)
    if covariance.shape != (3, 3) or not (np.linalg.eigvalsh(covariance) > 0).all():
        raise Refused(f"covariance must be (3, 3) and positive definite, got {covariance}")
    believed = replace(settings, focal_tolerance=0.0)
    finite = usable(spots)
    if core.is_code(settings.method):
        return matches_by_code(spots, finite, camera, stars, settings, predicted, covariance)
    if len(finite) >= FEWEST:
        seen = keep_brightest(see(spots, finite, camera, believed), settings.verify_spots)
        # A star whose predicted position is outside the image may be inside.
        margin = EDGE * math.sqrt(np.linalg.eigvalsh(covariance)[-1])
        wider = seen._replace(
            low=seen.low - margin, high=seen.high + margin, corner=seen.corner + 2 * margin
        )
        rotation, matches, log_p = follow(wider, index.bright, predicted.as_matrix(), covariance)
        if matches and log_p < math.log(settings.max_false_track):
            return refined(spots, finite, camera, stars, index, believed, rotation, 1.0, log_p)
    return identify(spots, camera, stars, index, settings)
