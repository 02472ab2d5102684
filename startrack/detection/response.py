"""Frame without noise, places of stars -> what a centroid is there, and how each pixel moves it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Frame, Ints
from startrack.detection.centroid import measured, placed, sample
from startrack.detection.find import Candidates
from startrack.detection.plan import DetectionPlan, calibrated
from startrack.detection.sample import FLUX, FLUX_SIGMA, XX, XY, YY, X, Y


class Response(NamedTuple):
    """A centroid to first order: place + sum over its pixels of slope times their change.

    place       (n, 2) pixel x, y on the frame itself; NaN where there is none
    covariance  (n, 2, 2) pixel^2, as the detection states it
    snr         (n,) 1
    corner      (n, 2) pixel x, y, the first of the pixels that count
    slope       (n, 2, side, side) pixel per digital number, [axis, row, column]
    """

    place: Floats
    covariance: Floats
    snr: Floats
    corner: Ints
    slope: Floats

    def of(self, which: Ints | NDArray[np.bool_]) -> Response:
        """That of some of the stars."""
        return Response(
            self.place[which],
            self.covariance[which],
            self.snr[which],
            self.corner[which],
            self.slope[which],
        )


def joined(parts: Sequence[Response]) -> Response:
    """Those of several parts, one after the other."""
    place, covariance, snr, corner, slope = zip(*parts, strict=True)
    return Response(
        np.concatenate(place),
        np.concatenate(covariance),
        np.concatenate(snr),
        np.concatenate(corner),
        np.concatenate(slope),
    )


def response(frame: Frame, x: Ints, y: Ints, sigma: Floats, plan: DetectionPlan) -> Response:
    """How centroids answer to their pixels, whatever the method of the settings.

    Each pixel is moved up and down by its own noise, that of all stars at once; stars must be
    farther apart than twice the side, or they answer to each other's.

    frame    expected numbers, not rounded
    x, y     (n,) pixel, peaks, at least the side from the border
    sigma    (rows, columns) digital number, of the pixels' noise
    Accuracy  numerical: a secant over two sigma, exact where the centroid is quadratic there. What
              a pixel of the ring does to the background is left out.
    """
    nothing: NDArray[np.int64] = np.ones(len(x), np.int64)
    # Frames are whole numbers, though their expectation is not.
    stars = sample(frame, calibrated(frame, plan), Candidates(x, y, nothing), plan.settings)
    stars = stars._replace(floor=1 / math.sqrt(12))
    middle = measured(stars, plan)
    half = half_of(plan)
    slope = np.zeros((len(x), 2, 2 * half + 1, 2 * half + 1))
    image = stars.image
    for j in range(-half, half + 1):
        for i in range(-half, half + 1):
            pixel = y + j, x + i
            held, step = image[pixel], sigma[pixel].astype(np.float32)
            image[pixel] = held + step
            above = placed(stars, plan)[:, [X, Y]]
            image[pixel] = held - step
            below = placed(stars, plan)[:, [X, Y]]
            image[pixel] = held
            slope[:, :, half + j, half + i] = (above - below) / (2 * step)[:, None]
    covariance = middle[:, [XX, XY, XY, YY]].reshape(-1, 2, 2)
    corner = np.column_stack([x, y]) - half
    snr = middle[:, FLUX] / middle[:, FLUX_SIGMA]
    return Response(middle[:, [X, Y]], covariance, snr, corner, slope)


def half_of(plan: DetectionPlan) -> int:
    """Half the side of the square of pixels that move a centroid."""
    settings = plan.settings
    return plan.method.moved_by(settings.window // 2, settings.kernel_sigma, plan.star)
