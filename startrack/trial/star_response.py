"""Case -> response of the tracker's centroid to single stars of any flux."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import ndimage
from scipy.special import ndtr

from startrack.core import Floats, Frame, Psf, Stars, Streams, kept
from startrack.design import Case, Instrument
from startrack.detection import (
    Candidates,
    Detection,
    DetectionPlan,
    chance_kept,
    filtered,
    pixels,
    places,
)
from startrack.detector import (
    Detector,
    device_streams,
    diffuse,
    electron_rate,
    nonlinear_signal,
    normals,
    offsets,
    read_noise,
    settle,
    stamp,
    with_adc_inl,
)
from startrack.motion import blur, slew
from startrack.scene import illuminate
from startrack.trial.conditions import dark_electrons
from startrack.trial.view import as_believed, detection_plan, psf_of, throughput


def noise_free_frame(electrons: Floats, detector: Detector, ripple: float, noise: float) -> Frame:
    """A noise-free frame in which the tracker estimates the background as it does with noise.

    In a ring of equal pixels the tracker would clip, and fit slopes, as in no real frame. So the
    pixels alternate by their noise, like a chessboard: the ring has the correct spread, and the
    moments of a star do not change.

    electrons  (rows, columns) expected
    ripple     electron, by which pixels alternate
    noise      electron rms, of a pixel without light, as the tracker believes
    Returns    Frame of numbers that are not rounded
    """
    largest = 2.0**detector.bits - 1
    level = np.minimum(electrons, detector.full_well)
    if detector.nonlinearity:
        level = nonlinear_signal(level, detector.full_well, detector.nonlinearity)
    if detector.settling:
        level = settle(level, detector.settling)
    level += ripple
    level[::2, 1::2] -= 2 * ripple
    level[1::2, ::2] -= 2 * ripple
    level /= detector.electrons_per_dn
    level += detector.offset
    if detector.adc_inl:
        level = with_adc_inl(level, level / largest, detector.adc_inl)
    return Frame(
        np.minimum(level, largest).astype(np.float32),
        detector.exposure,
        detector.electrons_per_dn,
        float(detector.offset),
        noise,
    )


def pixel_noise(detector: Detector, streams: Streams) -> Floats:
    """The noise (rows, columns) that read-out adds, electron; its draws are those of `read_out`."""
    shape = detector.rows, detector.columns
    noise = np.zeros(shape)
    if detector.read_noise:
        noise += read_noise(detector) * normals(shape, streams, "read noise")
    if detector.reset_noise:
        noise += detector.reset_noise * normals(shape, streams, "reset noise")
    if detector.pattern:
        for offset in offsets(detector.pattern, shape, device_streams(detector), streams):
            noise += offset
    return noise / detector.em_gain


PHASES = 6  # sub-pixel positions per axis
STEP = 0.5  # magnitude between two rows of the chart
BRIGHTEST = -1.5
RING = 3  # pixel, width of the ring around the window that gives the background
NEAR = 0.8  # of saturation, from which on a star may reach it; chosen by hand
FAINTEST_SNR = 3.0  # below this no star is detected


class Chart(NamedTuple):
    """Stars of m magnitudes, each at p sub-pixel positions, as the tracker measures them.

    magnitude   (m,) G of a sunlike star
    offset      (m, p, 2) pixel, measured minus true; NaN where the tracker drops the star
    once        (m, p, 2) the same of one measurement, see `measure`
    covariance  (m, p, 2, 2) pixel^2, as the tracker states it
    """

    magnitude: Floats
    offset: Floats
    once: Floats
    covariance: Floats


class Scale(NamedTuple):
    """Signal levels of a detector: electrons in an exposure.

    star        of a sunlike star of G = 0
    background  in a pixel, of the sky's light and dark current
    noise       rms of a pixel without light, with that of the quantisation
    largest     in a pixel, within full-well capacity and range of the converter
    """

    star: float
    background: float
    noise: float
    largest: float

    @property
    def pixel(self) -> float:
        """Electron rms of an empty pixel."""
        return math.hypot(self.noise, math.sqrt(self.background))


@lru_cache(maxsize=16)
def scale(case: Case) -> Scale:
    """The scale of a case; see `electron_rate` for its errors. Kept for the 16 last cases."""
    detector = case.instrument.detector
    one = np.zeros(1)
    sunlike = Stars(np.zeros(1, np.int64), np.zeros((1, 3)), one, np.full(1, np.nan))
    light = illuminate(case.scene, sunlike)
    star, sky = electron_rate(light, detector, throughput(case.instrument))
    solid_angle = case.instrument.camera.focal_length_px**-2
    return Scale(
        float(star[0]) * detector.exposure,
        float(sky) * solid_angle * detector.exposure + dark_electrons(detector)[0],
        math.hypot(detector.noise, detector.electrons_per_dn / math.sqrt(12)),
        min(
            detector.full_well,
            (2**detector.bits - 1 - detector.offset) * detector.electrons_per_dn,
        ),
    )


def chart(
    case: Case,
    magnitude: Floats,
    gain: Floats | None = None,
    extra: Floats | None = None,
    noisy: bool = True,
    point: Floats | None = None,
    place: Floats | None = None,
    believed: bool = True,
    once: bool = False,
) -> Chart:
    """Measure stars without noise, as the tracker would.

    The error of a star without noise is that of the centroid method alone; the covariance that
    the tracker states is that of the noise.

    magnitude  (m,) G
    gain       (m, p, side, side) 1, response of the pixels around each star; None: uniform
    extra      (m, p, side, side) electron to add to them; None: none
    noisy      whether the tracker believes that pixels without light have noise
    point      (p, side, side) fraction of a star's light in each pixel; None: `point_images`
    place      (p, 2) pixel, their sub-pixel positions; None: `phases`
    believed   whether the tracker reads the numbers as those of its design; false: as what they
               are, so that the covariance is the true one
    once       as of `measure`
    """
    light = scale(case).star * 10 ** (-0.4 * magnitude[:, None, None, None])
    electrons = light * (point_images(case) if point is None else point)
    if gain is not None:
        electrons = electrons * gain
    if extra is not None:
        electrons = electrons + extra
    side, shape = electrons.shape[-1], electrons.shape[:2]
    every = electrons.reshape(-1, side, side)
    place_true = phases() if place is None else place
    found, covariances = _measurements(case, every, noisy, believed, once)
    return Chart(
        magnitude,
        _mean(found).reshape(*shape, 2) - place_true,
        found[0].reshape(*shape, 2) - place_true,
        _mean(covariances).reshape(*shape, 2, 2),
    )


def kept_fraction(case: Case, plain: Chart, point: Floats | None = None) -> Floats:
    """Chance (m, p) that the tracker measures a detected star and takes it for no hot pixel.

    plain  chart of the same stars, without `gain` and `extra`
    point  as `chart` takes it
    """
    light = scale(case).star * 10 ** (-0.4 * plain.magnitude[:, None, None, None])
    electrons = light * (point_images(case) if point is None else point)
    chance = _chance_kept(case, electrons.reshape(-1, *electrons.shape[2:]))
    return np.where(np.isfinite(plain.offset[..., 0]), chance.reshape(electrons.shape[:2]), 0.0)


def noise_covariance(
    case: Case, plain: Chart, point: Floats | None = None, place: Floats | None = None,
    once: bool = False,
) -> Floats:  # fmt: skip
    """The true covariance (m, p, 2, 2) pixel^2 of a chart, by the case `without_saturation`.

    plain, point, place, once  as `kept_fraction` and `chart` take them
    """
    detection, bold = case.tracker.detection, without_saturation(case)
    if case.design is not None:
        return chart(bold, plain.magnitude, None, None, True, point, place, False, once).covariance
    if detection.saturation is None:
        return plain.covariance
    size = scale(case)
    point = point_images(case) if point is None else point
    peak = size.star * 10 ** (-0.4 * plain.magnitude) * float(point.max())
    peak += size.background + size.pixel
    detector = case.instrument.detector
    # As many as may reach it, whatever their place and the converter: the others are as they are.
    near = detector.offset + peak / detector.electrons_per_dn > NEAR * detection.saturation
    covariance = plain.covariance.copy()
    if near.any():
        covariance[near] = chart(
            bold, plain.magnitude[near], point=point, place=place, once=once
        ).covariance
    return covariance


def without_saturation(case: Case) -> Case:
    """A case whose tracker overstates the covariance of no saturated star."""
    detection = replace(case.tracker.detection, saturation=None)
    return replace(case, tracker=replace(case.tracker, detection=detection))


def measure(
    case: Case,
    electrons: Floats,
    noisy: bool = True,
    believed: bool = True,
    once: bool = False,
) -> tuple[Floats, Floats]:
    """The tracker's centroids of stars, each in a separate cell.

    electrons  (n, side, side) of the star in the pixels of its cell, side odd
    believed   as of `chart`
    once       whether the chessboard of `noise_free_frame` may move them all, as only differences
               count
    Returns    (n, 2) pixel from the middle of the cell, (n, 2, 2) pixel^2 as stated; NaN for a
               star that the tracker drops
    """
    places, covariances = _measurements(case, electrons, noisy, believed, once)
    return _mean(places), _mean(covariances)


def _measurements(
    case: Case, electrons: Floats, noisy: bool, believed: bool, once: bool
) -> tuple[list[Floats], list[Floats]]:
    """What `measure` averages: places and covariances with one chessboard or with both."""
    size, detection = scale(case), case.tracker.detection
    noise = size.noise if noisy else 0.0
    ripple = math.hypot(noise, math.sqrt(size.background))
    every = replace(detection, max_spots=2**20)
    plan = detection_plan(case, every)
    # A chessboard moves a fit of a narrow star, as far one way as its negative the other way.
    signs = (1, -1) if plan.method.skips_dead and not once else (1,)
    found = [_measured(case, electrons, sign * ripple, noise, plan, believed) for sign in signs]
    return [place for place, _ in found], [covariance for _, covariance in found]


def _mean(values: list[Floats]) -> Floats:
    return values[0] if len(values) == 1 else (values[0] + values[1]) / 2


def _measured(
    case: Case,
    electrons: Floats,
    ripple: float,
    noise: float,
    plan: DetectionPlan,
    believed: bool,
) -> tuple[Floats, Floats]:
    """`measure` with one ripple."""
    frame, across = _in_cells(case, electrons, ripple, noise, believed)
    side = electrons.shape[-1]
    row, column = np.divmod(np.arange(len(electrons)), across) * np.array(side) + side // 2
    candidates = Candidates(column, row, np.ones(len(row), np.int64))
    found, covariance = places(frame, pixels(frame), candidates, plan)
    return found - np.column_stack([column, row]), covariance


def _in_cells(
    case: Case, electrons: Floats, ripple: float, noise: float, believed: bool = True
) -> tuple[Frame, int]:
    """A frame of the stars of `measure`, and how many there are in a row of it."""
    side, across = electrons.shape[-1], math.gcd(len(electrons), PHASES**2)
    cells = electrons.reshape(-1, across, side, side).transpose(0, 2, 1, 3)
    light = cells.reshape(-1, across * side) + scale(case).background
    frame = noise_free_frame(light, case.instrument.detector, ripple, noise)
    if case.design is not None and believed:
        stated = scale(case.as_designed).noise if noise else 0.0
        frame = replace(as_believed(case, frame), read_noise=stated)
    return frame, across


def _chance_kept(case: Case, electrons: Floats) -> Floats:
    """Chance (n,) that the tracker takes a detected star for none of the hot pixels."""
    size, side = scale(case), electrons.shape[-1]
    frame, across = _in_cells(case, electrons, 0.0, size.noise)
    empty, _ = _in_cells(case, np.zeros((1, 2, 2)), 0.0, size.noise)
    row, column = np.divmod(np.arange(len(electrons)), across) * np.array(side) + side // 2
    place = np.column_stack([column, row]).astype(float)
    return chance_kept(frame, place, float(empty.image[0, 0]), detection_plan(case))


def detection_probability(case: Case, magnitude: Floats, point: Floats | None = None) -> Floats:
    """Fraction of the stars (m,) of a magnitude whose filtered peak passes the threshold.

        fraction = mean over positions of Phi(peak / noise - threshold)

    Zero where the background alone saturates the pixels.

    point     (p, side, side) fraction of a star's light in each pixel; None: `point_images`
    Accuracy  model: the noise of the peak is that of the background; neighbours, and the tests
              against hot pixels, are left out.
    """
    size = scale(case)
    if size.background >= size.largest:
        return np.zeros(len(magnitude))
    point = point_images(case) if point is None else point
    plan = detection_plan(case)
    kernel = plan.kernel
    middle = point.shape[-1] // 2
    near = slice(middle - 1, middle + 2)
    peak = np.array([filtered(one, kernel)[near, near].max() for one in point.astype(np.float32)])
    snr = size.star * 10 ** (-0.4 * magnitude[:, None]) * peak / (size.pixel * kernel.noise)
    detector = case.instrument.detector
    threshold = plan.threshold(detector.columns * detector.rows)
    return np.asarray(ndtr(snr - threshold).mean(axis=1))


def magnitudes(case: Case, faintest: float) -> Floats:
    """The magnitudes of a chart: from the brightest stars to those that are hardly detected."""
    size, point = scale(case), point_images(case)
    sharpness = math.sqrt(float((point**2).sum()) / len(point))
    limit = 2.5 * math.log10(size.star * sharpness / size.pixel / FAINTEST_SNR)
    end = max(min(faintest, limit) + STEP, BRIGHTEST + 2 * STEP)
    return np.arange(BRIGHTEST, end + STEP, STEP)


@lru_cache(maxsize=8)
def pattern(cause: str, shape: tuple[int, ...]) -> Floats:
    """Fixed normal numbers for the pattern of one device, the same in all designs."""
    draw = Streams(0, 0)(cause).standard_normal(shape)
    draw.flags.writeable = False
    return draw


def point_images(case: Case) -> Floats:
    """Fraction of a star's light in the pixels around its sub-pixel positions (p, side, side)."""
    return _point_images(case.instrument, case.tracker.detection)


