"""A Frame enters; Spots leave, brightest first: of the whole frame, or near given places."""

import math

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Frame, Ints, Psf, Refused, Spots, positive
from startrack.detection.connect import Peaks
from startrack.detection.find import find
from startrack.detection.measure import centroid
from startrack.detection.parameters import Detection
from startrack.detection.pixels import Pixels
from startrack.detection.plan import DetectionPlan, calibrated, planned
from startrack.detection.quick import detect_quickly


def detect(frame: Frame, settings: Detection | DetectionPlan, psf: Psf | None = None) -> Spots:
    """Find the stars of an image.

    The image is filtered for stars, compared with its local background and noise, and cut
    into connected components; peaks that look like stars are measured in small windows.

    frame     image of any real type; a pixel that is not finite is dead
    settings  thresholds and windows; or a plan made of settings and PSF by `plan_detection`, which
              saves time for many frames. The quick search takes unsigned numbers of 8 or 16 bits;
              other images are searched by the filter
    psf       of the design at rest, if the settings use it; None: a Gaussian of their kernel_sigma
    Returns   Spots, brightest first; empty without stars
    Raises    TypeError or ValueError where the image is not a two-dimensional array of real numbers
              with at least one finite value. Those of `centroid` for the accuracy.
    """
    plan = planned(settings, psf)
    if not plan.searches_quickly(frame):
        image = calibrated(frame, plan)
        return centroid(frame, image, find(image, plan), plan)
    return detect_quickly(frame, plan)


MEDIAN_STRIDE = 7  # no divisor of a usual side, so that all columns are sampled
LEAST_SIDE = 25  # pixel; in a smaller window the noise could not be measured


def detect_near(
    frame: Frame, place: Floats, reach: float, settings: Detection | DetectionPlan
) -> Spots:
    """Find the stars near their expected places.

    The windows are stacked as one narrow image, each minus its own median. This image is searched
    like a frame, with one tile for each window. The spots are measured on the frame itself, so that
    a star's measurement does not depend on the place of its window.

    place     (m, 2) pixel (x, y); places outside the frame find nothing
    reach     pixel, largest distance of a star from its place along either axis
    settings  as `detect` takes them; the mesh is the window's side
    Returns   Spots, brightest first; one star for two places near it
    Raises    those of `detect`; ValueError if `place` is not (m, 2) or reach not positive.
    """
    positive(reach=reach)
    place = np.asarray(place, float)
    if place.ndim != 2 or place.shape[1] != 2:
        raise Refused(f"place must have the shape (m, 2), got {place.shape}")
    plan = planned(settings)
    image = calibrated(frame, plan)
    return centroid(frame, image, _near(image, place, reach, plan), plan)


def _near(image: Pixels, place: Floats, half_side: float, plan: DetectionPlan) -> Peaks:
    settings = plan.settings
    rows, columns = image.value.shape
    inside = (place > -0.5).all(axis=1) & (place < [columns - 0.5, rows - 0.5]).all(axis=1)
    centre = np.rint(place[inside]).astype(np.int64)
    # Room for the kernel, for the ring about a star at the edge of the reach, and for the noise.
    half = math.ceil(half_side) + max(plan.kernel.half, settings.window // 2 + 4)
    half = min(max(half, LEAST_SIDE // 2), (min(rows, columns) - 1) // 2)
    side = 2 * half + 1
    # A window at the border is moved inwards to be complete.
    corner = np.clip(centre - half, 0, [columns - side, rows - side])
    if not len(corner):
        nothing = np.empty(0, np.int64)
        return Peaks(nothing, nothing, nothing)
    dead = None if image.dead is None else _stacked(image.dead, corner, side)
    values = _stacked(image.value, corner, side).reshape(len(corner), -1)
    # So that windows from distant parts of the frame fit together; a sample of pixels suffices.
    values = values - np.median(values[:, ::MEDIAN_STRIDE], axis=1)[:, None]
    stack = Pixels(values.reshape(-1, side), image.pivot, image.step, dead)
    candidates = find(stack, plan, mesh=side)
    window = candidates.y // side
    x, y = candidates.x + corner[window, 0], candidates.y - window * side + corner[window, 1]
    off = np.maximum(abs(x - place[inside][window, 0]), abs(y - place[inside][window, 1]))
    border = settings.window // 2 + settings.edge
    good = (off <= half_side + 1) & (np.minimum(x, columns - 1 - x) >= border)
    good &= np.minimum(y, rows - 1 - y) >= border
    return Peaks(x[good], y[good], candidates.area[good])


def _stacked(image: NDArray, corner: Ints, side: int) -> NDArray:
    """Windows under one another, (m side, side), by their first columns and rows, (m, 2)."""
    step = np.arange(side)
    row, column = corner[:, 1, None] + step, corner[:, 0, None] + step
    return image[row[:, :, None], column[:, None, :]].reshape(-1, side)
