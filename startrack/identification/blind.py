"""Spots of an unknown camera -> matches and field of view, by trying one camera after the other."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from startrack import core
from startrack.core import Spots, deg
from startrack.identification.identify import identify, too_few
from startrack.identification.index import PatternIndex
from startrack.identification.parameters import Identification
from startrack.identification.seen import usable

# Radian, fields of view across the columns. A larger range needs more tries. The pinhole with a
# field of 2.5 radian has its corners 77 degrees off the axis.
NARROWEST, WIDEST = 1.5 * deg, 90 * deg
# Relative tolerance of the focal length in each try. Chosen by hand: a larger one needs fewer
# tries, but makes the search for triangles slower and less certain, especially far from the axis of
# a wide field.
TOLERANCE, TOLERANCE_WIDE, WIDE = 0.1, 0.05, 30 * deg
FISHEYE = 45 * deg  # wider fields are also tried with a fisheye projection
USUAL = 12 * deg  # field that is tried first
WIDEST_PINHOLE = 2.5  # radian


def fields(first: float = USUAL) -> list[float]:
    """Fields of view to try, radian, in the order of their distance from the first one.

    Each is tried with a tolerance of the focal length. The steps are so small that the ranges of
    neighbouring fields touch.
    """
    steps = [NARROWEST]
    covered = math.tan(NARROWEST / 2) * (1 + tolerance_of(NARROWEST))
    while covered < math.tan(WIDEST / 2):
        here = 2 * math.atan(covered / (1 - TOLERANCE))
        if here >= WIDE:
            here = 2 * math.atan(covered / (1 - TOLERANCE_WIDE))
        steps.append(min(here, WIDEST))
        covered = math.tan(steps[-1] / 2) * (1 + tolerance_of(steps[-1]))
    return sorted(steps, key=lambda field: abs(math.log(field / first)))


def tolerance_of(field: float) -> float:
    """Relative tolerance of the focal length in the try of a field (radian)."""
    return TOLERANCE if field < WIDE else TOLERANCE_WIDE


def cameras(
    columns: int, rows: int, first: float | None = None, fisheyes: bool = True
) -> list[tuple[core.Camera, float]]:
    """Cameras to try and the tolerance of each: pinholes of all fields, then wide fisheyes.

    first  radian, field of view that is tried first; None: 12 degrees
    """
    tried = fields(first=first or USUAL)
    pinholes = [(core.Camera.from_field_of_view(columns, rows, field), field) for field in tried]
    wide = [(fisheye(columns, rows, field), field) for field in tried if field >= FISHEYE]
    return [
        (camera, tolerance_of(field)) for camera, field in pinholes + (wide if fisheyes else [])
    ]


def cameras_of(
    columns: int, rows: int, field: float, tolerance: float
) -> list[tuple[core.Camera, float]]:
    """The cameras of one field of view (radian): a pinhole and, if it is wide, a fisheye."""
    made = [core.Camera.from_field_of_view(columns, rows, field)] if field <= WIDEST_PINHOLE else []
    made += [fisheye(columns, rows, field)] if FISHEYE <= field <= WIDEST else []
    least = tolerance_of(field)
    side = max(math.ceil(tolerance / least) - 1, 0)  # more cameras on each side of the middle
    share = tolerance / (side + 1) if side else tolerance
    steps = sorted(range(-side, side + 1), key=abs)
    return [(camera.scaled(1 + share * step), share) for step in steps for camera in made]


def fisheye(columns: int, rows: int, fov_x: float) -> core.Camera:
    """An equidistant camera: image height is proportional to the angle from the axis.

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
    return core.Camera(columns, rows, focal, k1=k1, k2=k2, k3=k3)


def identify_blind(
    spots: Spots,
    columns: int,
    rows: int,
    stars: core.Stars,
    index_of: Callable[[core.Camera], PatternIndex],
    settings: Identification,
    tries: Sequence[tuple[core.Camera, float]] | None = None,
) -> core.Matches:
    """Try one camera after the other until one is solved: fields from 1.5 to 90 degrees.

    `settings.max_false_probability` is divided by the number of tries, so that it bounds the
    probability over all tries.

    columns, rows  pixel
    index_of       function that returns the index of the stars for a camera. `PatternIndexes` is
                   best, because thirty indexes are needed
    settings       settings; their focal tolerance is replaced by the tolerance of each try
    tries          cameras with their tolerances; None: `cameras`
    Returns        as `identify`; if no try is solved, the result that is least likely by chance
    """
    tries = cameras(columns, rows) if tries is None else tries
    count = len(usable(spots))
    if count < settings.min_matches and not core.is_code(settings.method):
        return too_few(count, tries[0][0], settings)  # before any index is built
    chance = settings.max_false_probability / len(tries)
    unsolved = []
    for camera, focal in tries:
        one_try = replace(settings, focal_tolerance=focal, max_false_probability=chance)
        matches = identify(spots, camera, stars, index_of(camera), one_try)
        if matches.icrs_to_camera is not None:
            return matches
        unsolved.append(matches)
    return min(unsolved, key=lambda matches: matches.false_probability)