@kept(8)
def _point_images(instrument: Instrument, detection: Detection) -> Floats:
    return star_images(instrument, phases(), cell_side(instrument, detection))


def cell_side(instrument: Instrument, detection: Detection) -> int:
    """Pixel, odd, side of the cell that a star with its ring needs."""
    _, _, _, run = _smeared(instrument)
    ring = detection.window // 2 + RING + math.ceil(run)
    return 2 * (max(ring, math.ceil(psf_of(instrument).half_width)) + RING) + 1


def smear_extent(instrument: Instrument) -> float:
    """Pixel, from the middle of the smear of the boresight to its end."""
    return _smeared(instrument)[3]


def star_images(instrument: Instrument, place: Floats, side: int, psf: Psf | None = None) -> Floats:
    """Fraction of the light of stars in each pixel, with the smear of the boresight.

    place    (n, 2) pixel from the middle of a cell
    psf      None for that of the instrument
    Returns  (n, side, side) 1
    """
    mean, weight, offset, _ = _smeared(instrument)
    if psf is None:
        psf = mean
    else:
        psf = _blurred(psf, _jitter_blur(instrument) / instrument.detector.pitch)
    strip = np.zeros((side, len(place) * side))
    middle = np.arange(len(place)) * side + side // 2
    for fraction, (x, y) in zip(weight, offset, strict=True):
        stamp(strip, psf, middle + place[:, 0] + x, side // 2 + place[:, 1] + y,
              np.full(len(place), fraction))  # fmt: skip
    fraction = instrument.detector.crosstalk
    if fraction:
        strip = diffuse(strip, fraction)
    return np.ascontiguousarray(strip.reshape(side, -1, side).transpose(1, 0, 2))


