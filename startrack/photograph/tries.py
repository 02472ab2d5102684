"""Size of an image -> tries in order: spots, view and cameras.

A photograph may hold stars larger than the detection's windows, be mirrored, squeezed or of a lens
of any field.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from startrack import identification
from startrack.core import Camera, deg
from startrack.identification import cameras
from startrack.photograph.spots import LEAST_SIDE, SCALES, THRESHOLDS
from startrack.photograph.view import PhotographView

# Sigma and scales of spots, and whether each part of the image gives the same number: all scales,
# all scales without parts full of false spots, the file's own scale, and all without the finest.
Look = tuple[float, tuple[int, ...], bool]
FIRST: Look = THRESHOLDS[0], SCALES, False
COARSER: Look = THRESHOLDS[0], SCALES[1:], False
LOOKS: tuple[Look, ...] = (
    FIRST,
    (*FIRST[:2], True),
    (THRESHOLDS[0], SCALES[:1], False),
    COARSER,
    *((THRESHOLDS[0], SCALES[k:], False) for k in (2, 3)),
    (THRESHOLDS[1], SCALES, False),
    (THRESHOLDS[1], SCALES[:1], False),
)
# Shapes of images, columns over rows; one may have been squeezed into another.
SHAPES = (4 / 3, 3 / 2, 16 / 9, 1.0, 3 / 4, 2 / 3, 9 / 16)
SAME_SHAPE, MOST_SQUEEZED = 1.03, 2.5  # ratio of shapes that triangles bear; that is tried
ROUND, HIDDEN = 1.15, 1.5  # elongation of round stars; squeeze that such stars may hide
# Radian across the columns, of fisheyes whose middle alone is tried.
FISHEYES = tuple((np.geomspace(90, 240, 12) * deg).tolist())
MIDDLE_TOLERANCE = 0.05  # of their focal length
MIDDLE = 75 * deg  # of a fisheye, which is tried
# Sides of middle squares over the shorter side of the image, and the narrowest field that is tried
# of them: the middle of a lens of unknown projection, wider than its detector, is near a pinhole's.
SQUARES, NARROWEST_SQUARE = (0.6, 0.45), 20 * deg


class Try(NamedTuple):
    """Spots, view and cameras of a try.

    share  of the probability of a false match; more hypotheses of the same need no other
    """

    threshold: float
    scales: tuple[int, ...]
    spread: bool
    view: PhotographView
    cameras: list[tuple[Camera, float]]
    share: float = 0.0


def tries_of(
    columns: int,
    rows: int,
    hint: float | None,
    tolerance: float,
    aspect: float | None,
    squeezed: list[float],
    mirrored: bool = False,
) -> tuple[list[Try], list[Try]]:
    """Attempts by the hint, and attempts without it, each in turn.

    mirrored  whether the mirrored image is tried before the image as it is
    """
    as_it_is = PhotographView(mirrored, aspect or 1.0)
    size = as_it_is.size(columns, rows)
    every = cameras(*size, hint)
    looks = [look for look in LOOKS if min(columns, rows) >= LEAST_SIDE * look[1][0]]
    rest = [Try(*look, as_it_is, every) for look in looks or [FIRST]]
    for view in [
        as_it_is._replace(mirrored=not mirrored),
        *(PhotographView(mirrored, ratio) for ratio in squeezed),
    ]:
        made = cameras(*view.size(columns, rows), hint, fisheyes=False)
        rest += [Try(*look, view, made) for look in (FIRST, COARSER) if look in (FIRST, *looks)]
    for field in FISHEYES:
        rest += _middle(columns, rows, field, MIDDLE_TOLERANCE)
    for part in SQUARES:
        rest += _square(columns, rows, part)
    if hint is None:
        return [], _shared(rest[:1]) + _shared(rest[1:])
    made = identification.cameras_of(*size, hint, tolerance)
    near = [guess._replace(cameras=made) for guess in rest if made and guess.view == as_it_is]
    return _shared(near or _middle(columns, rows, hint, tolerance)), _shared(rest)


def _shared(tries: list[Try]) -> list[Try]:
    """The tries with half of the probability of a false match among them."""
    return [guess._replace(share=0.5 / len(tries)) for guess in tries]


def _middle(columns: int, rows: int, field: float, tolerance: float) -> list[Try]:
    """The middle of a fisheye whose columns span a field; nothing if the image does not hold it."""
    side = round(MIDDLE * columns / field)
    if not LEAST_SIDE <= side <= min(columns, rows):
        return []
    made = [(identification.fisheye(side, side, MIDDLE), tolerance)]
    return [Try(*FIRST, PhotographView(middle=side), made)]


def _square(columns: int, rows: int, part: float) -> list[Try]:
    """A square in the middle, with all wide fields if there are any.

    part  its side over the shorter side of the image
    """
    side = max(round(part * min(columns, rows)), 1)
    wide = [
        (camera, tolerance)
        for camera, tolerance in cameras(side, side, fisheyes=False)
        if camera.fov_x >= NARROWEST_SQUARE
    ]
    return [Try(*FIRST, PhotographView(middle=side), wide)] if wide else []


def squeezes(columns: int, rows: int, elongation: float) -> list[float]:
    """Widths of a pixel over its height, if the image has been squeezed from another shape.

    A round star becomes longer along the rows the narrower the pixels are. Pixels may hide this,
    but cannot reverse it.

    elongation  1, of stars along the rows over that along the columns
    """
    ratios = [shape * rows / columns for shape in SHAPES]
    tried = [r for r in ratios if math.log(SAME_SHAPE) < abs(math.log(r)) < math.log(MOST_SQUEEZED)]
    if max(elongation, 1 / elongation) < ROUND:
        return [r for r in tried if abs(math.log(r)) < math.log(HIDDEN)]
    return [r for r in tried if (r < 1) == (elongation > 1)]


def tried_text(tries: list[Try]) -> str:
    """Attempts that were made, in words."""
    focal = [lens.fov_x for guess in tries for lens, _ in guess.cameras if not guess.view.middle]
    text = f"tried were fields from {min(focal) / deg:.3g} to {max(focal) / deg:.3g} deg"
    text += f", stars of 1 to {SCALES[-1]} times the usual size, mirrored"
    if squeezed := sorted({guess.view.aspect for guess in tries} - {1.0}):
        text += f", pixels {', '.join(f'{a:.2f}' for a in squeezed)} as wide as high"
    return text + (", fisheyes to 180 deg" if any(guess.view.middle for guess in tries) else "")
