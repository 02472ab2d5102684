"""Image -> filtered image: the matched filter of a star, Gaussian or from the design's own PSF."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Psf
from startrack.detection.parameters import Detection

Image = NDArray[np.float32]
FAINTEST = 0.01  # of the peak; what is fainter hardly helps the filter
REACH = 1.9  # sigma; half a pixel more of it holds all but a hundredth of the SNR
SEPARABLE = 1e-3  # of the largest singular value: a kernel is a line times a column


@dataclass(frozen=True, eq=False)
class Kernel:
    """What a star on the middle of a pixel looks like, as a filter that keeps a constant.

    whole   (2 m + 1, 2 n + 1) 1, sums to 1
    line    (2 n + 1, 1), column (2 m + 1, 1): their product is `whole`; None where there is none
    """

    whole: Image
    line: Image | None
    column: Image | None

    @cached_property
    def half(self) -> int:
        """Half of its longer side: how far it spreads a pixel, pixel."""
        return max(self.whole.shape) // 2

    @cached_property
    def noise(self) -> float:
        """Rms of the filtered image over that of the image, for white noise."""
        return float(np.linalg.norm(self.whole))

    @cached_property
    def cumulants(self) -> tuple[float, float, float]:
        """What the filter leaves of the second to fourth cumulant of a pixel."""
        squares, cubes, fourths = (float(np.sum(self.whole.astype(float) ** n)) for n in (2, 3, 4))
        return squares, cubes, fourths

    @cached_property
    def light(self) -> float:
        """Fraction of a star's flux that is its peak in the filtered image."""
        return float(np.sum(self.whole**2))


def filtered(image: Image, kernel: Kernel, out: Image | None = None) -> Image:
    """The image filtered for stars: at each pixel the best guess of the light of a star there.

    Source: Turin (1960): in white noise no linear filter makes a known shape stand out more.

    out  (rows, columns) what is returned; None: a new array
    """
    border = cv2.BORDER_REFLECT
    if kernel.line is not None and kernel.column is not None:
        lines = kernel.line, kernel.column
        result = cv2.sepFilter2D(image, cv2.CV_32F, *lines, out, borderType=border)
    else:
        result = cv2.filter2D(image, cv2.CV_32F, kernel.whole, out, borderType=border)
    return np.asarray(result, np.float32)


def kernel_of(settings: Detection, psf: Psf) -> Kernel:
    """The matched filter that the settings name."""
    if settings.kernel == "psf" or any(settings.smear):
        return psf_kernel(psf)
    return gaussian_kernel(settings.kernel_sigma)


@lru_cache(maxsize=64)
def gaussian_kernel(sigma: float) -> Kernel:
    """Of a Gaussian star, integrated over pixels; sigma in pixel."""
    reach = max(1, round(REACH * sigma))
    edge = (np.arange(-reach, reach + 2) - 0.5) / (sigma * math.sqrt(2))
    return _kernel(np.outer(*2 * (np.diff([math.erf(e) for e in edge]),)))


def psf_kernel(psf: Psf) -> Kernel:
    """Of a star as the design makes it; a smeared PSF makes a filter for streaks."""
    middle = psf.table.shape[0] // 2
    start = middle % psf.oversampling
    pixel = psf.table[start :: psf.oversampling, start :: psf.oversampling]
    bright = pixel >= FAINTEST * pixel.max()
    here = middle // psf.oversampling
    down = int(np.abs(np.flatnonzero(bright.any(axis=1)) - here).max())
    across = int(np.abs(np.flatnonzero(bright.any(axis=0)) - here).max())
    return _kernel(pixel[here - down : here + down + 1, here - across : here + across + 1])


def _kernel(shape: Floats) -> Kernel:
    # OpenCV correlates, so the star is not turned.
    whole = (shape / shape.sum()).astype(np.float32)
    left, strength, right = np.linalg.svd(shape / shape.sum())
    if len(strength) > 1 and strength[1] > SEPARABLE * strength[0]:
        return Kernel(whole, None, None)
    line, column = np.abs(right[0]), np.abs(left[:, 0]) * strength[0]
    return Kernel(whole, line[:, None].astype(np.float32), column[:, None].astype(np.float32))
