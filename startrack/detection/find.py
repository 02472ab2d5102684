"""Pixels -> Candidates: peaks of the filtered image that look like stars."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.detection.background import Sky, sky
from startrack.detection.connect import lit, peaks
from startrack.detection.examine import alone, largest_share, sharp
from startrack.detection.matched import Kernel, filtered, gaussian_kernel, psf_kernel
from startrack.detection.parameters import Detection
from startrack.detection.pixels import Pixels
from startrack.values import Ints, Psf

# A star between the pixels shows less of its peak, so pixels are looked at from here on.
LOOK = np.float32(0.85)  # of the threshold
KERNEL_TAIL = 4  # pixel; the outer pixels of a filtered star are too faint to matter


class Candidates(NamedTuple):
    """Where a star may be: (n,) column, row, and size of its connected component, pixel."""

    x: Ints
    y: Ints
    area: Ints


def find(pixels: Pixels, settings: Detection, psf: Psf, mesh: int | None = None) -> Candidates:
    """Filter, compare, connect, and keep the peaks that stand alone and are no hot pixels.

    The whole frame sees three cheap passes; the careful tests see only the peaks.

    psf   what a star looks like
    mesh  pixel, side of the tiles where it is not that of the settings
    """
    kernel = kernel_of(settings, psf)
    image = filtered(pixels.value, kernel)
    ground = sky(image, mesh or settings.mesh, rounding(pixels, kernel))
    bright = lit(image, look_level(ground, settings), ground.mesh)
    return choose(pixels, image, bright, ground, settings, psf)


def look_level(ground: Sky, settings: Detection) -> NDArray[np.float32]:
    """The level from which on pixels are looked at, on the grid of the Sky, digital number."""
    sigmas = ground.sigmas(settings.threshold)
    return np.asarray(ground.mean + LOOK * sigmas * ground.rms, np.float32)


def choose(
    pixels: Pixels,
    image: NDArray[np.float32],
    bright: Ints,
    ground: Sky,
    settings: Detection,
    psf: Psf,
) -> Candidates:
    """The peaks among the bright pixels of a filtered image that look like stars.

    bright  (n,) row * columns + column of the pixels above `look_level`
    """
    kernel = kernel_of(settings, psf)
    reach = settings.window // 2
    x, y, area = peaks(
        image, bright, settings.min_area, settings.max_area, reach, reach + settings.edge
    )
    far = ring_half(settings, kernel)
    sigmas, floor = ground.sigmas(settings.threshold), rounding(pixels, kernel)
    good = alone(image, x, y, far, sigmas, ground.mean, ground.rms, ground.mesh, floor)
    if settings.sharpest_sigma > 0:
        good &= ~sharp(pixels.value, x, y, far, largest_share(settings.sharpest_sigma))
    if pixels.spoilt is not None:
        good &= pixels.spoilt[y, x] == 0
    return Candidates(x[good], y[good], area[good])


def rounding(pixels: Pixels, kernel: Kernel) -> float:
    """Least noise of the filtered image, digital number.

    Rounding to steps of 1 is noise of variance 1/12, of which the filter leaves its share.
    """
    return pixels.step / math.sqrt(12) * kernel.noise


def ring_half(settings: Detection, kernel: Kernel) -> int:
    """Half side of the square that the ring about a peak leaves free, pixel.

    A star's filtered image is twice as long as the kernel, and must not fill its own ring.
    """
    return max(settings.window // 2, 2 * (max(kernel.whole.shape) // 2) - KERNEL_TAIL)


def kernel_of(settings: Detection, psf: Psf) -> Kernel:
    """The matched filter that the settings ask for."""
    if settings.kernel == "psf" or settings.smear_x or settings.smear_y:
        return psf_kernel(psf)
    return gaussian_kernel(settings.kernel_sigma)
