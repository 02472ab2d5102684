"""Spots enter as the believed camera sees them; what an attitude makes of all of them leaves."""

from __future__ import annotations

import math

import numpy as np

from startrack.camera import Camera
from startrack.identification.fit import fit
from startrack.identification.index import PatternIndex
from startrack.identification.parameters import Identification
from startrack.identification.sky import cone
from startrack.identification.verify import Seen, pair
from startrack.values import Floats, Ints, Spots, Stars

ROUNDS = 3  # of matching and fitting; each improves the radius of the next
GATE = 3.0  # sigma of the centroids: the match radius is not smaller
LEAST_SIGMA = 0.01  # pixel, that a centroid is believed
RMS_RADIUS = 4.0  # times the rms distance: where the last matches end


def usable(spots: Spots) -> tuple[Floats, Ints]:
    """Pixels (n, 2) of all spots, and which of them are at a finite place."""
    pixel = np.column_stack([spots.x, spots.y])
    return pixel, np.flatnonzero(np.isfinite(pixel).all(axis=1))


def see(pixel: Floats, covariance: Floats, camera: Camera, settings: Identification) -> Seen:
    """The voting spots in the image plane of the believed camera."""
    direction = camera.unproject(pixel)
    sigma = np.sqrt(np.maximum(np.trace(covariance, axis1=1, axis2=2), 0) / 2)
    sigma = np.where(np.isfinite(sigma), sigma, settings.match_radius)
    sigma = np.clip(sigma, LEAST_SIGMA, settings.match_radius)
    radius = max(settings.match_radius, GATE * float(np.median(sigma)))
    focal = camera.focal_length_px
    # The border of the undistorted image; distortion moves it by a few pixels, no matter here.
    centre = np.array(camera.centre)
    low = (-0.5 - centre) / focal
    high = (np.array([camera.columns, camera.rows]) - 0.5 - centre) / focal
    return Seen(
        direction[:, :2] / direction[:, 2:],
        direction,
        sigma / focal,
        low,
        high,
        math.atan(math.hypot(*np.maximum(-low, high))),
        radius / focal,
        camera.columns * camera.rows / focal**2,
        settings.focal_tolerance,
    )


def gather(
    pixel: Floats,
    usable: Ints,
    camera: Camera,
    stars: Stars,
    index: PatternIndex,
    settings: Identification,
    rotation: Floats,
    scale: float,
) -> tuple[Ints, Ints, Camera, Floats] | None:
    """Match all spots to all stars in the image, with the focal length and attitude they give.

    Returns  spots, stars, camera, icrs_to_camera; None where too few are left for an attitude
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
        if not math.isfinite(change):
            return None
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
