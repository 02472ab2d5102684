"""Gain model or measured skewness -> how far the noise of a filtered image reaches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from startrack.detection.matched import Kernel
from startrack.detection.pixels import Gain

Grid = NDArray[np.float32]
MILD = 0.5  # skewness up to which the expansion's second-order terms are small beside the first
# Kurtosis over skewness^2 is 9/8 for a Gaussian kernel on photons alone, and grows as one over
# the photons' share of the variance. Where the gain is unknown, they may have three fifths.
HEAVINESS = 9 / 8 / 0.6


def modelled(level: Grid, gain: Gain, step: float, kernel: Kernel) -> tuple[Grid, Grid, Grid]:
    """Noise of a filtered image by the gain model: Poisson's photons and normal read noise.

        rms^2 = v K2,   skewness = l K3 / (v K2)^1.5,   kurtosis = l K4 / (v K2)^2,
        v = l + read_noise^2 + step^2 / 12,   Kn = sum(kernel^n),   l in electron

    Source: the cumulants of a sum of independent variables add.

    level    digital number, background
    step     digital number between two neighbouring values
    Returns  rms in digital number, skewness, excess kurtosis
    """
    light = np.maximum(level - gain.offset, 0) * gain.electrons_per_dn
    squares, cubes, fourths = (float(np.sum(kernel.whole.astype(float) ** n)) for n in (2, 3, 4))
    variance = light + (gain.read_noise**2 + step**2 / 12) * gain.electrons_per_dn**2
    variance = np.maximum(squares * variance, 1e-30)
    rms = np.sqrt(variance) / gain.electrons_per_dn
    return rms, light * cubes / variance**1.5, light * fourths / variance**2


def sigmas(threshold: float, skewness: Grid, kurtosis: Grid) -> Grid:
    """How many sigma this noise passes as often as normal noise passes `threshold`.

        z + skewness (z^2 - 1) / 6 + kurtosis (z^3 - 3 z) / 24 - skewness^2 (2 z^3 - 5 z) / 36

    Source: Cornish and Fisher (1937), z = threshold; no less than z.

    The terms of second order stay what they are at a skewness of 0.5, beyond which the next
    ones would have to be told too.

    Errors  numerical: too much by 0.08 sigma at 5.5 sigma and a skewness of 0.24, by 0.6 at 0.46.
    """
    z = threshold
    more = skewness * (z**2 - 1) / 6
    more = more + np.minimum(kurtosis, HEAVINESS * MILD**2) * (z**3 - 3 * z) / 24
    more = more - np.minimum(skewness, MILD) ** 2 * (2 * z**3 - 5 * z) / 36
    return np.asarray(z + np.maximum(more, 0), np.float32)
