"""Spots, and what the tracker believes of camera and sky, enter; Matches leave."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.camera import Camera
from startrack.identification.gather import gather, see, usable
from startrack.identification.index import PatternIndex
from startrack.identification.parameters import Identification
from startrack.identification.search import breadth_first, search
from startrack.values import Matches, Spots, Stars, Status


def identify(
    spots: Spots, camera: Camera, stars: Stars, index: PatternIndex, settings: Identification
) -> Matches:
    """Which spot is which star, with nothing known of the attitude.

    Patterns of four bright spots are looked up by their code; each that is found makes a
    hypothesis, on which the other spots vote. The first one that chance does not make more
    often than `settings.max_false_probability` per image is refined and matched to all spots.

    spots     brightest first; those at no finite place are left out
    camera    the tracker's own; only its focal length is in doubt
    stars     the tracker's catalogue, apparent directions
    index     built from these stars, for about this field of view
    Returns   Matches: solved with the spots in rising order and at the least-squares attitude,
              or too few stars, a blank image, or no match
    Errors    ValueError where the index was built from another number of stars. model: the
              bound on false matches holds for spots strewn at random; those of trees or
              clouds are clumped, and so are stars.
    """
    if index.stars != len(stars):
        raise ValueError(
            f"index must be built from the same stars, got {index.stars} stars in the index "
            f"and {len(stars)} in the catalogue"
        )
    pixel, finite = usable(spots)
    if len(finite) < settings.min_matches:
        return _too_few(len(finite), camera, settings)
    voting = finite[: settings.verify_spots]
    seen = see(pixel[voting], spots.covariance[voting], camera, settings)
    rotation, scale, matches, log_p, tried = search(
        seen,
        breadth_first(min(len(voting), settings.pattern_spots)),
        settings.code_tolerance,
        index.table,
        index.bright,
        index.magnitude,
        settings.min_matches,
        math.log(settings.max_false_probability),
        settings.max_hypotheses,
    )
    if matches == 0:
        return _no_match(len(finite), tried, camera)
    gathered = gather(pixel, finite, camera, stars, index, settings, rotation, scale)
    if gathered is None:
        return _no_match(len(finite), tried, camera)
    spot, star, refined, rotation = gathered
    return Matches(
        Status.SOLVED,
        f"{len(spot)} of {len(finite)} spots are stars of the catalogue",
        spot,
        star,
        stars.direction[star],
        refined,
        Rotation.from_matrix(rotation),
        math.exp(log_p),
    )


def _too_few(spots: int, camera: Camera, settings: Identification) -> Matches:
    status = Status.TOO_FEW if spots else Status.BLANK
    reason = f"{spots} usable spots, of which {settings.min_matches} are needed"
    return _unsolved(status, reason, camera)


def _no_match(spots: int, hypotheses: int, camera: Camera) -> Matches:
    reason = f"none of {hypotheses} hypotheses explains the {spots} spots better than chance"
    return _unsolved(Status.NO_MATCH, reason, camera)


def _unsolved(status: Status, reason: str, camera: Camera) -> Matches:
    none: NDArray[np.int64] = np.empty(0, np.int64)
    return Matches(status, reason, none, none, np.empty((0, 3)), camera, None, 1.0)
