"""A sparse match that one false match may distort -> an attitude grown from its patches."""

import math

import numpy as np

from startrack.core import Floats, Ints, kernel, median, order
from startrack.identification.agree import REACH, Gathered, agree, excess_variance, pair
from startrack.identification.fit import cholesky, derivatives, derivatives_at, fit
from startrack.identification.grids import VerificationStars
from startrack.identification.seen import Seen, predict, project, with_focal
from startrack.identification.verify import log_evidence_of_match

# Chosen by hand with a million skies (experiments/solvers.py). Eight of them were false, all with
# the Pleiades in a field of 20 deg.
SPARSE = 0.5  # fraction of the spots; a match of fewer spots is examined
UNEXPLAINED = 0.5  # excess of the residuals' variance over the noise, in units of the noise
# Share of the information on one direction that a single match gives. From ALONE on the match is
# grown again, and from UNCHECKED on it is not accepted.
ALONE, UNCHECKED = 0.8, 0.99
FREE = 5.0  # standard deviation of a free focal length, over its tolerance
CROWDED = 0.1  # largest expected number of chance spots in a gate
GROWTHS = 8  # most rounds of growth


@kernel
def is_doubtful(seen: Seen, held: Gathered) -> bool:
    """Whether one false match may distort a sparse match.

    That is so if its residuals exceed the noise, or one match alone determines it.
    """
    if not _is_sparse(seen, held):
        return False
    count = len(held.spot)
    every, noise = np.empty(count, np.int64), np.empty(count)
    for k in range(count):
        every[k], noise[k] = k, seen.sigma[held.spot[k]] ** 2
    place = project(held.direction, every, held.rotation, held.scale)
    excess = excess_variance(seen, held.spot, every, place)
    return excess > UNEXPLAINED * median(noise) or is_held_by_one(seen, held, ALONE)


@kernel
def is_held_by_one(seen: Seen, held: Gathered, share: float) -> bool:
    """Whether one star of a sparse match gives more than a share of the information on a direction.

    A direction is, for example, the roll about a cluster of stars, or the focal length. No other
    match then checks it.
    """
    if not _is_sparse(seen, held):
        return False
    every = np.arange(len(held.spot))
    root = _information(seen, held.spot, held.direction, every, held.rotation, held.scale, 0.0)
    for k in range(len(held.spot)):
        rows = derivatives(held.rotation, held.direction[k], held.scale)
        xx, yy, xy = _spread(seen, root, rows)
        largest = 0.5 * (xx + yy) + math.sqrt(0.25 * (xx - yy) ** 2 + xy**2)
        if largest > share * seen.sigma[held.spot[k]] ** 2:
            return True
    return False


@kernel
def _is_sparse(seen: Seen, held: Gathered) -> bool:
    return len(held.spot) < SPARSE * len(seen.plane)


@kernel
def regrown(
    seen: Seen, voters: VerificationStars, held: Gathered, fewest: int
) -> tuple[Floats, float]:
    """Attitude and scale with the most evidence: of the match, or grown from one of its patches.

    Stars of a cluster may be evidence enough, while one false match far from them determines the
    roll about the cluster, or the focal length. Then all other stars are missed. An attitude that
    is grown from the cluster alone, with its larger uncertainty, finds them.

    seen     the spots that verify
    held     the match
    fewest   number of matches in a patch, and least number of an attitude that is compared
    Returns  icrs_to_camera (3, 3); true over believed focal length, perhaps outside the tolerance
    """
    free = with_focal(seen, FREE * seen.focal)
    most, rotation, scale = _evidence(free, voters, held.rotation, held.scale, fewest)
    if not math.isfinite(most):
        rotation, scale = held.rotation, held.scale
    for middle in range(len(held.spot)):
        patch = _patch(free, held, middle, fewest)
        grown, stretch = _grown(free, voters, held, patch)
        if not math.isfinite(stretch):
            continue
        evidence, grown, stretch = _evidence(free, voters, grown, stretch, fewest)
        if evidence > most:
            most, rotation, scale = evidence, grown, stretch
    return rotation, scale


