"""Sample: what every centroid works on, the image, the peaks and the noise of a pixel."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import Ints, Singles, kernel

# Columns of the table (n, COLUMNS) in which each centroid method writes a row per star: position,
# flux and its sigma, covariance of the position, and the pixel that the window is centred on.
X, Y, FLUX, FLUX_SIGMA, XX, XY, YY, WINDOW_X, WINDOW_Y = range(9)
COLUMNS = 9
UNEVEN = 1.6  # chosen by hand: chance never makes the noise of a ring exceed the gain model by more


class Sample(NamedTuple):
    """Numbers are digital ones, and `image` and what is compared with it lack the pivot.

    image             (rows, columns)
    dead              as of Pixels; empty where none is
    x, y              (n,) pixel, peaks
    half              pixel, half side of the window
    floor             least noise of a pixel
    electrons_per_dn  NaN where unknown
    offset            of an empty pixel
    read_noise        NaN where unknown
    saturation        from which on a pixel's light is unknown
    """

    image: Singles
    dead: NDArray[np.uint8]
    x: Ints
    y: Ints
    half: int
    floor: float
    electrons_per_dn: float
    offset: float
    read_noise: float
    saturation: float


@kernel
def pixel_noise(sample: Sample, background: float, spread: float) -> tuple[float, float]:
    """Noise of an empty pixel, and the variance that each digital number of light adds.

        variance = read_noise^2 + (background - offset) / gain + step^2 / 12

    where all of it is known; else the spread of the ring about the star, which also counts
    where it is uneven. A gain that is not known is taken from the background as if all of it
    were light, and at least one sigma of its own noise, as the offset may not be known either.

    spread   of the pixels around
    Returns  digital number; digital number
    """
    shot, noise, light = 1 / sample.electrons_per_dn, spread, background - sample.offset
    if np.isnan(shot):
        shot = noise**2 / max(light, noise, 1e-30)
    elif not np.isnan(sample.read_noise):
        variance = sample.read_noise**2 + max(light, 0.0) * shot + sample.floor**2
        if spread < UNEVEN * math.sqrt(variance):
            noise = math.sqrt(variance)
    return noise, shot