@lru_cache(maxsize=8)
def _smeared(instrument: Instrument) -> tuple[Psf, Floats, Floats, float]:
    """PSF with the blur of expected jitter; weights (k,), points (k, 2) and extent of the smear.

    Points and extent in pixel.
    """
    camera, detector, motion = instrument.camera, instrument.detector, instrument.motion
    pixel = 1 / camera.focal_length_px
    steady = replace(motion, tones=(), broadband=(), jitter=())
    path = slew(steady, detector.exposure, pixel, camera.half_diagonal)
    # The sky turns by r: a star on the boresight moves by (r_y, -r_x).
    offset = path.rotation[:, [1, 0]] * [1, -1] / pixel
    wide = _jitter_blur(instrument)
    if wide and instrument.optics.tabulated:
        psf = _blurred(psf_of(instrument), wide / detector.pitch)
    else:
        if wide:
            lens = replace(instrument.optics, blur=math.hypot(instrument.optics.blur, wide))
            instrument = replace(instrument, optics=lens)
        psf = psf_of(instrument)
    return psf, path.weight, offset, float(np.abs(offset).max())


def _jitter_blur(instrument: Instrument) -> float:
    """Metre on the detector, sigma of the blur by expected jitter."""
    still = replace(instrument.motion, rate_x=0.0, rate_y=0.0, rate_z=0.0)
    x, y, _ = blur(still, instrument.detector.exposure)
    return math.hypot(x, y) / math.sqrt(2) * instrument.optics.image_distance


def _blurred(psf: Psf, sigma: float) -> Psf:
    """A PSF with one more Gaussian blur, pixel; light beyond the table is lost."""
    if not sigma:
        return psf
    table = ndimage.gaussian_filter(psf.table, sigma * psf.oversampling, mode="constant")
    return replace(psf, table=table)


@lru_cache(maxsize=1)
def phases() -> Floats:
    """(p, 2) pixel, x and y from the middle of the pixel."""
    line = (np.arange(PHASES) + 0.5) / PHASES - 0.5
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
