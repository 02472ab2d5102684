"""The matched filter of a star, the law of its noise, and the threshold for false spots."""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from startrack.core import Floats, Psf, Singles, kernel
from startrack.detection.pixels import PixelGain
from startrack.detection.star_model import expected

FAINTEST = 0.01  # of the peak; fainter pixels hardly improve the filter
REACH = 1.9  # sigma; with half a pixel more, the kernel keeps 99 % of the SNR
SEPARABLE = 1e-3  # of the largest singular value: a kernel is a line times a column


@dataclass(frozen=True, eq=False)
class Kernel:
    """Image of a star in the middle of a pixel, as a filter that keeps a constant.

    whole   (2 m + 1, 2 n + 1) 1, sums to 1
    line    (2 n + 1, 1), column (2 m + 1, 1): their product is `whole`; None where there is none
    """

    whole: Singles
    line: Singles | None
    column: Singles | None

    @cached_property
    def half(self) -> int:
        """Half of the longer side of the filter, pixel: the distance over which it spreads a
        pixel's light."""
        return max(self.whole.shape) // 2

    @cached_property
    def noise(self) -> float:
        """Rms of the filtered image over that of the image, for white noise."""
        return float(np.linalg.norm(self.whole))

    @cached_property
    def cumulants(self) -> tuple[float, float, float]:
        """Factors of the filter on the second to fourth cumulant of a pixel."""
        squares, cubes, fourths = (float(np.sum(self.whole.astype(float) ** n)) for n in (2, 3, 4))
        return squares, cubes, fourths

    @cached_property
    def light(self) -> float:
        """Fraction of a star's flux that is its peak in the filtered image."""
        return float(np.sum(self.whole**2))


def filtered(image: Singles, kernel: Kernel, out: Singles | None = None) -> Singles:
    """The image filtered for stars: at each pixel the best guess of the light of a star there.

    Source: Turin (1960): in white noise no linear filter has a higher SNR for a known shape.

    out  (rows, columns) array for the result; None: a new array
    """
    border = cv2.BORDER_REFLECT
    if kernel.line is not None and kernel.column is not None:
        lines = kernel.line, kernel.column
        result = cv2.sepFilter2D(image, cv2.CV_32F, *lines, out, borderType=border)
    else:
        result = cv2.filter2D(image, cv2.CV_32F, kernel.whole, out, borderType=border)
    return np.asarray(result, np.float32)


LOOKED = 0.85  # of the threshold; by hand: noise exceeds it in 4 pixels of a million


