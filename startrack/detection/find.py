"""Pixels -> Peaks of the filtered image that look like stars."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from startrack import core
from startrack.core import Flags, Floats, Ints, Singles, kernel
from startrack.detection.background import SkyBackground, sky, with_gain_noise
from startrack.detection.connect import Peaks, lit, peaks, split
from startrack.detection.examine import (
    has_dead_pixel,
    is_hot,
    largest_fraction,
    levels_to_pass,
    stands_out,
)
from startrack.detection.matched import Kernel, equivalent_sigmas, filtered
from startrack.detection.parameters import Detection
from startrack.detection.pixels import Pixels
from startrack.detection.plan import DetectionPlan

GROUP = "detections"


@dataclass(frozen=True, eq=False)
class DetectionInput:
    """A frame in which a user's detection finds stars.

    value             (rows, columns) digital number above the empty pixel, as the tracker believes
    dead              (rows, columns) whether the tracker knows that a pixel is dead
    electrons_per_dn  divided by a multiplication register's excess noise; NaN if unknown
    read_noise        digital number rms; NaN where unknown
    psf               the star's image that the tracker assumes
    border            pixel that a peak must stay from the border of the frame

    The function returns (n, 2) whole numbers: column and row of the brightest pixel of each star;
    the centroid of the design measures them. Stars nearer to the border than `border` are left out
    """

    value: Singles
    dead: Flags
    electrons_per_dn: float
    read_noise: float
    psf: core.Psf
    border: int


def peaks_by_code(pixels: Pixels, plan: DetectionPlan) -> tuple[Ints, Ints]:
    """Columns and rows (n,) of the stars that a function of the design finds.

    Raises  ValueError if the function raises an error, or returns an invalid result.
    """
    settings, gain = plan.settings, pixels.gain
    name, border = settings.search, settings.window // 2 + settings.edge
    rows, columns = pixels.value.shape
    dead = np.zeros((rows, columns), bool) if pixels.dead is None else pixels.dead > 0
    value = np.asarray(pixels.value - np.nan_to_num(gain.offset), np.float32)
    given = DetectionInput(value, dead, gain.light, gain.read_noise, plan.star.psf, border)
    answer = core.call_code(GROUP, name, given)
    places = core.returned(GROUP, name, answer, (-1, 2)) if np.size(answer) else np.empty((0, 2))
    inside = ((places >= 0) & (places < [columns, rows])).all()
    if not inside or (places != np.rint(places)).any():
        raise ValueError(f"{core.POINTS[GROUP]} {name} must return columns and rows of pixels")
    x, y = np.unique(places.astype(np.int64), axis=0).T
    good = (np.minimum(x, columns - 1 - x) >= border) & (np.minimum(y, rows - 1 - y) >= border)
    return x[good], y[good]


# A star between pixels has a lower peak, so pixels are examined from this fraction on.
EXAMINED = np.float32(0.75)  # of the threshold
KERNEL_TAIL = 2  # pixel; farther pixels of a filtered star are too faint to count


@dataclass(frozen=True, eq=False)
class FrameBackground:
    """Background and noise that the search of a frame compares its pixels with.

    sky   background and noise
    far   sigma by which a star must exceed the level, on the grid of the Sky
    look  digital number from which pixels are examined, on the grid of the Sky
    """

    sky: SkyBackground
    far: Singles
    look: Singles

    @cached_property
    def lowest(self) -> Floats:
        """(down, across) digital number, the least of `look` in each tile."""
        return cv2.erode(self.look, np.ones((3, 3), np.uint8))[1:-1, 1:-1].astype(float)

    @cached_property
    def noise(self) -> float:
        """Digital number, of the filtered frame, in most tiles."""
        return float(np.median(self.sky.rms))


def find(pixels: Pixels, plan: DetectionPlan, mesh: int | None = None) -> Peaks:
    """Filter, compare, connect, and keep the peaks that look like stars.

    Three fast passes go over the whole frame; slow tests are applied only to the peaks.

    mesh  pixel, side of the tiles; None: that of the settings
    """
    if core.is_code(plan.settings.search):
        x, y = peaks_by_code(pixels, plan)
        return Peaks(x, y, np.ones(len(x), np.int64))
    # The memory is reused, because new pages take 0.1 ms per megapixel.
    room = plan.workspace.array("filtered frame", pixels.value.shape, np.float32)
    image = filtered(pixels.value, plan.kernel, room)
    ground = ground_of(pixels, image, plan, mesh)
    return choose(pixels, image, lit(image, ground.look, ground.sky.mesh), ground, plan)


def levels_at(pixels: Pixels, plan: DetectionPlan, x: Ints, y: Ints) -> Floats:
    """Digital number (n,) that the filtered image of a star must exceed at some places.

    If the ring around a place is brighter or less even than its tile, the ring decides.
    """
    image, rules = filtered(pixels.value, plan.kernel), _rules(pixels, plan)
    ground = ground_of(pixels, image, plan)
    bright, waiting = lit(image, ground.look, ground.sky.mesh), np.zeros(image.shape, np.uint8)
    merged = peaks(image, bright, waiting, *rules[:4])
    own = split(pixels.value, merged, ground.sky, rules.noise, rules.shot, rules.border)
    near, law = np.stack([own.x, own.y]), (ground.far, ground.sky, rules.floor)
    return np.asarray(levels_to_pass(image, x, y, rules.ring, *law, near))


def ground_of(
    pixels: Pixels, image: Singles, plan: DetectionPlan, mesh: int | None = None
) -> FrameBackground:
    """Background and noise of the filtered image.

    If the gain is known, the noise is that of photons and read-out (`with_gain_noise`).
    """
    least = rounding(pixels, plan.kernel)
    law = sky(image, mesh or plan.settings.mesh, least)
    if pixels.gain.known:
        law = with_gain_noise(law, pixels.gain, pixels.step, plan.kernel)
    return background_of(law, image.size, plan)


def background_of(law: SkyBackground, area: int, plan: DetectionPlan) -> FrameBackground:
    """Thresholds of the search of a frame, from the distribution of its filtered noise.

    area  pixel, of the frame
    """
    far = equivalent_sigmas(plan.threshold(area), law.skewness, law.kurtosis)
    return FrameBackground(law, far, np.asarray(law.mean + EXAMINED * far * law.rms, np.float32))


def choose(
    pixels: Pixels,
    image: Singles,
    bright: Ints,
    ground: FrameBackground,
    plan: DetectionPlan,
    regions: Ints | None = None,
) -> Peaks:
    """The peaks among the bright pixels of a filtered image that look like stars.

    bright   (n,) row * columns + column of the pixels above the ground's `look`
    regions  (w, 4) left, top, right, bottom that peaks must lie in; None for the whole frame
    """
    waiting = plan.workspace.array("waiting pixels", image.shape, np.uint8)
    if regions is None:
        regions = np.array([[0, 0, image.shape[1], image.shape[0]]])
    images, law = (pixels.value, pixels.marks, image), (ground.sky, ground.far)
    rules = _rules(pixels, plan)
    return Peaks(*_choose(*images, bright, waiting, *law, plan.filters, regions, rules))


class _SpotRules(NamedTuple):
    """Conditions that a peak must meet, for the kernel.

    min_area, max_area  of its connected component, pixel
    half      half side of the square in which it is the highest, pixel
    border    distance from the frame's border, pixel
    ring      half side of the square inside the ring around it, pixel
    noise     fraction of a pixel's noise that the filter leaves
    shot      digital number, variance for each digital number of light; NaN where unknown
    floor     digital number, least noise
    fraction  1, of the sharpest star's light that falls on one row of pixels; 0: any peak is a star
    beside    pixel, distance of dead pixels
    """

    min_area: int
    max_area: int
    half: int
    border: int
    ring: int
    noise: float
    shot: float
    floor: float
    fraction: float
    beside: int


def _rules(pixels: Pixels, plan: DetectionPlan) -> _SpotRules:
    settings, kernel = plan.settings, plan.kernel
    half, sharpest = settings.window // 2, settings.sharpest_sigma
    return _SpotRules(
        min_area=settings.min_area,
        max_area=settings.max_area,
        half=half,
        border=half + settings.edge,
        ring=ring_half(settings, kernel),
        noise=kernel.noise,
        shot=1 / pixels.gain.light,
        floor=rounding(pixels, kernel),
        fraction=largest_fraction(sharpest) if sharpest > 0 else 0.0,
        beside=0 if plan.method.skips_dead else 1,
    )


@kernel
def _choose(
    value: Singles,
    dead: NDArray[np.uint8],
    image: Singles,
    bright: Ints,
    waiting: NDArray[np.uint8],
    ground: SkyBackground,
    far: Singles,
    filters: Floats,
    regions: Ints,
    rules: _SpotRules,
) -> tuple[Ints, Ints, Ints]:
    """Columns, rows and areas of the peaks that `choose` keeps."""
    merged = peaks(image, bright, waiting, rules.min_area, rules.max_area, rules.half, rules.border)
    x, y, area = split(value, merged, ground, rules.noise, rules.shot, rules.border)
    good = _inside(x, y, regions)
    x, y, area = x[good], y[good], area[good]
    good = stands_out(value, image, filters, x, y, rules.ring, far, ground, rules.floor)
    for i in range(len(x)):
        if good[i] and rules.fraction > 0:
            good[i] = not is_hot(value, x[i], y[i], rules.ring, rules.fraction)
        if good[i] and dead.size > 0:
            good[i] = not has_dead_pixel(dead, x[i], y[i], rules.beside)
    return x[good], y[good], area[good]


def rounding(pixels: Pixels, kernel: Kernel) -> float:
    """Least noise of the filtered image, digital number.

    Rounding to steps of 1 is noise of variance 1/12, which the filter reduces like other noise.
    """
    return pixels.step / math.sqrt(12) * kernel.noise


def ring_half(settings: Detection, kernel: Kernel) -> int:
    """Half side of the square inside the ring around a peak, pixel.

    A star's filtered image is twice as long as the kernel, and must not reach its own ring.
    """
    return max(settings.window // 2, 2 * kernel.half - KERNEL_TAIL)


@kernel
def _inside(x: Ints, y: Ints, regions: Ints) -> Flags:
    """Pixels that lie in one of the regions."""
    verdict = np.zeros(len(x), np.bool_)
    for i in range(len(x)):
        for left, top, right, bottom in regions:
            if left <= x[i] < right and top <= y[i] < bottom:
                verdict[i] = True
                break
    return verdict
