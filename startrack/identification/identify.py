"""Spots, and what the tracker believes of camera and sky, enter; Matches leave."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.camera import Camera
from startrack.identification.chance import log_hypotheses
from startrack.identification.fit import fit
from startrack.identification.index import PatternIndex
from startrack.identification.parameters import Identification
from startrack.identification.search import breadth_first, search
from startrack.identification.sky import cone
from startrack.identification.verify import Seen, pair
from startrack.values import Floats, Ints, Matches, Spots, Stars, Status

ROUNDS = 3  # of matching and fitting at the end; each improves the radius of the next
RMS_RADIUS = 4.0  # times the rms distance: where the last matches end


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
    pixel = np.column_stack([spots.x, spots.y])
    usable = np.flatnonzero(np.isfinite(pixel).all(axis=1))
    if len(usable) < settings.min_matches:
        return _too_few(len(usable), camera, settings)
    voting = usable[: settings.verify_spots]
    seen = _see(pixel[voting], spots.covariance[voting], camera, index, settings)
    rotation, scale, matches, log_p, tried = search(
        seen,
        breadth_first(min(len(voting), settings.pattern_spots)),
        settings.code_tolerance,
        index.table,
        index.bright,
        index.rank,
        settings.min_matches,
        math.log(settings.max_false_probability),
        settings.max_hypotheses,
    )
    if matches == 0:
        return _no_match(len(usable), tried, camera)
    spot, star, refined, rotation = _gather(
        pixel, usable, camera, stars, index, settings, rotation, scale
    )
    return Matches(
        Status.SOLVED,
        f"{len(spot)} of {len(usable)} spots are stars of the catalogue",
        spot,
        star,
        stars.direction[star],
        refined,
        Rotation.from_matrix(rotation),
        math.exp(log_p),
    )


def _see(
    pixel: Floats, covariance: Floats, camera: Camera, index: PatternIndex, settings: Identification
) -> Seen:
    """The voting spots in the image plane of the believed camera."""
    direction = camera.unproject(pixel)
    sigma = np.sqrt(np.maximum(np.trace(covariance, axis1=1, axis2=2), 0) / 2)
    sigma = np.where(np.isfinite(sigma), sigma, settings.match_radius)
    sigma = np.minimum(sigma, settings.match_radius)
    focal = camera.focal_length_px
    # The border of the undistorted image; distortion moves it by a few pixels, no matter here.
    centre = np.array(camera.centre)
    low = (-0.5 - centre) / focal
    high = (np.array([camera.columns, camera.rows]) - 0.5 - centre) / focal
    patterns = min(len(pixel), settings.pattern_spots)
    tolerance = settings.focal_tolerance + settings.match_radius / focal / index.densest
    return Seen(
        direction[:, :2] / direction[:, 2:],
        direction,
        sigma / focal,
        low,
        high,
        math.atan(math.hypot(*np.maximum(-low, high))),
        settings.match_radius / focal,
        math.pi * settings.match_radius**2 / (camera.columns * camera.rows),
        settings.focal_tolerance,
        log_hypotheses(patterns, len(index.table.base), index.densest, tolerance),
    )


def _gather(
    pixel: Floats,
    usable: Ints,
    camera: Camera,
    stars: Stars,
    index: PatternIndex,
    settings: Identification,
    rotation: Floats,
    scale: float,
) -> tuple[Ints, Ints, Camera, Floats]:
    """Match all spots to all stars in the image, with the focal length and attitude they give.

    Returns  spots, stars, camera, icrs_to_camera
    """
    radius, tolerance = settings.match_radius, settings.focal_tolerance
    for _ in range(ROUNDS):
        refined = camera.scaled(scale)
        expected, place = _expected(rotation, refined, stars, index, 2 * len(usable) + 50)
        chosen, taken, distance = pair(pixel[usable], place, radius)
        spot, star = usable[chosen], expected[taken]
        # Distortion is not a similarity, so it is taken off with the focal length of this round,
        # and the fit finds what is left.
        direction = refined.unproject(pixel[spot])
        plane = direction[:, :2] / direction[:, 2:]
        pairs = np.arange(len(spot))
        rotation, change = fit(
            plane, stars.direction[star], pairs, pairs, rotation, 1.0, tolerance > 0, 3
        )
        scale = min(max(scale * change, 1 - tolerance), 1 + tolerance)
        rms = math.sqrt(np.mean(distance**2))
        radius = max(min(RMS_RADIUS * rms, radius), settings.match_radius / 8)
    return spot, star, camera.scaled(scale), rotation


def _expected(
    rotation: Floats, camera: Camera, stars: Stars, index: PatternIndex, most: int
) -> tuple[Ints, Floats]:
    """The brightest stars in the image, at most so many, and their pixels (n, 2)."""
    near = index.faint.member[cone(index.faint, rotation[2].copy(), 1.1 * camera.half_diagonal)]
    pixel = camera.project(stars.direction[near] @ rotation.T)
    inside = camera.holds(pixel)
    near, pixel = near[inside], pixel[inside]
    brightest = np.argsort(stars.magnitude_g[near], kind="stable")[:most]
    return near[brightest].astype(np.int64), pixel[brightest]


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
