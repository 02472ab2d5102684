"""An image, and expected places of stars -> the brightest image in a box around each place.

From exposure to exposure an image keeps its place until its star has moved by a limit.
"""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from startrack import core
from startrack.core import (
    POSITIVE,
    Flags,
    Floats,
    Ints,
    Parameters,
    Refused,
    Singles,
    arcsec,
    parameter,
)
from startrack.detection.pixels import PixelGain, corrected, gain_of
from startrack.detection.plan import DetectionPlan

SIZES = (4, 6, 8)
BACKGROUNDS = ("dynamic", "clipped", "none")
# Pixels of the dynamic background, from the pixel right below the middle: two at each end of the
# first and the last row of 8 x 8.
CORNERS = tuple((row, column) for row in (-4, 3) for column in (-4, -3, 2, 3))
MIDDLE = slice(2, 6)  # of eight sorted pixels; their mean is the background, without outliers
# times the mean, and digital numbers: a pixel that deviates by more is clipped
FAR, FAR_NUMBERS = 1.5, 10.0
ROUNDS = 4  # iterations of moving the image until the star is in its middle
IMAGE = 8  # pixel, size of the largest image; the search needs pixels around it
CORNER_ROWS, CORNER_COLUMNS = np.transpose(CORNERS) + IMAGE // 2  # of the largest image


APPARENT = "magnitudes by which a star may seem fainter or brighter than its catalogue says"


