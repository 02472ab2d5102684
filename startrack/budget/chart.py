"""Case -> how the tracker's own centroid answers single stars of any place and brightness."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from startrack.case import Case, Instrument
from startrack.chain import psf_of, throughput
from startrack.detection import Detection
from startrack.detection.centroid import centroid
from startrack.detection.find import Candidates, kernel_of
from startrack.detection.matched import filtered
from startrack.detection.pixels import pixels
from startrack.detection.smear import star_image
from startrack.detector import Detector, electron_rate
from startrack.detector.crosstalk import diffuse
from startrack.detector.settle import settle
from startrack.detector.stamp import stamp
from startrack.motion import blur, slew
from startrack.scene import illuminate
from startrack.streams import Streams
from startrack.values import Floats, Frame, Psf, Spots, Stars

PHASES = 6  # sub-pixel places per axis
STEP = 0.5  # magnitude between two rows of the chart
BRIGHTEST = -1.5
MARGIN = 6  # pixel between the rings of two stars
FAINTEST_SNR = 3.0  # below this nothing is detected


class Chart(NamedTuple):
    """Stars of m magnitudes, each at p sub-pixel places, as the tracker measures them.

    magnitude   (m,) G of a sunlike star
    offset      (m, p, 2) pixel, measured minus true; NaN where the tracker drops the star
    covariance  (m, p, 2, 2) pixel^2, as the tracker states it
    """

    magnitude: Floats
    offset: Floats
    covariance: Floats


class Scale(NamedTuple):
    """What light makes of the detector: electrons in an exposure.

    star        of a sunlike star of G = 0
    background  in a pixel, of sky and dark current
    noise       rms of a pixel's own noise, the converter's steps included
    """

    star: float
    background: float
    noise: float

    @property
    def pixel(self) -> float:
        """Electron rms of an empty pixel."""
        return math.hypot(self.noise, math.sqrt(self.background))


def scale(case: Case) -> Scale:
    """The scale of a case; see `electron_rate` for its errors."""
    detector = case.instrument.detector
    light = illuminate(case.scene, _sunlike())
    star, sky = electron_rate(light, detector, throughput(case.instrument))
    solid_angle = case.instrument.camera.focal_length_px**-2
    dark = detector.dark_rate
    if detector.defects:
        growth = detector.thermal.growth if detector.thermal else 1.0
        dark += detector.defects.hot * detector.defects.hot_current * growth * detector.binning**2
    return Scale(
        float(star[0]) * detector.exposure,
        (float(sky) * solid_angle + dark) * detector.exposure,
        math.hypot(detector.noise, detector.electrons_per_dn / math.sqrt(12)),
    )


def chart(
    case: Case,
    magnitude: Floats,
    gain: Floats | None = None,
    extra: Floats | None = None,
    noisy: bool = True,
) -> Chart:
    """Measure stars without noise, as the tracker would.

    A star without noise has the error of its centroid's method alone, and the covariance that the
    tracker states of it is that of its noise. Where the ring about a star is even, the tracker's
    background is what it never is among noise; so the pixels alternate by their noise like a
    chessboard, which moves no centroid.

    magnitude  (m,) G
    gain       (m, p, side, side) 1, response of the pixels about each star; None for all alike
    extra      (m, p, side, side) electron in them; None for none
    noisy      whether the tracker believes the pixels to have noise of their own
    """
    size, detector, detection = scale(case), case.instrument.detector, case.tracker.detection
    point, psf = _point(case.instrument, detection)
    side = point.shape[-1]
    electrons = size.star * 10 ** (-0.4 * magnitude[:, None, None, None]) * point
    if gain is not None:
        electrons = electrons * gain
    electrons = electrons + size.background
    if extra is not None:
        electrons = electrons + extra
    level = _signal(electrons, detector)
    board = np.indices((side, side)).sum(axis=0) % 2 * 2 - 1
    level = level + (size.pixel if noisy else math.sqrt(size.background)) * board
    count = len(magnitude)
    image = level.reshape(count, PHASES, PHASES, side, side)
    image = image.transpose(0, 1, 3, 2, 4).reshape(count * PHASES * side, PHASES * side)
    image = np.minimum(image / detector.electrons_per_dn + detector.offset, 2.0**detector.bits - 1)
    frame = Frame(
        image.astype(np.float32),
        detector.exposure,
        detector.electrons_per_dn,
        float(detector.offset),
        size.noise if noisy else 0.0,
    )
    return Chart(magnitude, *_measured(frame, side, count, detection, psf))


def _measured(
    frame: Frame, side: int, count: int, detection: Detection, psf: Psf
) -> tuple[Floats, Floats]:
    """Offsets and covariances, by the cells that the spots lie in."""
    rows, columns = np.arange(count * PHASES), np.arange(PHASES)
    row, column = (
        grid.ravel() * side + side // 2 for grid in np.meshgrid(rows, columns, indexing="ij")
    )
    every = replace(detection, max_spots=2**20)
    candidates = Candidates(column, row, np.ones(len(row), np.int64))
    spots: Spots = centroid(frame, pixels(frame), candidates, every, star_image(detection, psf))
    place = np.column_stack([spots.x, spots.y])
    cell = np.floor((place + 0.5) / side).astype(np.int64)
    star = cell[:, 1] * PHASES + cell[:, 0]
    offset = np.full((len(row), 2), np.nan)
    covariance = np.full((len(row), 2, 2), np.nan)
    offset[star] = place - np.column_stack([column, row])[star] - _phases()[star % PHASES**2]
    covariance[star] = spots.covariance
    return offset.reshape(count, -1, 2), covariance.reshape(count, -1, 2, 2)


def detected(case: Case, magnitude: Floats) -> Floats:
    """Share of the stars (m,) of a magnitude whose filtered peak passes the threshold.

        share = mean over places of Phi(peak / noise - threshold)

    Errors  model: the noise of the peak is that of an empty sky; neighbours, and the tests that
            tell a star from a hot pixel, are left out.
    """
    size, detection = scale(case), case.tracker.detection
    point, psf = _point(case.instrument, detection)
    kernel = kernel_of(detection, star_image(detection, psf))
    middle = point.shape[-1] // 2
    peak = np.empty(len(point))
    for i, one in enumerate(point):
        near = filtered(one.astype(np.float32), kernel)[
            middle - 1 : middle + 2, middle - 1 : middle + 2
        ]
        peak[i] = near.max()
    snr = size.star * 10 ** (-0.4 * magnitude[:, None]) * peak / (size.pixel * kernel.noise)
    return np.asarray(ndtr(snr - detection.threshold).mean(axis=1))


def magnitudes(case: Case, faintest: float) -> Floats:
    """The magnitudes of a chart: from the brightest stars to those that are hardly detected."""
    size = scale(case)
    point, _ = _point(case.instrument, case.tracker.detection)
    sharpness = math.sqrt(float((point**2).sum()) / len(point))
    limit = 2.5 * math.log10(size.star * sharpness / size.pixel / FAINTEST_SNR)
    end = max(min(faintest, limit) + STEP, BRIGHTEST + 2 * STEP)
    return np.arange(BRIGHTEST, end + STEP, STEP)


def pattern(cause: str, shape: tuple[int, ...]) -> Floats:
    """Fixed normal numbers: what one copy of a detector has, the same in all designs."""
    return _pattern(cause, shape)


@lru_cache(maxsize=8)
def _pattern(cause: str, shape: tuple[int, ...]) -> Floats:
    draw = Streams(0, 0)(cause).standard_normal(shape)
    draw.flags.writeable = False
    return draw


def side_of(case: Case) -> int:
    """Pixel, of the cell that a star of the chart has for itself."""
    return int(_point(case.instrument, case.tracker.detection)[0].shape[-1])


@lru_cache(maxsize=64)
def _point(instrument: Instrument, detection: Detection) -> tuple[Floats, Psf]:
    """A star's light in the pixels about each of its places (p, side, side), and the PSF."""
    psf, detector, camera = psf_of(instrument), instrument.detector, instrument.camera
    pixel = 1 / camera.focal_length_px
    motion = instrument.motion
    steady = replace(motion, tones=(), broadband=())
    jitter = blur(replace(motion, rate_x=0.0, rate_y=0.0, rate_z=0.0), detector.exposure, pixel)
    if jitter.any():
        wide = (
            float(np.hypot(jitter[0], jitter[1])) / math.sqrt(2) * instrument.optics.image_distance
        )
        lens = replace(instrument.optics, blur=math.hypot(instrument.optics.blur, wide))
        shaken = replace(instrument, optics=lens, motion=steady)
        return _point(shaken, detection)[0], psf
    path = slew(steady, detector.exposure, pixel, camera.half_diagonal)
    run = float(np.abs(path.rotation[:, :2]).max()) / pixel
    ring = detection.window // 2 + 3
    side = 2 * (max(ring + math.ceil(run), math.ceil(psf.half_width)) + MARGIN // 2) + 1
    phases = _phases()
    image = np.zeros((PHASES * side, PHASES * side))
    column, row = (grid.ravel() for grid in np.meshgrid(*2 * (np.arange(PHASES),)))
    for weight, turn in zip(path.weight, path.rotation, strict=True):
        x = column * side + side // 2 + phases[:, 0] + turn[1] / pixel
        y = row * side + side // 2 + phases[:, 1] - turn[0] / pixel
        stamp(image, psf, x, y, np.full(len(x), weight))
    if detector.crosstalk:
        image = diffuse(image, detector.crosstalk)
    cells = image.reshape(PHASES, side, PHASES, side).transpose(0, 2, 1, 3)
    return np.ascontiguousarray(cells.reshape(-1, side, side)), psf


@lru_cache(maxsize=1)
def _phases() -> Floats:
    """(p, 2) pixel, x and y from the middle of the pixel."""
    line = (np.arange(PHASES) + 0.5) / PHASES - 0.5
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


def _signal(electrons: Floats, detector: Detector) -> Floats:
    """What the converter sees of electrons, without noise."""
    held = np.minimum(electrons, detector.full_well)
    level = held * (1 - detector.bend * held / detector.full_well)
    if detector.settling:
        flat = level.reshape(-1, level.shape[-1])
        level = settle(flat, detector.settling).reshape(level.shape)
    return np.asarray(level)


def _sunlike() -> Stars:
    one = np.zeros(1)
    return Stars(np.zeros(1, np.int64), np.zeros((1, 3)), one, np.full(1, np.nan))