def middle_of(kernel: Kernel) -> Kernel:
    """The middle 3 x 3 pixels of a kernel, as the sums of its columns times those of its rows."""
    y, x = (side // 2 for side in kernel.whole.shape)
    middle = kernel.whole[y - 1 : y + 2, x - 1 : x + 2].astype(float)
    line, column = middle.sum(axis=0) / middle.sum(), middle.sum(axis=1) / middle.sum()
    whole, *parts = (
        part.astype(np.float32) for part in (np.outer(column, line), line[:, None], column[:, None])
    )
    return Kernel(whole, *parts)


@lru_cache(maxsize=64)
def gaussian_kernel(sigma: float) -> Kernel:
    """Kernel of a Gaussian star, integrated over pixels; sigma in pixel."""
    half = max(1, round(REACH * sigma))
    edge = (np.arange(-half, half + 2) - 0.5) / (sigma * math.sqrt(2))
    return _kernel(np.outer(*2 * (np.diff([math.erf(e) for e in edge]),)))


def psf_kernel(psf: Psf) -> Kernel:
    """Kernel of a star of the design; a smeared PSF gives a filter for streaks."""
    middle = psf.table.shape[0] // 2
    start = middle % psf.oversampling
    pixel = psf.table[start :: psf.oversampling, start :: psf.oversampling]
    bright = pixel >= FAINTEST * pixel.max()
    here = middle // psf.oversampling
    down = int(np.abs(np.flatnonzero(bright.any(axis=1)) - here).max())
    across = int(np.abs(np.flatnonzero(bright.any(axis=0)) - here).max())
    return _kernel(pixel[here - down : here + down + 1, here - across : here + across + 1])


def _kernel(shape: Floats) -> Kernel:
    # OpenCV correlates, so the star is not mirrored.
    weights = (shape / shape.sum()).astype(np.float32)
    left, strength, right = np.linalg.svd(shape / shape.sum())
    if len(strength) > 1 and strength[1] > SEPARABLE * strength[0]:
        return Kernel(weights, None, None)
    line, column = np.abs(right[0]), np.abs(left[:, 0]) * strength[0]
    return Kernel(weights, line[:, None].astype(np.float32), column[:, None].astype(np.float32))


Grid = NDArray[np.floating[Any]]
# Skewness up to which the expansion's second-order terms are small beside the first.
MILD_SKEWNESS = 0.5
# Kurtosis over skewness^2 is 9/8 for a Gaussian kernel on photon noise alone, and inversely
# proportional to the photons' fraction of the variance. For an unknown gain, 3/5 is assumed.
KURTOSIS_RATIO = 9 / 8 / 0.6
RAREST = 7.0  # sigma, which normal noise exceeds in one of 1e12 pixels


def noise_from_gain(
    level: Grid, gain: PixelGain, step: float, kernel: Kernel
) -> tuple[Grid, Grid, Grid]:
    """Noise of a filtered image by the gain model: Poisson's photons and normal read noise.

        rms^2 = v K2,   skewness = l K3 / (v K2)^1.5,   kurtosis = l K4 / (v K2)^2,
        v = l + read_noise^2 + step^2 / 12,   Kn = sum(kernel^n),   l in electron

    where l is divided by the excess noise of a multiplication register.

    Source: the cumulants of a sum of independent variables add.

    level    digital number, background
    step     digital number between two neighbouring values
    Returns  rms in digital number, skewness, excess kurtosis
    """
    light = np.maximum(level - gain.offset, 0) * gain.light
    squares, cubes, fourths = kernel.cumulants
    variance = light + (gain.read_noise**2 + step**2 / 12) * gain.light**2
    variance = np.maximum(squares * variance, 1e-30)
    rms = np.sqrt(variance) / gain.light
    return rms, light * cubes / variance**1.5, light * fourths / variance**2


def equivalent_sigmas(threshold: float, skewness: Grid, kurtosis: Grid) -> Grid:
    """Level (sigma) that this noise exceeds with the same probability as normal noise `threshold`.

        z + skewness (z^2 - 1) / 6 + kurtosis (z^3 - 3 z) / 24 - skewness^2 (2 z^3 - 5 z) / 36

    Source: Cornish and Fisher (1937), z = threshold; no less than z.

    For skewness above 0.5 the second-order terms keep their values at 0.5, because third-order
    terms would be needed too. Above RAREST the correction to z stays constant: otherwise the series
    would give 35 sigma for a threshold of 12 when pixels differ a little in their dark current.

    Accuracy  numerical: too much by 0.08 sigma at 5.5 sigma and a skewness of 0.24, by 0.6 at 0.46.
    """
    z = min(threshold, RAREST)
    more = skewness * (z**2 - 1) / 6
    more = more + np.minimum(kurtosis, KURTOSIS_RATIO * MILD_SKEWNESS**2) * (z**3 - 3 * z) / 24
    more = more - np.minimum(skewness, MILD_SKEWNESS) ** 2 * (2 * z**3 - 5 * z) / 36
    return np.asarray(threshold + np.maximum(more, 0), np.float32)


# Positions that are tried, pixel from the peak. A star lies up to half a pixel off, and noise may
# move its peak to the next pixel. An error of a quarter pixel loses 0.03 sigma of a sharp star.
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
        expected(psf.arranged, x, y, -half_x, -half_y, star)
        filters[..., k] = star[0] * (kernel.noise / np.linalg.norm(star[0]))
    return filters


@kernel
def highest_between(image: Singles, x: int, y: int, level: float, filters: Floats) -> float:
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


LOWEST, HIGHEST = 1.5, 12.0  # sigma; the density decreases from 1 on, and no noise exceeds 12


def threshold_for(peaks: float) -> float:
    """Inverse of `peak_density`: the threshold in sigma, in [1.5, 12], for a mean number of peaks.

    peaks  1, over area Lambda^(1/2)
    """
    if peaks >= peak_density(LOWEST):
        return LOWEST
    found = scipy.optimize.brentq(lambda z: math.log(peak_density(z) / peaks), LOWEST, HIGHEST)
    return float(found)


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
