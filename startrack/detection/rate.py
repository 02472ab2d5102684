"""Detection -> how many false spots to expect in a frame of nothing but noise."""

from __future__ import annotations

import math

from startrack.detection.find import kernel_of
from startrack.detection.parameters import Detection
from startrack.detection.smear import star_image
from startrack.values import Psf


def false_alarms(settings: Detection, columns: int, rows: int, psf: Psf | None = None) -> float:
    """Expected number of noise peaks that pass the threshold.

        n = area Lambda^(1/2) (2 pi)^(-3/2) z exp(-z^2 / 2)

    z is the threshold, Lambda the determinant of the covariance of the filtered noise's slopes
    over its variance, here from the kernel's differences.

    Source: Adler (1981), The geometry of random fields, theorem 6.9.3.

    Returns  1, per frame
    Errors   model: holds for thresholds from 4 on, within a factor of 2, as pixels do not show
             the top of every peak and as a tile does not know its noise exactly.
    """
    kernel = kernel_of(settings, star_image(settings, psf)).whole.astype(float)
    slope = 1.0
    for axis in (0, 1):
        # The slope's variance from the correlation of neighbours, for a bell-shaped correlation.
        ahead = kernel[1:] if axis == 0 else kernel[:, 1:]
        behind = kernel[:-1] if axis == 0 else kernel[:, :-1]
        slope *= -2 * math.log(float((ahead * behind).sum() / (kernel**2).sum()))
    z = settings.threshold
    density = math.sqrt(slope) / (2 * math.pi) ** 1.5 * z * math.exp(-z * z / 2)
    return columns * rows * density