class Box(Parameters):
    """Search boxes around expected places of stars, as in trackers that are commanded which stars
    to take.

    The numbers of a box, less the offset, are added in blocks of 2 x 2 pixels. A block is a hit if
    its light exceeds `hit` times the light of the faintest accepted star. If there are more than
    `hits`, the others are dropped, evenly over the box, and the star may be among them. An image of
    `size` pixels a side is read at each hit that exceeds the hits beside it; it is moved until its
    first moment lies in its middle. Among the images whose magnitude agrees with the star within
    the limits, the brightest is taken; it may be a hot pixel or another star. The image keeps its
    place from one exposure of a sequence to the next. If the moment is more than `moves` from its
    middle, the image moves by a pixel in the next exposure.

    Source: the method is that of Chandra's aspect camera. Published are the blocks, their limit and
    the images (sot/proseco, acq.py), that the number of hits is limited (analysis/maxmag), the
    eight pixels of the background (characteristics.py) and their clipping (annie-lite.py). `hit`
    and `hits` fit the conditions under which its bench counts 50 hits (docs/figures/flight.md).
    Which hits are dropped, and how neighbouring hits are merged, is assumed.
    """

    half_width: float = parameter(
        "half side of a box", unit=core.Unit("rad", "arcsec"), limit=POSITIVE, default=120 * arcsec
    )
    size: int = parameter("pixel, side of an image: 4, 6 (without its corners) or 8", default=6)
    background: str = parameter(
        '"dynamic": middle half of eight pixels at the corners of 8 x 8; "clipped": mean of those '
        "of the eight within 1.5 times their mean of it, or within 10 digital numbers, the "
        'farthest left out first; "none": 0',
        limit=core.Range(choices=BACKGROUNDS),
        default="dynamic",
    )
    fainter: float = parameter(APPARENT, limit=POSITIVE, default=1.5)
    brighter: float = parameter(APPARENT, limit=POSITIVE, default=1.5)
    hit: float = parameter(
        "light of a block of 2 x 2 pixels, of that of the faintest star that is accepted, above "
        "which it is a hit",
        limit=core.Range(0.01, 10),
        default=0.5,
    )
    hits: int = parameter(
        "blocks of a box at most, of which images are read", limit=core.Range(1, 10_000), default=28
    )
    moves: float = parameter(
        "pixel, of the moment from the middle, from which on an image moves",
        limit=core.Range(0.4, 2.0),
        default=0.53,
    )
    stars: int = parameter(
        "boxes, about the brightest stars of the catalogue in the field",
        limit=core.Range(2, 1000),
        default=8,
    )
    prior: float = parameter(
        "radian rms per axis, error of the attitude that a single trial expects the stars by; "
        "in a sequence it is that of the filter",
        unit=core.Unit("rad", "arcsec"),
        limit=POSITIVE,
        default=4 * arcsec,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.size not in SIZES:
            raise Refused(f"size must be one of 4, 6 and 8, got {self.size}")


class Taken(NamedTuple):
    """Pixels taken in each box; NaN where nothing was taken.

    x, y        (m,) pixel, first moment minus the mean offset of a star's image
    flux        (m,) digital number of the whole star, estimated from its image
    covariance  (m, 2, 2) pixel^2, by the noise of the pixels and by the light outside the image;
                without dark current that the tracker does not know
    snr         (m,) 1
    corner      (m, 2) pixel (column, row) right below the middle of the image of the next
                exposure; -1 where nothing was taken
    """

    x: Floats
    y: Floats
    flux: Floats
    covariance: Floats
    snr: Floats
    corner: Ints

    @property
    def found(self) -> Flags:
        """Whether there was something (m,)."""
        return np.isfinite(self.x)

    def spots(self) -> core.Spots:
        """The images that were found."""
        x, y, flux, covariance, snr = (values[self.found] for values in self[:5])
        return core.Spots(x, y, flux, covariance, snr, np.ones(len(x), np.int64))


class StarImage(NamedTuple):
    """Image of a star at any place in the middle pixel of an image of some size.

    fraction  1, mean fraction of its light in the image, above the subtracted background
    moment    pixel (x, y), mean offset of its first moment from its place
    scatter   pixel rms (x, y), scatter of this offset, by light outside the image
    """

    fraction: float
    moment: tuple[float, float]
    scatter: tuple[float, float]


def box_reach(box: Box, focal_length_px: float) -> float:
    """Half side of a box, pixel."""
    return math.tan(box.half_width) * focal_length_px


def take(
    frame: core.Frame,
    place: Floats,
    flux: Floats,
    reach: float,
    box: Box,
    plan: DetectionPlan,
    corners: Ints | None = None,
) -> Taken:
    """Search a box about each place.

    place    (m, 2) pixel (x, y), where stars are expected
    flux     (m,) digital number of each star, by the catalogue
    reach    pixel, half side of a box
    plan     of the tracker; its dark map, if it has one, is subtracted
    corners  (m, 2) pixel, of images of the exposure before, as in `Taken`; an image inside its box
             is measured at its place, without a search
    Returns  Taken; NaN where a box leaves the frame or nothing in it passes the limits
    """
    image = np.asarray(frame.image, np.float32)
    if plan.correction is not None:
        image = corrected(image, plan.correction, plan.settings.saturation)
    expected = star_image(plan.star.psf, box)
    gain = gain_of(frame, 0.0)
    measured = []
    for n, (at, light) in enumerate(zip(place, flux, strict=True)):
        corner = (-1, -1) if corners is None else (int(corners[n, 0]), int(corners[n, 1]))
        if min(corner) >= 0 and (np.abs(np.array(corner) - 0.5 - at) <= reach).all():
            measured.append(_measure(image, corner, box, expected, gain))
            continue
        peak = _search(image, at, light, reach, box, expected, gain.offset)
        measured.append(_settled(image, peak, box, expected, gain) if peak else NOTHING)
    return _taken(measured)


def follow(frame: core.Frame, corner: Ints, box: Box, plan: DetectionPlan) -> Ints:
    """Places of images in the next exposure, without comparison with the catalogue.

    corner   (m, 2) pixel, as `Taken` of the exposure before has it
    Returns  (m, 2) likewise; -1 if an image leaves the frame, has no light or has lost its star
    """
    image = np.asarray(frame.image, np.float32)
    if plan.correction is not None:
        image = corrected(image, plan.correction, plan.settings.saturation)
    seen = _moments(image, np.asarray(corner), box, gain_of(frame, 0.0).offset)
    return np.where(np.isfinite(seen.total)[:, None], corner + _steps(seen.moment, box), -1)


def _taken(measured: list[tuple[float, ...]]) -> Taken:
    columns = np.array(measured, float).reshape(-1, 9).T
    x, y, total, xx, xy, yy, sigma, column, row = columns
    covariance = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    corner = np.nan_to_num(np.column_stack([column, row]), nan=-1.0).astype(np.int64)
    return Taken(x, y, total, covariance, total / sigma, corner)


NOTHING = (math.nan,) * 9


@lru_cache(maxsize=16)
def star_image(psf: core.Psf, box: Box) -> StarImage:
    """Flux, centroid and scatter of a star's image in a box, over its places in a pixel."""
    # At the samples of the table, from one edge of the pixel to the other.
    places = 0.5 - np.arange(psf.oversampling + 1) / psf.oversampling
    share = np.ones(len(places))
    share[[0, -1]] = 0.5
    half, side, mask = IMAGE // 2, box.size // 2, image_mask(box.size)
    inner = slice(half - side, half + side)
    sums, moments = [], []
    for y in places:
        for x in places:
            pixel = _table(psf, x, y, half)
            light = pixel[inner, inner]
            if box.background == "dynamic":
                light = light - corner_level(pixel)
            if box.background == "clipped":
                light = light - pixel[CORNER_ROWS, CORNER_COLUMNS].mean()
            sums.append((light * mask).sum())
            moments.append(_moment(light * mask) - (x, y))
    weight = np.outer(share, share).ravel() / share.sum() ** 2
    mean = weight @ np.array(moments)
    scatter = np.sqrt(weight @ (np.array(moments) - mean) ** 2)
    return StarImage(
        float(weight @ sums),
        (float(mean[0]), float(mean[1])),
        (float(scatter[0]), float(scatter[1])),
    )


def corner_level(pixel: NDArray[Any]) -> Any:
    """The dynamic background (...) of images (..., 8, 8)."""
    return np.sort(pixel[..., CORNER_ROWS, CORNER_COLUMNS])[..., MIDDLE].mean(axis=-1)


def _table(psf: core.Psf, x: float, y: float, half: int) -> Floats:
    """Fractions in 2 half x 2 half pixels of a star (x, y) pixel from the middle of the image."""
    middle = len(psf.table) // 2
    step = np.arange(-half, half) + 0.5
    at = [np.rint((step - place) * psf.oversampling).astype(int) + middle for place in (y, x)]
    inside = [(coordinate >= 0) & (coordinate < len(psf.table)) for coordinate in at]
    clipped = [np.clip(coordinate, 0, len(psf.table) - 1) for coordinate in at]
    return np.asarray(psf.table[np.ix_(*clipped)] * np.outer(*inside))


def image_mask(size: int) -> Floats:
    """Pixels of an image that count: all, except the corners of a 6 x 6 image."""
    mask = np.ones((size, size))
    if size == 6:
        mask[[0, 0, -1, -1], [0, -1, 0, -1]] = 0
    return mask


def _moment(light: Floats) -> Floats:
    """First moment (x, y) of an image from its middle, pixel."""
    step = np.arange(len(light)) - (len(light) - 1) / 2
    total = float(light.sum())
    return np.array([(light.sum(axis=0) @ step), (light.sum(axis=1) @ step)]) / total


def _search(
    image: Singles,
    at: Floats,
    flux: float,
    reach: float,
    box: Box,
    expected: StarImage,
    offset: float,
) -> tuple[int, int] | None:
    """Column and row of the pixel right below the middle of the image that is taken."""
    rows, columns = image.shape
    # The middle of an even image lies between pixels.
    if not (np.abs(at) < rows + columns).all():
        return None
    low = np.ceil(at - reach).astype(int)
    side = np.floor(at + reach).astype(int) + 1 - low
    high, half = low + side + side % 2, IMAGE // 2
    if (low < half).any() or high[0] > columns - half or high[1] > rows - half:
        return None
    level = np.float32(offset if math.isfinite(offset) else 0.0)
    window = image[low[1] : high[1], low[0] : high[0]] - level
    blocks = window.reshape(len(window) // 2, 2, -1, 2).sum(axis=(1, 3))
    least, most = flux * 10 ** (-0.4 * box.fainter), flux * 10 ** (0.4 * box.brighter)
    corner = low + 2 * _peaks(blocks, box.hit * least, box.hits) + 1
    for _ in range(ROUNDS):
        seen = _moments(image, corner, box, offset)
        step = _steps(seen.moment, box)
        if not step.any():
            break
        corner = corner + step
    light = seen.total / expected.fraction
    light = np.where((light >= least) & (light <= most), light, -np.inf)
    if not np.isfinite(light).any():
        return None
    best = corner[int(np.argmax(light))]
    return int(best[0]), int(best[1])


def _peaks(blocks: Singles, limit: float, most: int) -> Ints:
    """Column and row (m, 2) of blocks above a limit that no other beside them exceeds."""
    hits = np.flatnonzero(blocks > limit)
    if len(hits) > most:
        hits = hits[np.arange(most) * len(hits) // most]
    kept = np.zeros_like(blocks)
    kept.ravel()[hits] = blocks.ravel()[hits]
    row, column = np.nonzero((kept > 0) & (kept == cv2.dilate(kept, np.ones((3, 3), np.uint8))))
    return np.column_stack([column, row])


class _ImageLight(NamedTuple):
    """Light of images.

    level   (m,) digital number, of the background of a pixel
    total   (m,) digital number above it; NaN for images beyond the frame, without light or with a
            moment beyond them
    moment  (m, 2) pixel (x, y), first moments from the middles; zero for these images
    """

    level: Floats
    total: Floats
    moment: Floats


def _moments(image: Singles, corner: Ints, box: Box, offset: float) -> _ImageLight:
    """Light of images whose pixels right below their middles are `corner` (m, 2)."""
    rows, columns = image.shape
    side, half = box.size // 2, IMAGE // 2
    inside = ((corner >= half) & (corner <= np.array([columns, rows]) - half)).all(axis=1)
    near, inner = np.arange(-half, half), slice(half - side, half + side)
    column, row = corner[inside].T[:, :, None, None]
    window = image[row + near[:, None], column + near]
    background = level_of_image(window, box, offset)
    light = (window[:, inner, inner].astype(float) - background[:, None, None]) * image_mask(
        box.size
    )
    step, found = np.arange(box.size) - (box.size - 1) / 2, light.sum(axis=(1, 2))
    with np.errstate(invalid="ignore", divide="ignore"):
        at = np.column_stack([light.sum(axis=1) @ step, light.sum(axis=2) @ step]) / found[:, None]
    good = (found > 0) & (np.abs(at) <= side).all(axis=1)
    level, total = np.full((2, len(corner)), math.nan)
    seen = _ImageLight(level, total, np.zeros((len(corner), 2)))
    seen.level[inside] = background
    seen.total[inside] = np.where(good, found, math.nan)
    seen.moment[inside] = np.where(good[:, None], at, 0.0)
    return seen


def _steps(moment: Floats, box: Box) -> Ints:
    """Motion (m, 2), pixel, of images with these moments."""
    far = np.sign(moment) * np.maximum(np.rint(np.abs(moment)), 1.0)
    return np.where(np.abs(moment) > box.moves, far, 0.0).astype(np.int64)


def level_of_image(pixel: NDArray[Any], box: Box, offset: float) -> Any:
    """Background (...) of a pixel in images (..., 8, 8) of digital numbers with their offset."""
    level = offset if math.isfinite(offset) else 0.0
    if box.background == "none":
        return np.full(pixel.shape[:-2], level)
    if box.background == "dynamic":
        return corner_level(pixel)
    return level + clipped_level(pixel.astype(float) - level)


def clipped_level(pixel: NDArray[Any]) -> Any:
    """The clipped background (...) of images (..., 8, 8) of digital numbers without offset.

    Of the eight pixels the farthest from their mean is left out while it is farther than 1.5 times
    that mean and than 10 numbers.
    """
    value = pixel[..., CORNER_ROWS, CORNER_COLUMNS]
    kept = np.ones(value.shape, bool)
    while True:
        mean = value.mean(axis=-1, where=kept, keepdims=True)
        far = np.where(kept, np.abs(value - mean), -1.0)
        clipped = far > np.maximum(FAR * mean, FAR_NUMBERS)
        clipped &= np.arange(len(CORNERS)) == far.argmax(axis=-1)[..., None]
        if not clipped.any():
            return mean[..., 0]
        kept &= ~clipped


def _settled(
    image: Singles, corner: tuple[int, int], box: Box, expected: StarImage, gain: PixelGain
) -> tuple[float, ...]:
    """Like `_measure`, for an image that is moved until its moment lies in its middle."""
    measured: tuple[float, ...] = NOTHING
    for _ in range(ROUNDS + 1):
        measured = _measure(image, corner, box, expected, gain)
        after = measured[-2:]
        if not math.isfinite(after[0]) or after == corner:
            break
        corner = int(after[0]), int(after[1])
    return measured


def _measure(
    image: Singles, corner: tuple[int, int], box: Box, expected: StarImage, gain: PixelGain
) -> tuple[float, ...]:
    """Place, flux, covariance (xx, xy, yy), sigma of the flux, and the next corner of an image."""
    seen = _moments(image, np.array([corner]), box, gain.offset)
    total, moment = float(seen.total[0]), seen.moment[0]
    if not math.isfinite(total):
        return NOTHING
    (column, row), side, mask = corner, box.size // 2, image_mask(box.size)
    raw = image[row - side : row + side, column - side : column + side].astype(float)
    step = _steps(moment, box)
    place = np.array([column, row]) - 0.5 + moment - expected.moment
    noise = gain.read_noise**2 + np.maximum(raw - gain.offset, 0) / gain.light
    noise = np.where(np.isfinite(noise), noise, float(seen.level[0])) * mask
    away = np.arange(box.size) - (box.size - 1) / 2
    dx, dy = np.meshgrid(away - moment[0], away - moment[1])
    pairs = (dx, dx), (dx, dy), (dy, dy)
    xx, xy, yy = (float((noise * a * b).sum()) / total**2 for a, b in pairs)
    xx, yy = xx + expected.scatter[0] ** 2, yy + expected.scatter[1] ** 2
    sigma = math.sqrt(float(noise.sum()))
    further = column + float(step[0]), row + float(step[1])
    return (*place, total / expected.fraction, xx, xy, yy, sigma / expected.fraction, *further)
