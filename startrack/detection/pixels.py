"""A Frame enters, with its dark frame and flat field; calibrated pixels as float32 leave."""

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from startrack import core
from startrack.core import (
    Flags,
    Floats,
    Ints,
    Parameters,
    Refused,
    Singles,
    kernel,
    parameter,
    printed,
)
from startrack.detection.robust import clipped

# Largest number of dark frames of a map: the mean of more has less than 3 % of the noise of a
# frame, and a frame of 1024 x 1024 pixels takes 0.1 s.
LONGEST_MEAN = 1024


class DarkMap(Parameters):
    """A map of the dark signal of each pixel, which the tracker measured on its own detector.

    The median of the map stays in the frame: the background keeps the shot noise of the dark
    current. A pixel that the map shows to be hot takes the mean of its neighbours instead of its
    own number, because its shot noise cannot be subtracted.
    """

    frames: int = parameter(
        "dark frames with the exposure and temperature of the flight, whose mean it is",
        limit=core.Range(1, LONGEST_MEAN),
        default=64,
    )
    step: float = parameter(
        "digital number, to whose multiples the map is rounded", limit=core.POSITIVE, default=1.0
    )
    hot: float = parameter(
        "sigma of a pixel's noise by which the dark signal of a hot pixel exceeds the median",
        limit=core.POSITIVE,
        default=5.0,
    )
    subtracted: bool = parameter(
        "whether dark signal is subtracted; if not, the tracker has a list of hot pixels only",
        default=True,
    )


@printed
class DarkFrames(NamedTuple):
    """Dark frames of one device, as they were when the map was made.

    mean   (rows, columns) digital number, of all of them
    noise  digital number rms, of a pixel in one of them
    """

    mean: Floats
    noise: float


Calibration = Callable[[], DarkFrames]  # dark frames are taken when they are first needed


class PixelCorrection(NamedTuple):
    """Correction of each pixel by a dark map.

    offset    (rows, columns) digital number, to be subtracted
    hot       (k,) row * columns + column of the hot pixels
    marks     (rows, columns) not 0 on hot pixels
    """

    offset: Singles
    hot: Ints
    marks: NDArray[np.uint8]


def correction_of(settings: DarkMap, dark: DarkFrames) -> PixelCorrection:
    """The correction by a map of these dark frames."""
    stored = np.rint(dark.mean / settings.step) * settings.step
    excess = stored - np.median(stored)
    marks = excess > settings.hot * dark.noise
    offset = excess if settings.subtracted else np.zeros_like(excess)
    return PixelCorrection(offset.astype(np.float32), np.flatnonzero(marks), marks.astype(np.uint8))


def corrected(
    value: Singles,
    correction: PixelCorrection,
    saturation: float | None,
    pivot: float = 0.0,
    within: tuple[Ints, Singles] | None = None,
) -> Singles:
    """An image without its dark signal; saturated pixels keep their numbers.

    value, saturation  digital number; the pivot is subtracted from the value
    within  windows (w, 4), whose outermost pixels may be wrong, and the image to write them to;
            None: all of a new image
    Raises  ValueError if image and map differ in shape.
    """
    if value.shape != correction.offset.shape:
        raise Refused(
            f"frames must have the shape {correction.offset.shape} of the dark map, got "
            f"{value.shape}"
        )
    rows, columns = value.shape
    windows, out = within or (np.array([[0, 0, columns, rows]]), np.empty_like(value))
    limit = math.inf if saturation is None else saturation - pivot
    _correct(value, windows, correction.offset, correction.marks, limit, out)
    return out


def correction_image(correction: PixelCorrection) -> Singles:
    """Digital number that the correction subtracts from an image: hot pixels become like their
    neighbours.
    """
    return -corrected(np.zeros_like(correction.offset), correction, None)


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
def _mean_beside(image: Singles, marks: NDArray[np.uint8], x: int, y: int) -> float:
    """Mean of the nearest pixels that are not hot, in the smallest square that holds one."""
    rows, columns = image.shape
    for half in range(1, max(rows, columns)):
        total, count = 0.0, 0
        for v in range(max(y - half, 0), min(y + half + 1, rows)):
            for u in range(max(x - half, 0), min(x + half + 1, columns)):
                if not marks[v, u]:
                    total += image[v, u]
                    count += 1
        if count:
            return total / count
    return 0.0


LARGEST = 1e12  # digital number; larger values are no readings, and squares must fit float32
EPSILON = float(np.finfo(np.float32).eps)


class PixelGain(NamedTuple):
    """Known noise properties of a pixel's numbers; NaN if unknown.

    light       digital number of light over its variance, as `Frame.noise_gain`
    offset      digital number of an empty pixel, less the pivot
    read_noise  digital number rms
    """

    light: float
    offset: float
    read_noise: float

    @property
    def known(self) -> bool:
        """Whether the noise follows from the background."""
        return bool(np.isfinite(self).all())


UNKNOWN = PixelGain(np.nan, np.nan, np.nan)
NONE_DEAD = np.empty((0, 0), np.uint8)


class Pixels(NamedTuple):
    """An image that can be filtered.

    value   (rows, columns) digital number less `pivot`; dead pixels hold their neighbours' mean
    pivot   digital number that was subtracted, so that float32 is precise enough
    step    digital number between two neighbouring values of the image
    dead    (rows, columns) not 0 on dead pixels; None where none is dead
    gain    of its pixels
    """

    value: Singles
    pivot: float
    step: float
    dead: NDArray[np.uint8] | None
    gain: PixelGain = UNKNOWN

    @property
    def marks(self) -> NDArray[np.uint8]:
        """`dead` for kernels: an empty array if no pixel is dead."""
        return NONE_DEAD if self.dead is None else self.dead


