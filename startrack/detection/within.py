"""Frame that is known only in regions, and the Sky of such frames -> Spots of these regions."""

import cv2
import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Frame, Ints, Psf, Singles, Spots, assign, kernel
from startrack.detection.background import between
from startrack.detection.connect import any_above
from startrack.detection.find import FrameBackground, choose, ground_of, ring_half
from startrack.detection.matched import MARGIN, Kernel, filtered
from startrack.detection.measure import centroid
from startrack.detection.parameters import Detection
from startrack.detection.pixels import Pixels, corrected, gain_of
from startrack.detection.plan import DetectionPlan, calibrated

RING = 3  # pixel, from a window to the far side of the ring about it


def measure_ground(frame: Frame, plan: DetectionPlan) -> FrameBackground:
    """Background and noise of a whole frame, as `detect` measures them."""
    image = calibrated(frame, plan)
    return ground_of(image, filtered(image.value, plan.kernel), plan)


def detect_within(
    frame: Frame, regions: Ints, ground: FrameBackground, plan: DetectionPlan
) -> Spots:
    """Find the stars whose peaks lie in some regions, as `detect` finds them in a whole frame.

    frame     whose image is valid in the regions and `margin` pixel around each
    regions   (w, 4) left, top, right, bottom, the last two exclusive; they may overlap
    ground    background and noise, as from `measure_ground`
    Returns   Spots, brightest first
    Accuracy  model: the area of a connected component leaves out pixels in the margin beyond the
              kernel's reach.
    """
    kernel, (rows, columns) = plan.kernel, frame.image.shape
    seen = grown_mask(regions, margin(plan) - kernel.half, columns, rows)
    image = plan.workspace.canvas("filtered", (rows, columns), frame.offset, seen)
    windows, dead = grown_mask(regions, margin(plan), columns, rows), None
    if frame.image.dtype == np.float32:
        value = np.asarray(frame.image, np.float32)
    else:
        value = plan.workspace.canvas("numbers", frame.image.shape, frame.offset, windows)
        _copy(frame.image, windows, value)
    if plan.correction is not None:
        out = plan.workspace.canvas("without dark signal", value.shape, frame.offset, windows)
        value = corrected(value, plan.correction, plan.settings.saturation, within=(windows, out))
        dead = plan.correction.marks
    bright = _filter(value, seen, kernel.whole, image, ground.look, ground.sky.mesh)
    raw = Pixels(value, 0.0, 1.0, dead, gain_of(frame, 0.0))
    candidates = choose(raw, image, bright, ground, plan, regions)
    return centroid(frame, raw, candidates, plan)


def margin(plan: DetectionPlan) -> int:
    """Pixel: largest distance from a peak to a pixel that the detection uses.

    A hot pixel of a dark map uses its neighbours.
    """
    beside = 1 if plan.settings.dark_map else 0
    ring = ring_half(plan.settings, plan.kernel) + RING + plan.kernel.half
    return max(ring, reach(plan)) + beside


def reach(plan: DetectionPlan) -> int:
    """Pixel: largest distance from a peak to a pixel by which `expect` finds and measures it.

    Unlike the search of a frame, it reads no ring of the filtered image, and no dark map.
    """
    settings, half = plan.settings, plan.settings.window // 2
    read = plan.method.reads(half, settings.kernel_sigma, plan.star)
    return max(2 * half + RING, read + RING, plan.kernel.half + MARGIN)


def peak_border(settings: Detection) -> int:
    """Least distance of a peak from the border of the frame, pixel."""
    return settings.window // 2 + settings.edge


def star_profile(psf: Psf, kernel: Kernel) -> Floats:
    """Largest fraction of a star's flux in a pixel of the filtered image, by the distance.

    psf      the true PSF, not the one that the tracker assumes
    Returns  (k,) at 0, 1, 2, ... pixel along either axis and beyond
    """
    start = (psf.table.shape[0] // 2) % psf.oversampling
    star = psf.table[start :: psf.oversampling, start :: psf.oversampling].astype(np.float32)
    padded = np.pad(star, kernel.half)
    image = cv2.filter2D(padded, -1, kernel.whole, borderType=cv2.BORDER_CONSTANT)
    away = np.abs(np.arange(len(image)) - len(image) // 2)
    away = np.maximum.outer(away, away)
    fraction = np.array([image[away == k].max() for k in range(away.max() + 1)])
    return np.maximum.accumulate(fraction[::-1])[::-1].astype(float)


@kernel
def _copy(image: NDArray[np.number], windows: Ints, out: Singles) -> None:
    """Write the pixels of an image that lie in windows."""
    for left, top, right, bottom in windows:
        for y in range(top, bottom):
            for x in range(left, right):
                out[y, x] = image[y, x]


@kernel
def grown_mask(regions: Ints, by: int, columns: int, rows: int) -> Ints:
    """Regions (w, 4) with a margin of some pixels on each side, as far as the frame reaches."""
    wider = np.empty_like(regions)
    for k in range(len(regions)):
        wider[k, 0], wider[k, 1] = max(regions[k, 0] - by, 0), max(regions[k, 1] - by, 0)
        wider[k, 2] = min(regions[k, 2] + by, columns)
        wider[k, 3] = min(regions[k, 3] + by, rows)
    return wider


@kernel
def _filter(
    value: Singles, windows: Ints, kernel: Singles, image: Singles, level: Singles, mesh: int
) -> Ints:
    """`matched.filtered` in windows, and which pixels there exceed a level, as `connect.lit`.

    Returns  (n,) row * columns + column; where windows overlap, a pixel may come twice
    """
    columns = value.shape[1]
    down, across = kernel.shape[0] // 2, kernel.shape[1] // 2
    lowest = level.min()
    bright_pixels = []
    for k in range(len(windows)):
        left, top, right, bottom = windows[k]
        window = _cut(value, left - across, top - down, right + across, bottom + down)
        width = window.shape[1]
        total = np.zeros((bottom - top) * width, np.float32)
        line, many = window.ravel(), (bottom - top) * width - 2 * across
        # One straight loop over all rows of the window; values between the rows are not used.
        for j in range(kernel.shape[0]):
            for i in range(kernel.shape[1]):
                weight, start = kernel[j, i], j * width + i
                part = line[start : start + many]  # or the compiler would check for indices below 0
                for n in range(many):
                    total[n] += weight * part[n]
        rounded = total.reshape(bottom - top, width)
        for y in range(top, bottom):
            row = rounded[y - top, : right - left]
            assign(image[y, left:right], row)
            if not any_above(row, lowest):
                continue
            for i in range(len(row)):
                if row[i] > lowest and row[i] > between(level, mesh, left + i, y):
                    bright_pixels.append(y * columns + left + i)
    return np.array(bright_pixels, np.int64)


@kernel
def _cut(value, left, top, right, bottom):  # type: ignore[no-untyped-def]
    """A part of an image that is mirrored at its border, as by OpenCV's BORDER_REFLECT."""
    rows, columns = value.shape
    if left >= 0 and top >= 0 and right <= columns and bottom <= rows:
        return value[top:bottom, left:right].copy()
    window = np.empty((bottom - top, right - left), np.float32)
    for y in range(top, bottom):
        for x in range(left, right):
            window[y - top, x - left] = value[_mirrored(y, rows), _mirrored(x, columns)]
    return window


@kernel(inline="always")
def _mirrored(place, size):  # type: ignore[no-untyped-def]
    """Index of the mirror image of a pixel beyond the border."""
    if place < 0:
        return min(-1 - place, size - 1)
    return place if place < size else max(2 * size - 1 - place, 0)