@kernel
def _evidence(
    seen: Seen, voters: VerificationStars, rotation: Floats, scale: float, fewest: int
) -> tuple[float, Floats, float]:
    """ln of the evidence for the matches that agree with an attitude; their attitude and scale."""
    star, place = predict(seen, voters.sky, rotation, scale)
    agreed = agree(seen, voters.sky.direction, star, place, rotation, scale, seen.radius, fewest)
    if len(agreed.spot) < fewest or not math.isfinite(agreed.scale):
        return -np.inf, rotation, scale
    return log_evidence_of_match(seen, voters, star, agreed), agreed.rotation, agreed.scale


@kernel
def _patch(seen: Seen, held: Gathered, middle: int, count: int) -> Ints:
    """Indices of one match (`middle`) and of the matches nearest to it; `count` in total."""
    square = np.empty(len(held.spot))
    at = seen.plane[held.spot[middle]]
    for k in range(len(held.spot)):
        x, y = seen.plane[held.spot[k]]
        square[k] = (x - at[0]) ** 2 + (y - at[1]) ** 2
    return order(square)[:count]


@kernel
def _grown(
    seen: Seen, voters: VerificationStars, held: Gathered, patch: Ints
) -> tuple[Floats, float]:
    """Attitude and scale from a patch of matches, extended to stars farther and farther away.

    A star is matched if the attitude predicts its position so accurately that fewer than CROWDED
    chance spots are expected in its gate.

    patch    (k,) indices into `held`
    Returns  as `regrown`; NaN if the patch does not determine them
    """
    count = len(seen.plane)
    widest = math.sqrt(CROWDED * seen.area / (math.pi * count))
    weight, radius = np.empty(count), np.empty(count)
    for i in range(count):
        weight[i] = 1 / seen.sigma[i] ** 2
    spot, direction, star = held.spot[patch], held.direction, patch
    rotation, scale = held.rotation, held.scale
    before = np.empty(0, np.int64)
    for _ in range(GROWTHS):
        rotation, scale = fit(
            seen.plane, weight, direction, spot, star, rotation, scale, seen.focal, 3
        )
        if not math.isfinite(scale):
            break
        place = project(direction, star, rotation, scale)
        excess = excess_variance(seen, spot, np.arange(len(spot)), place)
        root = _information(seen, spot, direction, star, rotation, scale, excess)
        for i in range(count):
            x, y = seen.plane[i]
            xx, yy, _ = _spread(seen, root, derivatives_at(x / scale, y / scale, scale))
            gate = REACH * math.sqrt(seen.sigma[i] ** 2 + excess + xx + yy)
            radius[i] = gate if gate < widest else 0.0
            weight[i] = 1 / (seen.sigma[i] ** 2 + excess)
        inside, place = predict(seen, voters.sky, rotation, scale)
        spot, taken, _ = pair(seen.plane, place, radius)
        if len(spot) < len(patch) or (len(spot) == len(before) and (spot == before).all()):
            break
        before, direction, star = spot, voters.sky.direction, inside[taken]
    return rotation, scale


@kernel
def _information(
    seen: Seen,
    spot: Ints,
    direction: Floats,
    star: Ints,
    rotation: Floats,
    scale: float,
    excess: float,
) -> Floats:
    """Cholesky factor (4, 4), lower half, of the information that matches give on the unknowns.

    excess  variance per axis beyond the noise of the spots
    """
    information = np.zeros((4, 4))
    if seen.focal > 0:
        information[3, 3] = seen.focal**-2
    for k in range(len(spot)):
        rows = derivatives(rotation, direction[star[k]], scale)
        weight = 1 / (seen.sigma[spot[k]] ** 2 + excess)
        for a in range(4):
            for b in range(a + 1):
                product = rows[0, a] * rows[0, b] + rows[1, a] * rows[1, b]
                information[a, b] += weight * product
    cholesky(information, 4 if seen.focal > 0 else 3)
    return information


@kernel
def _spread(seen: Seen, root: Floats, rows: Floats) -> tuple[float, float, float]:
    """Variances along x and y, and covariance, of a position by errors of attitude and scale.

    root  (4, 4) from `_information`
    rows  (2, 4) derivatives of the position
    """
    part = np.zeros((2, 4))
    for axis in range(2):
        for j in range(4 if seen.focal > 0 else 3):
            total = rows[axis, j]
            for i in range(j):
                total -= root[j, i] * part[axis, i]
            part[axis, j] = total / root[j, j]
    xx, yy, xy = 0.0, 0.0, 0.0
    for j in range(4):
        xx += part[0, j] ** 2
        yy += part[1, j] ** 2
        xy += part[0, j] * part[1, j]
    return xx, yy, xy
