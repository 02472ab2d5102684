"""Background and gain -> law of the filtered noise; threshold -> expected noise peaks, and back."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from startrack.core import Floats, Psf, kernel
from startrack.detection.matched import Kernel
from startrack.detection.pixels import Gain
from startrack.detection.psf_table import expected

Grid = NDArray[np.floating[Any]]
MILD_SKEWNESS = (
    0.5  # skewness up to which the expansion's second-order terms are small beside the first
)
# Kurtosis over skewness^2 is 9/8 for a Gaussian kernel on photons alone, and grows as one over
# the photons' fraction of the variance. Where the gain is unknown, they may have three fifths.
KURTOSIS_RATIO = 9 / 8 / 0.6


def noise_from_gain(
    level: Grid, gain: Gain, step: float, kernel: Kernel
) -> tuple[Grid, Grid, Grid]:
    """Noise of a filtered image by the gain model: Poisson's photons and normal read noise.

        rms^2 = v K2,   skewness = l K3 / (v K2)^1.5,   kurtosis = l K4 / (v K2)^2,
        v = l + read_noise^2 + step^2 / 12,   Kn = sum(kernel^n),   l in electron

    Source: the cumulants of a sum of independent variables add.

    level    digital number, background
    step     digital number between two neighbouring values
    Returns  rms in digital number, skewness, excess kurtosis
    """
    light = np.maximum(level - gain.offset, 0) * gain.electrons_per_dn
    squares, cubes, fourths = kernel.cumulants
    variance = light + (gain.read_noise**2 + step**2 / 12) * gain.electrons_per_dn**2
    variance = np.maximum(squares * variance, 1e-30)
    rms = np.sqrt(variance) / gain.electrons_per_dn
    return rms, light * cubes / variance**1.5, light * fourths / variance**2


def equivalent_sigmas(threshold: float, skewness: Grid, kurtosis: Grid) -> Grid:
    """Level in sigma that this noise exceeds as often as normal noise exceeds `threshold`.

        z + skewness (z^2 - 1) / 6 + kurtosis (z^3 - 3 z) / 24 - skewness^2 (2 z^3 - 5 z) / 36

    Source: Cornish and Fisher (1937), z = threshold; no less than z.

    The terms of second order are kept at their values for a skewness of 0.5: beyond, terms of
    third order would be needed too.

    Accuracy  numerical: too much by 0.08 sigma at 5.5 sigma and a skewness of 0.24, by 0.6 at 0.46.
    """
    z = threshold
    more = skewness * (z**2 - 1) / 6
    more = more + np.minimum(kurtosis, KURTOSIS_RATIO * MILD_SKEWNESS**2) * (z**3 - 3 * z) / 24
    more = more - np.minimum(skewness, MILD_SKEWNESS) ** 2 * (2 * z**3 - 5 * z) / 36
    return np.asarray(z + np.maximum(more, 0), np.float32)


Image = NDArray[np.float32]
# Positions that are tried, pixel from the peak. A star lies up to half a pixel off, and noise may
# move its peak to the next pixel; an error of a quarter pixel costs 0.03 sigma of a sharp star.
OFFSETS = (-0.625, -0.375, -0.125, 0.125, 0.375, 0.625)
MARGIN = 2  # pixel beyond the kernel, so that these filters hold all the light of a star


def offset_filters(psf: Psf, kernel: Kernel) -> Floats:
    """Matched filters of stars between the pixels, each passing the kernel's fraction of noise.

    Returns  (rows, columns, 36) about a peak, with two more pixels than the kernel on each side
    """
    half_y, half_x = kernel.whole.shape[0] // 2 + MARGIN, kernel.whole.shape[1] // 2 + MARGIN
    filters = np.empty((2 * half_y + 1, 2 * half_x + 1, len(OFFSETS) ** 2))
    star = np.empty((3, *filters.shape[:2]))
    for k in range(filters.shape[2]):
        x, y = OFFSETS[k % len(OFFSETS)], OFFSETS[k // len(OFFSETS)]
        expected(psf.table, psf.oversampling, x, y, -half_x, -half_y, star)
        filters[..., k] = star[0] * (kernel.noise / np.linalg.norm(star[0]))
    return filters


@kernel
def highest_between(image: Image, x: int, y: int, level: float, filters: Floats) -> float:
    """Largest response of the filters at a peak, above a level; zero beyond the border."""
    height, width, count = filters.shape
    rows, columns = image.shape
    left, top = x - width // 2, y - height // 2
    total = np.zeros(count)
    for v in range(max(0, -top), min(height, rows - top)):
        for u in range(max(0, -left), min(width, columns - left)):
            light = image[top + v, left + u] - level
            for k in range(count):  # many filters at once
                total[k] += filters[v, u, k] * light
    return total.max()


LOWEST, HIGHEST = 1.5, 12.0  # sigma; the density falls from 1 on, and no noise passes 12


def threshold_for(peaks: float) -> float:
    """Inverse of `peak_density`: the threshold in sigma, in [1.5, 12], for a mean number of peaks.

    peaks  1, over area Lambda^(1/2)
    """
    if peaks >= peak_density(LOWEST):
        return LOWEST
    return float(
        scipy.optimize.brentq(lambda z: math.log(peak_density(z) / peaks), LOWEST, HIGHEST)
    )


def peak_density(z: float) -> float:
    """Expected peaks above z sigma in a unit area, in which Lambda is 1; see `false_alarms`."""
    return (2 * math.pi) ** -1.5 * z * math.exp(-z * z / 2)


def roughness(filters: Floats, kernel: Kernel) -> float:
    """Lambda^(1/2) of `false_alarms` per pixel, from the overlap of neighbouring filters."""
    middle, step = len(OFFSETS) // 2, OFFSETS[1] - OFFSETS[0]
    here = middle * len(OFFSETS) + middle
    slope = 1.0
    for other in (here - 1, here - len(OFFSETS)):
        common = float((filters[..., here] * filters[..., other]).sum()) / kernel.noise**2
        slope *= -2 * math.log(common) / step**2
    return math.sqrt(slope)
