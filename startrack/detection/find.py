"""Pixels -> Candidates: peaks of the filtered image that look like stars."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.detection.background import level
from startrack.detection.parameters import Detection
from startrack.detection.pixels import Pixels
from startrack.detection.robust import around
from startrack.values import Ints

Image = NDArray[np.float32]


class Candidates(NamedTuple):
    """Where a star may be: (n,) column, row, and size of its connected component, pixel."""

    x: Ints
    y: Ints
    area: Ints


def find(pixels: Pixels, settings: Detection) -> Candidates:
    """Filter, threshold, connect, and keep the peaks that stand alone and are no hot pixels.

    The whole frame sees four cheap passes; the careful tests see only the peaks.
    """
    filtered, gain = matched(pixels.value, settings.kernel_sigma)
    # Rounding to steps of 1 is noise of variance 1/12, of which the filter leaves gain^2.
    floor = pixels.step / math.sqrt(12) * gain
    above = filtered > level(filtered, settings.mesh, settings.threshold, floor)
    label, stats = connected(above.view(np.uint8))
    reach = settings.window // 2
    x, y, area = _peaks(
        filtered, label, stats, settings.min_area, settings.max_area, reach, reach + settings.edge
    )
    good = _alone(filtered, x, y, reach, settings.threshold, floor)
    if settings.sharpest_sigma > 0:
        good &= ~_sharp(pixels.value, x, y, reach, largest_share(settings.sharpest_sigma))
    if pixels.spoilt is not None:
        good &= pixels.spoilt[y, x] == 0
    return Candidates(x[good], y[good], area[good])


def matched(image: Image, sigma: float) -> tuple[Image, float]:
    """The image filtered with a Gaussian, and the share of white noise that the filter leaves.

    sigma    pixel
    Returns  (rows, columns) filtered image; root of the sum of the squares of the kernel
    """
    side = 2 * math.ceil(3 * sigma) + 1
    kernel = cv2.getGaussianKernel(side, sigma, cv2.CV_32F)
    filtered = cv2.sepFilter2D(image, cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_REFLECT)
    return np.asarray(filtered, np.float32), float(np.sum(kernel**2))


def connected(mask: NDArray[np.uint8]) -> tuple[NDArray[np.integer], NDArray[np.int32]]:
    """Connected components, diagonals included: (rows, columns) labels, and OpenCV's statistics."""
    # Labels of two bytes take a quarter of the time, and suffice where there are fewer pixels.
    few = cv2.countNonZero(mask) < 2**16
    kind = cv2.CV_16U if few else cv2.CV_32S
    _, label, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8, ltype=kind)
    return np.asarray(label, np.uint16 if few else np.int32), np.asarray(stats, np.int32)


def largest_share(sigma: float) -> float:
    """Share of a Gaussian star's light that falls on one row of pixels at most."""
    return math.erf(0.5 / (sigma * math.sqrt(2)))


@njit(cache=True, error_model="numpy")
def _peaks(
    filtered: Image,
    label: NDArray[np.integer],
    stats: NDArray[np.int32],
    min_area: int,
    max_area: int,
    reach: int,
    border: int,
) -> tuple[Ints, Ints, Ints]:
    """Local maxima of the components whose size is right; several where stars touch.

    reach   pixel, half side of the square in which a peak must be the highest
    border  pixel, distance that a peak must keep from the border
    """
    rows, columns = filtered.shape
    found = []
    for k in range(1, len(stats)):
        left, top, width, height, area = stats[k]
        if area < min_area or area > max_area:
            continue
        for y in range(max(top, border), min(top + height, rows - border)):
            for x in range(max(left, border), min(left + width, columns - border)):
                if label[y, x] == k and _highest(filtered, x, y, reach):
                    found.append((x, y, area))
    peaks = np.empty((3, len(found)), np.int64)
    for i in range(len(found)):
        peaks[0, i], peaks[1, i], peaks[2, i] = found[i]
    return peaks[0], peaks[1], peaks[2]


@njit(cache=True, error_model="numpy")
def _highest(image: Image, x: int, y: int, reach: int) -> bool:
    """Whether no pixel around is higher; of equals the first counts as the highest."""
    here = image[y, x]
    for v in range(y - reach, y + reach + 1):
        for u in range(x - reach, x + reach + 1):
            earlier = v < y or (v == y and u < x)
            if image[v, u] > here or (earlier and image[v, u] == here):
                return False
    return True


@njit(cache=True, error_model="numpy")
def _alone(
    filtered: Image, x: Ints, y: Ints, reach: int, threshold: float, floor: float
) -> NDArray[np.bool_]:
    """Whether peaks stand out of the ring around them as they stand out of their tile.

    The edge of a tree, of the limb or of a bright star's halo passes the tile's level, but its
    ring is as uneven as the edge is high.
    """
    good = np.empty(len(x), np.bool_)
    for i in range(len(x)):
        mean, _, _, rms, _ = around(filtered, x[i], y[i], reach, floor)
        good[i] = filtered[y[i], x[i]] > mean + threshold * rms
    return good


@njit(cache=True, error_model="numpy")
def _sharp(image: Image, x: Ints, y: Ints, reach: int, share: float) -> NDArray[np.bool_]:
    """Whether one row or one column holds more of the light than the sharpest star puts there.

    It tells hot pixels, and hot rows and columns, from stars. The 3 x 3 pixels about the peak
    of the image itself count, because the filter has rounded the hot pixel off.
    """
    sharp = np.empty(len(x), np.bool_)
    for i in range(len(x)):
        background, _, _, _, _ = around(image, x[i], y[i], reach, 0.0)
        core = image[y[i] - 1 : y[i] + 2, x[i] - 1 : x[i] + 2].astype(np.float64) - background
        most = max(core.sum(axis=0).max(), core.sum(axis=1).max())
        sharp[i] = most > share * core.sum()
    return sharp
