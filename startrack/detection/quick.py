"""Frame -> Spots, only near pixels where a filter of 3 x 3 pixels shows light."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from startrack.core import Frame, Ints, Singles, Spots, kernel
from startrack.detection.background import between, sky, with_gain_noise
from startrack.detection.connect import peaks
from startrack.detection.find import FrameBackground, background_of
from startrack.detection.matched import LOOKED, Kernel
from startrack.detection.pixels import gain_of
from startrack.detection.plan import DetectionPlan
from startrack.detection.within import detect_within, peak_border

Numbers = NDArray[np.uint16]
COARSER = 2  # times the mesh, side of the tiles in which background and noise are measured
STRIDE = 8  # pixel, between the rows and between the columns that are read for that
ROUNDING = 1 / math.sqrt(12)  # digital number rms
NEAR = 2  # pixel: noise may move the narrow filter's peak this far from the kernel's


def detect_quickly(frame: Frame, plan: DetectionPlan) -> Spots:
    """Find the stars of a frame near the pixels where a filter of 3 x 3 pixels shows light.

    Near pixels that exceed `LOOKED` of the threshold, `detect_within` finds and measures stars as
    in the whole frame. Background and noise are measured in every eighth row of the image filtered
    by 3 x 3 pixels. They are scaled to the matched filter as if the pixels' noise were white.

    frame     of unsigned numbers of 16 bits at most
    Returns   Spots, brightest first
    Accuracy  statistical, against the search by the matched filter: at an SNR of 6 it finds 0.2 to
              1 % fewer stars if the kernel's sigma is at most 1.2 pixel, and 8 % fewer if it is 2;
              from an SNR of 8 on equally many, within 0.1 %.
    """
    frame = replace(frame, image=np.ascontiguousarray(frame.image, np.uint16))
    image, settings, narrow = frame.image, plan.settings, plan.quick_filter
    smooth = plan.workspace.array("quickly filtered frame", image.shape, np.float32)
    waiting = plan.workspace.array("waiting pixels", image.shape, np.uint8)
    ground = _ground(frame, smooth, plan)
    law = ground.sky
    height = ground.far * law.rms * np.float32(narrow.noise / plan.kernel.noise)
    look = np.asarray(law.mean + np.float32(LOOKED) * height, np.float32)
    bright = _lit(image, *_parts(narrow), look, law.mesh, smooth)
    found = peaks(smooth, bright, waiting, 1, settings.max_area, 1, peak_border(settings))
    places = np.column_stack([found.x, found.y])
    regions = np.column_stack([places - NEAR, places + NEAR + 1])
    return detect_within(frame, regions, ground, plan)


def _ground(frame: Frame, smooth: Singles, plan: DetectionPlan) -> FrameBackground:
    """Background and noise of the frame as the plan's kernel filters it, from some rows.

    smooth  (rows, columns) is written to in these rows
    """
    kernel, narrow = plan.kernel, plan.quick_filter
    _filter_rows(frame.image, *_parts(narrow), STRIDE, smooth)
    law = sky(smooth, COARSER * plan.settings.mesh, ROUNDING * narrow.noise, STRIDE)
    law = law._replace(rms=law.rms * np.float32(kernel.noise / narrow.noise))
    gain = gain_of(frame, 0.0)
    if gain.known:
        law = with_gain_noise(law, gain, 1.0, kernel)
    return background_of(law, frame.image.size, plan)


def _parts(narrow: Kernel) -> tuple[Singles, Singles]:
    """Weights (3,) of columns and of rows, each of which sums to 1."""
    return narrow.whole.sum(axis=0), narrow.whole.sum(axis=1)


@kernel
def _filter_rows(
    image: Numbers, across: Singles, down: Singles, step: int, smooth: Singles
) -> None:
    """Filter rows of an image, a step apart, by columns and rows of three pixels."""
    line = np.empty(image.shape[1], np.float32)
    for y in range(0, len(image), step):
        _filter_row(image, y, across, down, line, smooth[y], np.float32(np.inf))


@kernel
def _lit(
    image: Numbers, across: Singles, down: Singles, level: Singles, mesh: int, smooth: Singles
) -> Ints:
    """Filter an image by columns and rows of three pixels; its pixels above a level, as `lit`.

    Each row is compared while it is in the cache.

    smooth  (rows, columns) is written to, in the rows of these pixels and those beside them
    """
    rows, columns = image.shape
    line, last = np.empty(columns, np.float32), np.empty((2, columns), np.float32)
    bright, kept = [], -1
    for y in range(rows):
        lowest = level[y // mesh : y // mesh + 3].min()
        out = last[y % 2]
        some = _filter_row(image, y, across, down, line, out, lowest)
        if some or kept == y:
            smooth[y] = out
        if not some:
            continue
        if kept < y and y > 0:
            smooth[y - 1] = last[(y - 1) % 2]
        kept = y + 1
        for x in range(columns):
            if out[x] > lowest and out[x] > between(level, mesh, x, y):
                bright.append(y * columns + x)
    return np.array(bright, np.int64)


@kernel
def _filter_row(
    image: Numbers,
    y: int,
    across: Singles,
    down: Singles,
    line: Singles,
    out: Singles,
    level: float,
) -> bool:
    """Filter one row, mirrored at the border; whether a pixel exceeds a level.

    A separate kernel, so that it is vectorised.

    line  (columns,) for the work
    """
    last, end = len(image) - 1, len(line) - 1
    above, at, below = image[abs(y - 1)], image[y], image[min(y + 1, 2 * last - y - 1)]
    before, here, after = down[0], down[1], down[2]
    left, middle, right = across[0], across[1], across[2]
    for x in range(len(line)):
        # Integers are converted to vectors of floats through 32 bits.
        line[x] = (
            before * np.float32(np.int32(above[x]))
            + here * np.float32(np.int32(at[x]))
            + after * np.float32(np.int32(below[x]))
        )
    some = False
    for x in range(1, end):
        value = left * line[x - 1] + middle * line[x] + right * line[x + 1]
        out[x] = value
        some |= value > level
    out[0] = middle * line[0] + (left + right) * line[1]
    out[end] = middle * line[end] + (left + right) * line[end - 1]
    return some or out[0] > level or out[end] > level
