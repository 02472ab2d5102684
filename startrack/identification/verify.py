"""Hypothesis -> its matches, and a bound on the probability of such a match by chance."""

import math
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, Ints, kernel
from startrack.identification.agree import Agreed, agree
from startrack.identification.evidence import LOG_ATTITUDES, log_brightness, log_evidence
from startrack.identification.fit import align, derivatives
from startrack.identification.grids import SkyGrid, SpotGrid, VerificationStars, hits
from startrack.identification.index import separation
from startrack.identification.seen import Seen, predict

# First radius over the match radius. It is larger, because three stars predict the others less
# accurately than all stars do. Chosen by hand: a larger one matches more false spots, a smaller one
# loses true hypotheses.
FIRST_RADIUS = 2.0


class MatchVerdict(NamedTuple):
    """Result of the verification of a hypothesis.

    rotation  (3, 3) icrs_to_camera
    scale     1, true over believed focal length
    matches   number of matched spots; 0 if the hypothesis is refused without a test
    log_p     ln of the bound on the probability by chance
    """

    rotation: Floats
    scale: float
    matches: int
    log_p: float


@kernel
def attempt_attitude(seen: Seen, spots: Ints, a: Floats, b: Floats) -> tuple[Floats, float]:
    """Attitude and scale that map two stars (3,) to the first two of these spots."""
    u, v = seen.direction[spots[0]], seen.direction[spots[1]]
    scale = 1.0
    if seen.focal > 0:
        true = separation(a, b)
        for _ in range(2):
            scale *= separation(u, v) / true
            u, v = _scaled(seen.plane[spots[0]], scale), _scaled(seen.plane[spots[1]], scale)
    return align(a, b, u, v), scale


@kernel
def prefilter(
    seen: Seen, screen: SpotGrid, sky: SkyGrid, rotation: Floats, scale: float, fewest: int
) -> bool:
    """Whether at least `fewest` stars of `sky` lie near a spot; if not, `verify` is not called."""
    if not abs(scale - 1) <= 2 * scale_tolerance(seen):
        return False
    _, place = predict(seen, sky, rotation, scale)
    return hits(screen, seen.plane, place) >= fewest


@kernel
def scale_tolerance(seen: Seen) -> float:
    """Largest difference of the scale from one, by the focal tolerance and by noise."""
    return seen.focal + seen.radius / seen.corner


@kernel
def verify(
    seen: Seen, voters: VerificationStars, rotation: Floats, scale: float, fewest: int
) -> MatchVerdict:
    """Predict the stars of the image, match them to spots, and compute the evidence.

    fewest  least number of matches; with fewer, the hypothesis is refused
    """
    star, place = predict(seen, voters.sky, rotation, scale)
    agreed = agree(
        seen, voters.sky.direction, star, place, rotation, scale, FIRST_RADIUS * seen.radius, fewest
    )
    matches = len(agreed.spot)
    if matches < fewest or not abs(agreed.scale - 1) <= scale_tolerance(seen):
        return MatchVerdict(agreed.rotation, agreed.scale, 0, 0.0)
    evidence = log_evidence_of_match(seen, voters, star, agreed)
    return MatchVerdict(agreed.rotation, agreed.scale, matches, min(-evidence, 0.0))


@kernel
def _scaled(plane: Floats, scale: float) -> Floats:
    """The direction (3,) of a spot for a focal length times the scale."""
    x, y = plane[0] / scale, plane[1] / scale
    z = 1 / math.sqrt(1 + x * x + y * y)
    direction = np.empty(3)
    direction[0], direction[1], direction[2] = x * z, y * z, z
    return direction


@kernel
def log_evidence_of_match(
    seen: Seen, voters: VerificationStars, star: Ints, match: Agreed
) -> float:
    """ln of the evidence for a match; a priori all attitudes are equally likely.

    star   (m,) indices into `voters` of the stars that the image should contain
    match  match of spots with these stars, with its attitude and scale
    """
    unknowns = 4 if seen.focal > 0 else 3
    prior, log_prior = np.zeros((unknowns, unknowns)), -LOG_ATTITUDES
    if seen.focal > 0:
        prior[3, 3] = seen.focal**-2
        off = (match.scale - 1) / seen.focal
        log_prior -= 0.5 * off**2 + math.log(seen.focal * math.sqrt(2 * math.pi))
    return log_evidence_with_prior(seen, voters, star, match, prior, log_prior)


@kernel
def log_evidence_with_prior(
    seen: Seen,
    voters: VerificationStars,
    star: Ints,
    match: Agreed,
    prior: Floats,
    log_prior: float,
) -> float:
    """`log_evidence_of_match` with another prior: `prior` and `log_prior` as in `log_evidence`."""
    matched_spot, matched_star, distance, rotation, scale = match
    unknowns = len(prior)
    expected = voters.magnitude[star]
    brighter = np.empty(len(matched_star), np.int64)
    rows = np.empty((len(matched_star), 2, unknowns))
    square, variance = np.empty(len(matched_star)), np.empty(len(matched_star))
    for i in range(len(matched_star)):
        brighter[i] = 0
        for magnitude in expected:
            brighter[i] += magnitude < expected[matched_star[i]]
        direction = voters.sky.direction[star[matched_star[i]]]
        slopes = derivatives(rotation, direction, scale)
        for axis in range(2):
            for k in range(unknowns):
                rows[i, axis, k] = slopes[axis, k]
        square[i], variance[i] = distance[i] ** 2, seen.sigma[matched_spot[i]] ** 2
    positions = log_evidence(
        square,
        variance,
        brighter,
        rows,
        prior,
        log_prior,
        len(seen.plane),
        len(star),
        seen.area,
        seen.excess,
    )
    return positions + log_brightness(
        seen.magnitude,
        seen.blur[matched_spot],
        expected,
        voters.blur[star[matched_star]],
        matched_spot,
        matched_star,
    )
