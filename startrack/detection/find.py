"""Pixels -> Candidates: peaks of the filtered image that look like stars."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from startrack.detection.background import sky
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
    # Rounding to steps of 1 is noise of variance 1/12, of which the filter leaves its share.
    floor = pixels.step / math.sqrt(12) * kernel.noise
    ground = sky(image, mesh or settings.mesh, floor)
    sigmas = ground.sigmas(settings.threshold)
    bright = lit(image, ground.mean + LOOK * sigmas * ground.rms, ground.mesh)
    reach = settings.window // 2
    x, y, area = peaks(
        image, bright, settings.min_area, settings.max_area, reach, reach + settings.edge
    )
    # A star's filtered image is twice as long as the kernel, and must not fill its own ring.
    far = max(reach, 2 * (max(kernel.whole.shape) // 2) - KERNEL_TAIL)
    good = alone(image, x, y, far, sigmas, ground.mean, ground.rms, ground.mesh, floor)
    if settings.sharpest_sigma > 0:
        good &= ~sharp(pixels.value, x, y, far, largest_share(settings.sharpest_sigma))
    if pixels.spoilt is not None:
        good &= pixels.spoilt[y, x] == 0
    return Candidates(x[good], y[good], area[good])


def kernel_of(settings: Detection, psf: Psf) -> Kernel:
    """The matched filter that the settings ask for."""
    if settings.kernel == "psf" or settings.smear_x or settings.smear_y:
        return psf_kernel(psf)
    return gaussian_kernel(settings.kernel_sigma)
