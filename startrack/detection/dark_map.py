"""DarkMap: what a tracker knows of the dark signal; dark frames -> pixels without that signal."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import (
    POSITIVE,
    Floats,
    Ints,
    Parameters,
    Range,
    Refused,
    Workspace,
    kernel,
)

Image = NDArray[np.float32]


@dataclass(frozen=True)
class DarkMap(Parameters):
    """A map of the dark signal of each pixel, which the tracker measured on its own detector.

    The median of the map stays in the frame: the background keeps the shot noise of the dark
    current. A pixel that the map shows to be hot takes the mean of its neighbours instead of its
    own number, because its shot noise cannot be subtracted.
    """

    frames: Annotated[int, Range(1, 2**16),
        "dark frames with the exposure and temperature of the flight, whose mean it is"
    ] = 64  # fmt: skip
    step: Annotated[float, POSITIVE, "digital number, to whose multiples the map is rounded"] = 1.0
    hot: Annotated[float, POSITIVE,
        "sigma of a pixel's noise by which the dark signal of a hot pixel exceeds the median"
    ] = 5.0  # fmt: skip
    subtracted: Annotated[bool,
        "whether dark signal is subtracted; if not, the tracker has a list of hot pixels only"
    ] = True  # fmt: skip


class DarkFrames(NamedTuple):
    """Dark frames of one device, as they were when the map was made.

    mean   (rows, columns) digital number, of all of them
    noise  digital number rms, of a pixel in one of them
    """

    mean: Floats
    noise: float


Calibration = Callable[[], DarkFrames]  # dark frames are taken when they are first needed


class Correction(NamedTuple):
    """What the map tells of each pixel.

    offset    (rows, columns) digital number, to be subtracted
    hot       (k,) row * columns + column of the hot pixels
    marks     (rows, columns) not 0 on hot pixels
    """

    offset: Image
    hot: Ints
    marks: NDArray[np.uint8]


def correction_of(settings: DarkMap, dark: DarkFrames) -> Correction:
    """The correction that a map of these dark frames makes."""
    stored = np.rint(dark.mean / settings.step) * settings.step
    excess = stored - np.median(stored)
    marks = excess > settings.hot * dark.noise
    offset = excess if settings.subtracted else np.zeros_like(excess)
    return Correction(offset.astype(np.float32), np.flatnonzero(marks), marks.astype(np.uint8))


def corrected(
    value: Image, correction: Correction, saturation: float | None, pivot: float = 0.0
) -> Image:
    """An image without its dark signal; saturated pixels keep their numbers.

    value, saturation  digital number, the first less the pivot
    Raises  ValueError where image and map differ in shape.
    """
    if value.shape != correction.offset.shape:
        raise Refused(
            f"frames must have the shape {correction.offset.shape} of the dark map, got "
            f"{value.shape}"
        )
    rows, columns = value.shape
    out = np.empty_like(value)
    _correct(value, np.array([[0, 0, columns, rows]]), *_maps(correction, saturation, pivot), out)
    return out


def corrected_within(
    value: Image,
    windows: Ints,
    level: float,
    correction: Correction,
    saturation: float | None,
    workspace: Workspace,
) -> Image:
    """As `corrected` in windows (w, 4), whose outermost pixels may be wrong; a level elsewhere."""
    out = workspace.canvas("without dark signal", value.shape, level, windows)
    _correct(value, windows, *_maps(correction, saturation, 0.0), out)
    return out


def correction_image(correction: Correction) -> Image:
    """What an image loses by the correction, digital number: hot pixels as their neighbours."""
    return -corrected(np.zeros_like(correction.offset), correction, None)


def _maps(
    correction: Correction, saturation: float | None, pivot: float
) -> tuple[Image, NDArray[np.uint8], float]:
    limit = math.inf if saturation is None else saturation - pivot
    return correction.offset, correction.marks, limit


@kernel
def _correct(value, windows, offset, marks, saturation, out):  # type: ignore[no-untyped-def]
    for left, top, right, bottom in windows:
        for y in range(top, bottom):
            for x in range(left, right):
                here = value[y, x]
                out[y, x] = here if here >= saturation else here - offset[y, x]
    for left, top, right, bottom in windows:
        for y in range(top, bottom):
            for x in range(left, right):
                if marks[y, x]:
                    out[y, x] = _mean_beside(out, marks, x, y)


@kernel
def _mean_beside(image, marks, x, y):  # type: ignore[no-untyped-def]
    """Mean of the nearest pixels that are not hot, in the smallest square that holds one."""
    rows, columns = image.shape
    for reach in range(1, max(rows, columns)):
        total, count = 0.0, 0
        for v in range(max(y - reach, 0), min(y + reach + 1, rows)):
            for u in range(max(x - reach, 0), min(x + reach + 1, columns)):
                if not marks[v, u]:
                    total += image[v, u]
                    count += 1
        if count:
            return total / count
    return 0.0
