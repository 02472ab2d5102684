"""Pixels -> Candidates, by code that is not part of startrack."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from startrack.core import POINTS, Ints, Psf, call_code, returned
from startrack.detection.pixels import Pixels
from startrack.detection.plan import DetectionPlan

GROUP = "detections"


@dataclass(frozen=True, eq=False)
class DetectionInput:
    """A frame, of which a detection says where stars may be.

    value             (rows, columns) digital number above the empty pixel, as the tracker believes
    dead              (rows, columns) whether a pixel is known to be dead
    electrons_per_dn  NaN where unknown
    read_noise        digital number rms; NaN where unknown
    psf               the star's image that the tracker assumes
    border            pixel that a peak must stay from the border of the frame
    """

    value: NDArray[np.float32]
    dead: NDArray[np.bool_]
    electrons_per_dn: float
    read_noise: float
    psf: Psf
    border: int


class DetectionMethod(Protocol):
    """A detection of one's own, which a design names in `tracker.detection.search`.

    Returns  (n, 2) whole numbers: column and row of the brightest pixel of each star; the centroid
             of the design measures them. Those nearer to the border than `border` are left out
    """

    def __call__(self, given: DetectionInput, /) -> ArrayLike:
        """Find the stars of a frame."""


def peaks_by_code(pixels: Pixels, plan: DetectionPlan) -> tuple[Ints, Ints]:
    """Columns and rows (n,) of the stars that a function of the design finds.

    Raises  ValueError where the function raises an error, or returns what it must not.
    """
    settings, gain = plan.settings, pixels.gain
    name, border = settings.search, settings.window // 2 + settings.edge
    rows, columns = pixels.value.shape
    dead = np.zeros((rows, columns), bool) if pixels.dead is None else pixels.dead > 0
    value = np.asarray(pixels.value - np.nan_to_num(gain.offset), np.float32)
    given = DetectionInput(
        value, dead, gain.electrons_per_dn, gain.read_noise, plan.star.psf, border
    )
    found = call_code(GROUP, name, given)
    places = returned(GROUP, name, found, (-1, 2)) if np.size(found) else np.empty((0, 2))
    inside = ((places >= 0) & (places < [columns, rows])).all()
    if not inside or (places != np.rint(places)).any():
        raise ValueError(f"{POINTS[GROUP]} {name} must return columns and rows of pixels")
    x, y = np.unique(places.astype(np.int64), axis=0).T
    good = (np.minimum(x, columns - 1 - x) >= border) & (np.minimum(y, rows - 1 - y) >= border)
    return x[good], y[good]