def pixels(frame: core.Frame) -> Pixels:
    """Read a frame; pixels that are not finite are dead.

    Raises    TypeError if the image does not hold real numbers; ValueError if it is not
              two-dimensional, is empty, or holds no finite value.
    Accuracy  numerical: 24 bits, 6e-8 of the range of the image.
    """
    image = np.asarray(frame.image)
    if image.dtype.kind not in "iuf":
        raise TypeError(f"image must hold real numbers, got {image.dtype}")
    if image.ndim != 2:
        raise Refused(f"image must have two dimensions (rows, columns), got {image.shape}")
    if not image.size:
        raise Refused(f"image must not be empty, got {image.shape}")
    value, pivot = _narrow(image)
    gain = gain_of(frame, pivot)
    if image.dtype.kind != "f" and image.dtype.itemsize <= 2:
        return Pixels(value, pivot, 1.0, None, gain)
    dead = ~(np.abs(value) < LARGEST)  # NaN too
    if dead.all():
        raise Refused(f"image must hold finite values below {LARGEST:g}, got none")
    marks = None
    if dead.any():
        value, marks = _filled(value, dead), dead.astype(np.uint8)
    rounding = EPSILON * float(np.mean(np.abs(value), dtype=np.float64))
    step = rounding if image.dtype.kind == "f" else max(rounding, 1.0)
    return Pixels(value, pivot, step, marks, gain)


def gain_of(frame: core.Frame, pivot: float) -> PixelGain:
    """Known noise properties of the pixels of a frame."""
    read_noise = frame.read_noise / frame.electrons_per_dn
    return PixelGain(frame.noise_gain, frame.offset - pivot, read_noise)


def _narrow(image: NDArray[np.number]) -> tuple[Singles, float]:
    """The image as native float32; its median is subtracted if float32 alone would lose digits."""
    if image.dtype.itemsize <= (4 if image.dtype.kind == "f" else 2):
        return np.ascontiguousarray(image, np.float32), 0.0
    given = image[np.isfinite(image)]
    pivot = float(np.median(given)) if given.size else 0.0
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(image.astype(np.float64) - pivot, np.float32), pivot


def _filled(value: Singles, dead: Flags) -> Singles:
    """Dead pixels replaced by the mean of their valid neighbours, or else by the median."""
    alive = (~dead).astype(np.float32)
    light = np.where(dead, np.float32(0), value)
    count = cv2.boxFilter(alive, -1, (3, 3), normalize=False)
    total = cv2.boxFilter(light, -1, (3, 3), normalize=False)
    lonely = np.median(value[~dead])
    mean = np.where(count > 0.5, total / np.maximum(count, 1), lonely)
    return np.where(dead, mean, value).astype(np.float32)


HOT = 5.0  # sigma of the frame; above, a pixel's shot noise is comparable to the frame's
NEIGHBOURHOOD = 5  # pixel
SAME_EXPOSURE = 0.05  # relative difference of the exposures of an image and its dark frame


def subtract_dark(frame: core.Frame, dark: core.Frame) -> core.Frame:
    """Subtract a dark frame, and set its hot pixels to NaN.

    A pixel is hot if it exceeds the median of its neighbours in the dark frame by 5 sigma of
    the difference image. Subtraction removes the mean of its dark current, but not the shot noise.
    Therefore it becomes NaN, which `detect` treats as a dead pixel.

    frame, dark  of the same shape, exposure and temperature; the dark frame is best a median of
                 many
    Returns      Frame of float32; its offset is 0, because the dark frame contains the offset
    Raises       ValueError if the shapes differ. Warns of another exposure, if both are known.
    """
    if frame.image.shape != dark.image.shape:
        raise Refused(
            f"dark must have the frame's shape {frame.image.shape}, got {dark.image.shape}"
        )
    if abs(dark.exposure - frame.exposure) > SAME_EXPOSURE * frame.exposure:
        # Without a path: once for all files of a series.
        warnings.warn(
            f"dark has an exposure of {dark.exposure:g} s and the image of {frame.exposure:g} s: "
            "its dark current is not that of the image",
            stacklevel=2,
        )
    difference = np.subtract(frame.image, dark.image, dtype=np.float32)
    level = np.nan_to_num(np.asarray(dark.image, np.float32))
    excess = level - cv2.medianBlur(level, NEIGHBOURHOOD)
    finite = difference[np.isfinite(difference)]
    if len(finite):
        _, noise = clipped(finite, 0.0)
        difference[(excess > HOT * noise) & (excess > 0)] = np.nan
    return replace(frame, image=difference, offset=0.0)


LEAST_RESPONSE = 0.1  # of the mean; a pixel with less response is dead


def divide_flat(frame: core.Frame, flat: core.Frame) -> core.Frame:
    """Divide the light by the response of each pixel; pixels with little response become NaN.

    frame    minus its dark frame, or with the right offset
    flat     image of a uniform surface, best a mean of many
    Returns  Frame of float32 with the same offset
    Raises   ValueError if the shapes differ or the flat holds no light.
    """
    if frame.image.shape != flat.image.shape:
        raise Refused(
            f"flat must have the frame's shape {frame.image.shape}, got {flat.image.shape}"
        )
    response = np.asarray(flat.image, np.float32) - np.float32(flat.offset)
    mean = float(np.nanmean(response)) if np.isfinite(response).any() else 0.0
    if not mean > 0:
        raise Refused(f"flat must hold light above its offset, got a mean of {mean:g}")
    response /= np.float32(mean)
    light = np.asarray(frame.image, np.float32) - np.float32(frame.offset)
    with np.errstate(divide="ignore", invalid="ignore"):
        even = np.where(response >= LEAST_RESPONSE, light / response, np.float32(np.nan))
    return replace(frame, image=(even + np.float32(frame.offset)).astype(np.float32))
