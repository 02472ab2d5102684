"""Matches and field of view from the spots of an unknown camera."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from startrack.core import Camera, Matches, Spots, Stars, deg, within
from startrack.identification.identify import identify
from startrack.identification.index import PatternIndex
from startrack.identification.parameters import Identification

NARROWEST, WIDEST = 3 * deg, 40 * deg  # chosen by hand: a larger range takes more tries
# Relative, of the focal length in each try. Chosen by hand: a larger one needs fewer tries, but the
# search for triangles becomes slower and less certain.
TOLERANCE = 0.1


def fields(narrowest: float = NARROWEST, widest: float = WIDEST) -> list[float]:
    """Fields of view to try, radian, whose tolerances leave no gap; the nearest to 12 deg first.

    narrowest, widest  radian
    Raises             ValueError where these lie outside [0.001, 2.5] or are not in order.
    """
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
    index_of: Callable[[Camera], PatternIndex],
    settings: Identification,
) -> Matches:
    """Try one field of view after the other until one is solved.

    `settings.max_false_probability` is divided by the number of tries, so that it bounds all
    together.

    columns, rows  pixel
    index_of       the index of the stars for a camera, best `PatternIndexes`: a dozen are needed
    settings       its focal tolerance is replaced by 0.1
    Returns        as `identify`; of the last field tried where none is solved
    """
    tries = fields()
    one_try = replace(
        settings,
        focal_tolerance=TOLERANCE,
        max_false_probability=settings.max_false_probability / len(tries),
    )
    for field in tries:
        camera = Camera.from_field_of_view(columns, rows, field)
        matches = identify(spots, camera, stars, index_of(camera), one_try)
        if matches.icrs_to_camera is not None:
            break
    return matches
