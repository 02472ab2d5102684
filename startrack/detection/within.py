"""Frame that is known in regions alone, and the Sky of such frames -> Spots of these regions."""

from __future__ import annotations

import math
from functools import lru_cache

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.detection.background import Sky, between
from startrack.detection.centroid import centroid
from startrack.detection.find import (
    choose,
    ground_of,
    look_level,
    reach_of_noise,
    ring_half,
)
from startrack.detection.matched import filtered, kernel_of
from startrack.detection.parameters import Detection
from startrack.detection.pixels import Pixels, gain_of, pixels
from startrack.detection.psf_table import reach
from startrack.detection.smear import star_image
from startrack.scratch import scratch
from startrack.values import Floats, Frame, Ints, Psf, Spots

Image = NDArray[np.float32]
RING = 3  # pixel, from a window to the far side of the ring about it


def measure_sky(frame: Frame, settings: Detection, psf: Psf | None = None) -> Sky:
    """Background and noise of a whole frame, as `detect` sees them."""
    image, kernel = pixels(frame), kernel_of(settings, star_image(settings, psf))
    return ground_of(image, filtered(image.value, kernel), kernel, settings.mesh)


def detect_within(
    frame: Frame, regions: Ints, ground: Sky, settings: Detection, psf: Psf | None = None
) -> Spots:
    """Find the stars whose peaks lie in some regions, as `detect` finds them in a whole frame.

    frame     whose image, best float32, is right in the regions and `margin` pixel around each
    regions   (w, 4) left, top, right, bottom, the last two not in it; they may overlap
    ground    background and noise, as from `measure_sky`
    settings, psf  as `detect` takes them
    Returns   Spots, brightest first
    Errors    model: of a connected component, what lies in the margin beyond the kernel's reach
              has no part in its area.
    """
    star = star_image(settings, psf)
    kernel = kernel_of(settings, star)
    rows, columns = frame.image.shape
    far, step = margin(settings, psf), max(kernel.whole.shape) // 2
    seen = grown(regions, far - step, columns, rows)
    image = scratch("detection filtered", (rows, columns), np.float32)
    image.fill(np.median(ground.mean))
    value = np.asarray(frame.image, np.float32)
    _filter(value, seen, kernel.whole, image)
    known = Pixels(value, 0.0, 1.0, None, gain_of(frame, 0.0))
    sigmas = reach_of_noise(ground, settings, image.size, star)
    bright = _lit(image, seen, look_level(ground, sigmas), ground.mesh)
    found = choose(known, image, bright, ground, sigmas, settings, star, regions)
    return centroid(frame, known, found, settings, star)


def margin(settings: Detection, psf: Psf | None = None) -> int:
    """How far from a peak the detection looks, pixel."""
    star = star_image(settings, psf)
    kernel, half = kernel_of(settings, star), settings.window // 2
    ring = ring_half(settings, kernel) + RING + max(kernel.whole.shape) // 2
    fit = {"likelihood": max(reach(star)), "gaussian": math.ceil(3 * settings.kernel_sigma + 0.5)}
    return max(ring, 2 * half + RING, fit.get(settings.centroid, half) + RING)


def star_filter(settings: Detection, psf: Psf | None = None) -> Floats:
    """The weights of the detection's filter, (2 m + 1, 2 n + 1) 1."""
    return kernel_of(settings, star_image(settings, psf)).whole.astype(float)


def lowest_looks(ground: Sky, settings: Detection, area: int, psf: Psf | None = None) -> Floats:
    """The lowest level from which on each tile of a Sky is looked at, (down, across).

    area  pixel, of the frame
    """
    far = reach_of_noise(ground, settings, area, star_image(settings, psf))
    level = look_level(ground, far)
    return cv2.erode(level, np.ones((3, 3), np.uint8))[1:-1, 1:-1].astype(float)


def peak_border(settings: Detection) -> int:
    """How far a peak must stay from the border of the frame, pixel."""
    return settings.window // 2 + settings.edge


def kernel_half(settings: Detection, psf: Psf | None = None) -> int:
    """How far the detection's filter spreads a pixel, pixel."""
    return max(kernel_of(settings, star_image(settings, psf)).whole.shape) // 2


@lru_cache(maxsize=64)
def star_profile(psf: Psf, settings: Detection) -> Floats:
    """Share of a star's flux in the filtered image, the most at so many pixel from it or farther.

    psf      of the star as it is, not as the tracker believes it
    Returns  (k,) at 0, 1, 2, ... pixel along either axis
    """
    kernel = kernel_of(settings, star_image(settings, psf)).whole
    start = (psf.table.shape[0] // 2) % psf.oversampling
    star = psf.table[start :: psf.oversampling, start :: psf.oversampling].astype(np.float32)
    room = max(kernel.shape) // 2
    image = cv2.filter2D(np.pad(star, room), -1, kernel, borderType=cv2.BORDER_CONSTANT)
    away = np.abs(np.arange(len(image)) - len(image) // 2)
    away = np.maximum.outer(away, away)
    share = np.array([image[away == k].max() for k in range(away.max() + 1)])
    return np.maximum.accumulate(share[::-1])[::-1].astype(float)


def grown(regions: Ints, by: int, columns: int, rows: int) -> Ints:
    """Regions (w, 4) with so many pixel more on each side, as far as the frame reaches."""
    return np.clip(regions + np.array([-by, -by, by, by]), 0, [columns, rows, columns, rows])


@njit(cache=True, error_model="numpy")
def _filter(value, windows, kernel, image):  # type: ignore[no-untyped-def]
    """`matched.filtered` in windows; the image is mirrored at its border."""
    rows, columns = value.shape
    down, across = kernel.shape[0] // 2, kernel.shape[1] // 2
    for k in range(len(windows)):
        left, top, right, bottom = windows[k]
        wide = np.empty(right - left + 2 * across, np.float32)
        total = np.empty(right - left, np.float32)
        for y in range(top, bottom):
            total[:] = 0
            for j in range(-down, down + 1):
                line = value[_mirrored(y + j, rows)]
                for i in range(len(wide)):
                    wide[i] = line[_mirrored(left - across + i, columns)]
                for i in range(2 * across + 1):
                    weight = kernel[down + j, i]
                    for x in range(len(total)):
                        total[x] += weight * wide[x + i]
            image[y, left:right] = total


@njit(cache=True, error_model="numpy", inline="always")
def _mirrored(place, size):  # type: ignore[no-untyped-def]
    """The pixel that stands for one beyond the border, as OpenCV's BORDER_REFLECT has it."""
    if place < 0:
        return min(-1 - place, size - 1)
    return place if place < size else max(2 * size - 1 - place, 0)


@njit(cache=True, error_model="numpy")
def _lit(image, windows, level, mesh):  # type: ignore[no-untyped-def]
    """As `connect.lit`, in windows; where they overlap, a pixel may come twice."""
    columns = image.shape[1]
    found = []
    lowest = level.min()
    for k in range(len(windows)):
        left, top, right, bottom = windows[k]
        for y in range(top, bottom):
            for x in range(left, right):
                if image[y, x] > lowest and image[y, x] > between(level, mesh, x, y):
                    found.append(y * columns + x)
    return np.array(found, np.int64)
