"""Spots of a camera of which nothing is known enter; Matches leave, with its field of view."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from startrack.core import Camera, Matches, Spots, Stars, deg, within
from startrack.identification.identify import identify
from startrack.identification.index import PatternIndex
from startrack.identification.parameters import Identification

NARROWEST, WIDEST = 3 * deg, 40 * deg
TOLERANCE = 0.1  # of the focal length, about each field that is tried


def fields(narrowest: float = NARROWEST, widest: float = WIDEST) -> list[float]:
    """Fields (radian) whose tolerances leave no gap, those near 12 deg, which are most, first."""
    within(1e-3, 2.5, narrowest=narrowest, widest=widest)
    if narrowest > widest:
        raise ValueError(f"narrowest must not be above widest, got {narrowest} and {widest}")
    ratio = (1 + TOLERANCE) / (1 - TOLERANCE)
    count = math.ceil(math.log(widest / narrowest) / math.log(ratio)) + 1
    steps = [narrowest * (widest / narrowest) ** (i / max(count - 1, 1)) for i in range(count)]
    return sorted(steps, key=lambda field: abs(math.log(field / (12 * deg))))


def identify_blind(
    spots: Spots,
    columns: int,
    rows: int,
    stars: Stars,
    index_of: Callable[[Stars, Camera], PatternIndex],
    settings: Identification,
) -> Matches:
    """Try one field of view after the other; the first beyond doubt is believed.

    Each try may be false with its fraction of `settings.max_false_probability` only.

    columns, rows  pixel
    index_of       the index for a camera, best from a cache: a dozen are needed
    settings       its focal tolerance is not used
    Returns        as `identify`; of the last field tried where none is solved
    """
    tries = fields()
    careful = replace(
        settings,
        focal_tolerance=TOLERANCE,
        max_false_probability=settings.max_false_probability / len(tries),
    )
    for field in tries:
        camera = Camera.from_field_of_view(columns, rows, field)
        matches = identify(spots, camera, stars, index_of(stars, camera), careful)
        if matches.icrs_to_camera is not None:
            break
    return matches
