"""Matches and field of view from the spots of an unknown camera."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from startrack.core import Camera, Matches, Refused, Spots, Stars, deg, within
from startrack.identification.identify import identify
from startrack.identification.index import PatternIndex
from startrack.identification.parameters import Identification

# Radian across the columns. A larger range takes more tries; the pinhole of a field of 2.5 radian
# has its corners 77 degrees off the axis.
NARROWEST, WIDEST = 2 * deg, 90 * deg
# Relative, of the focal length in each try. Chosen by hand: a larger one needs fewer tries, but the
# search for triangles becomes slower and less certain, more so off the axis of a wide field.
TOLERANCE, TOLERANCE_WIDE, WIDE = 0.1, 0.05, 30 * deg
FISHEYE = 45 * deg  # wider fields are tried with a fisheye's image, too


def fields(narrowest: float = NARROWEST, widest: float = WIDEST) -> list[float]:
    """Fields of view to try, radian, whose tolerances leave no gap; the nearest to 12 deg first.

    The tolerances are those of the focal length, by which the tangent of half a field goes.

    narrowest, widest  radian
    Raises             ValueError where these lie outside [0.001, 2.5] or are not in order.
    """
    within(1e-3, 2.5, narrowest=narrowest, widest=widest)
    if narrowest > widest:
        raise Refused(f"narrowest must not be above widest, got {narrowest} and {widest}")
    steps = [narrowest]
    reach = math.tan(narrowest / 2) * (1 + tolerance(narrowest))
    while reach < math.tan(widest / 2):
        here = 2 * math.atan(reach / (1 - TOLERANCE))
        if here >= WIDE:
            here = 2 * math.atan(reach / (1 - TOLERANCE_WIDE))
        steps.append(min(here, widest))
        reach = math.tan(steps[-1] / 2) * (1 + tolerance(steps[-1]))
    return sorted(steps, key=lambda field: abs(math.log(field / (12 * deg))))


def tolerance(field: float) -> float:
    """Relative, of the focal length in the try of a field (radian)."""
    return TOLERANCE if field < WIDE else TOLERANCE_WIDE


def cameras(columns: int, rows: int) -> list[tuple[Camera, float]]:
    """Cameras to try and the tolerance of each: pinholes of all fields, then wide fisheyes."""
    tried = fields()
    pinholes = [(Camera.from_field_of_view(columns, rows, field), field) for field in tried]
    wide = [(fisheye(columns, rows, field), field) for field in tried if field >= FISHEYE]
    return [(camera, tolerance(field)) for camera, field in pinholes + wide]


def fisheye(columns: int, rows: int, fov_x: float) -> Camera:
    """A camera whose images lie from its axis as the angle, not as its tangent (equidistant).

    fov_x     radian, edge to edge
    Accuracy  model: OpenCV's radial distortion up to the corners, within 0.03, 0.15, 1.2 and 8 of
              1024 pixels for 50, 60, 75 and 90 degrees.
    """
    focal = columns / fov_x
    corner = min(math.hypot(columns, rows) / 2 / focal, 1.2)
    angle = np.linspace(corner / 100, corner, 100)
    x = np.tan(angle)
    terms = np.linalg.lstsq(np.column_stack([x**3, x**5, x**7]), angle - x, rcond=None)[0]
    k1, k2, k3 = terms.tolist()
    return Camera(columns, rows, focal, k1=k1, k2=k2, k3=k3)


def identify_blind(
    spots: Spots,
    columns: int,
    rows: int,
    stars: Stars,
    index_of: Callable[[Camera], PatternIndex],
    settings: Identification,
) -> Matches:
    """Try one camera after the other until one is solved: fields from 2 to 90 degrees.

    `settings.max_false_probability` is divided by the number of tries, so that it bounds all
    together.

    columns, rows  pixel
    index_of       the index of the stars for a camera, best `PatternIndexes`: thirty are needed
    settings       its focal tolerance is replaced by 0.1, of wide fields 0.05
    Returns        as `identify`; of the last try where none is solved
    """
    tries = cameras(columns, rows)
    chance = settings.max_false_probability / len(tries)
    for camera, focal in tries:
        one_try = replace(settings, focal_tolerance=focal, max_false_probability=chance)
        matches = identify(spots, camera, stars, index_of(camera), one_try)
        if matches.icrs_to_camera is not None:
            break
    return matches
