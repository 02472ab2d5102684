"""Dark signal of pixels: its law, its pattern in a case, and the effect of hot pixels."""

import math
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from scipy.special import ndtr

from startrack import detection
from startrack.core import Floats, Ints, Streams, kept
from startrack.design import Case, replaced_all, turning
from startrack.detector import Defects, Detector, dark, flickering, frame_of
from startrack.observation import as_believed, detection_plan
from startrack.response.star_inputs import star_inputs


def dark_currents(detector: Detector) -> tuple[float, float]:
    """Mean and rms of the dark current of pixels, electron / second at reference temperature.

        d = max(N(m, s), 0) + hot,   mean d = m Phi(m/s) + s phi(m/s) + p h
        var d = (m^2 + s^2) Phi + m s phi - (m Phi + s phi)^2 + (2 p - p^2) h^2

    The current of a pixel is normally distributed and clipped at zero. With the probability p, a
    hot pixel adds a current with an exponential distribution of mean h.
    """
    m, defects = detector.typical_current, detector.defects
    if not defects:
        return m, 0.0
    mean, square, s = m, m * m, defects.dsnu
    if s:
        fraction, bell = float(ndtr(m / s)), math.exp(-((m / s) ** 2) / 2)
        density = bell / math.sqrt(2 * math.pi)
        mean, square = m * fraction + s * density, (m * m + s * s) * fraction + m * s * density
    p, h = defects.hot, defects.hot_current
    return mean + p * h, math.sqrt(max(square - mean**2, 0.0) + (2 * p - p * p) * h * h)


def dark_electrons(detector: Detector) -> tuple[float, float]:
    """`dark_currents` in an exposure, electron in a pixel of the image."""
    growth = detector.thermal.growth if detector.thermal else 1.0
    mean, spread = (growth * detector.exposure * current for current in dark_currents(detector))
    return mean * detector.binning**2, spread * detector.binning


def dark_residual(detector: Detector, dark_map: detection.DarkMap | None) -> float:
    """Rms over the pixels of the dark signal that a tracker does not know, electron.

        with a map          sqrt(noise^2 / frames + step^2 / 12)
        list of hot pixels  sqrt(s^2 + v (1 - (a^2 / 2 + a + 1) exp(-a))),   a = hot noise / h

    s^2 is the variance of the usual pixels, v the variance and h the mean signal of the hot pixels.

    Accuracy  model: stars next to a hot pixel are left out; some of them are lost.
    """
    _, spread = dark_electrons(detector)
    if dark_map is None:
        return spread
    defects, step = detector.defects or Defects(), detector.electrons_per_dn
    usual = replace(detector, defects=replace(defects, hot=0.0))
    mean, unmapped = dark_electrons(usual)
    shot = math.sqrt(detector.excess_noise * mean)
    noise = math.hypot(shot, detector.noise, step / math.sqrt(12))
    if dark_map.subtracted:
        error = noise / math.sqrt(dark_map.frames)
        rounding = dark_map.step * step / math.sqrt(12)  # for a map that spans several steps
        return math.hypot(error, min(rounding, math.hypot(error, unmapped)))
    growth = detector.thermal.growth if detector.thermal else 1.0
    h = growth * detector.exposure * defects.hot_current
    if not defects.hot * h:
        return unmapped
    a = dark_map.hot * noise / h
    kept = 1 - (a * a + 2 * a + 2) * math.exp(-a) / 2
    return math.sqrt(unmapped**2 + (spread**2 - unmapped**2) * kept)


OUTLYING = 5.0  # sigma of the usual pixels, beyond which a pixel is an outlier; by hand
ROUNDS = 20  # most iterations in which outliers are left out
SAMPLES = 128  # number of windows with outlying pixels
PLACES = 512  # number of places in a frame at which the threshold is measured


class HotPixels(NamedTuple):
    """Effect of pixels with outlying dark current on the centroid of a star near them.

    chance  1, probability that such a pixel is near a star
    shift   (l, k, 2) pixel, shift at each flux of a `SpotResponse`, in k samples; NaN if the star
            is lost
    """

    chance: float
    shift: Floats


NO_HOT = HotPixels(0.0, np.zeros((2, 1, 2)))


class DarkPattern(NamedTuple):
    """Dark signal of the pixels of an image after the correction by the tracker's dark map.

    mean      electron, mean of the pixels that are not outliers
    spread    electron, rms of these pixels about their mean
    marked    1, fraction of the pixels that the tracker's dark map marks as hot
    outlying  (k,) row * columns + column of the outliers
    excess    (k,) electron, dark signal of the outliers minus the mean
    """

    mean: float
    spread: float
    marked: float
    outlying: Ints
    excess: Floats


def dark_pattern(case: Case) -> DarkPattern | None:
    """The pattern of the dark signal in an exposure; None if all pixels are equal.

    Pixels that flicker are in one random state. Pixels that a dark map marks as hot do not count as
    outliers.
    """
    detector = case.instrument.detector
    defects, has_map = detector.defects, case.tracker.detection.dark_map is not None
    if not (has_map or detector.age or (defects and (defects.dsnu or defects.hot))):
        return None
    return _pattern(_still(detector), _at_rest(case.as_designed) if has_map else None)


@lru_cache(maxsize=8)
def _at_rest(case: Case) -> Case:
    """The case at rest: its dark map does not depend on motion; cached for the last 8 cases."""
    return turning(star_inputs(case), 0.0)


def _still(detector: Detector) -> Detector:
    """The detector without effects that do not change its dark signal: cases share a pattern."""
    return replace(
        detector, prnu=0.0, read_noise=0.0, offset=0, pixel_rate=1e6, frame_rate=None, hits=None
    )


@kept(4)
def _pattern(detector: Detector, mapped: Case | None) -> DarkPattern:
    """The pattern of a detector, with the dark map of a design."""
    signal = np.full((detector.rows, detector.columns), dark(detector)) * detector.exposure
    flicker = flickering(detector, Streams(0, 0))
    if flicker is not None:
        signal = flicker.add_to(signal, detector.exposure)
    marked = 0.0
    if mapped is not None:
        correction = detection_plan(mapped).correction
        assert correction is not None
        signal = signal - correction.offset * detector.electrons_per_dn
        marked = len(correction.hot) / signal.size
        signal = np.where(correction.marks > 0, np.median(signal), signal)
    flat = signal.ravel()
    even, kept = np.ones(len(flat), bool), -1
    mean = spread = 0.0
    for _ in range(ROUNDS):
        mean, spread = float(flat[even].mean()), float(flat[even].std())
        even = np.abs(flat - mean) <= OUTLYING * spread + 1e-9
        if kept == (kept := int(even.sum())):
            break
    outlying = np.flatnonzero(~even)
    return DarkPattern(mean, spread, marked, outlying, flat[outlying] - mean)


def with_uniform_dark(case: Case) -> Case:
    """The case with the mean dark current in all pixels; their spread is added to the noise.

    Stars lie anywhere on the pixels, so that the spread acts as noise from trial to trial. The loss
    of light by ageing is in the fill factor. A case without a pattern is returned unchanged.
    """
    pattern = dark_pattern(case)
    if pattern is None:
        return case
    detector = case.instrument.detector
    growth = detector.thermal.growth if detector.thermal else 1.0
    even = replace(
        detector,
        defects=None,
        age=None,
        dark_current=max(pattern.mean, 0.0) / detector.exposure / growth / detector.binning**2,
        read_noise=math.hypot(detector.read_noise, pattern.spread),
        fill_factor=max(detector.fill_factor * detector.sensitivity, 0.01),
    )
    mapless = case.tracker.detection.without_map
    return replaced_all(case, {"instrument.detector": even, "tracker.detection": mapless})


def near_stars(case: Case, side: int, samples: int = SAMPLES) -> tuple[float, Floats]:
    """Probability of outliers in the window of a star, and samples of windows that have some.

    side     pixel, side of the window
    Returns  the probability, and windows (k, side, side), electron above the mean
    """
    pattern, detector = dark_pattern(case), case.instrument.detector
    if pattern is None or not len(pattern.outlying):
        return 0.0, np.zeros((0, side, side))
    half = side // 2
    excess = np.zeros((detector.rows, detector.columns))
    excess.ravel()[pattern.outlying] = pattern.excess
    inside = (slice(half, detector.rows - half), slice(half, detector.columns - half))
    window = np.ones((side, side), np.uint8)
    near = cv2.dilate((excess != 0).astype(np.uint8), window)[inside] > 0
    random = Streams(0, 0)("windows with hot pixels")
    chosen = random.choice(np.flatnonzero(near), samples)
    row, column = np.divmod(chosen, near.shape[1])
    windows = [excess[y : y + side, x : x + side] for y, x in zip(row, column, strict=True)]
    return float(near.mean()), np.array(windows)


class Empty(NamedTuple):
    """Result of the search on a frame without stars.

    spots            number of spots in excess of those that noise makes of usual pixels
    flux             (k,) electron of all spots, brightest first
    noise            digital number, noise of the filtered frame in a typical tile
    threshold_sigma  detection threshold, sigma of the filtered frame
    of_places        (t,) detection threshold at random places, sigma of the typical tile, above the
                     level of the usual pixels
    """

    spots: float
    flux: Floats
    noise: float
    threshold_sigma: float
    of_places: Floats


@kept(128, reads=star_inputs)
def empty_frame(case: Case, sky: float) -> Empty | None:
    """Result of searching a star-free frame with a case's pattern; None if all pixels are equal.

    sky  electron in a pixel, light of the sky
    """
    pattern = dark_pattern(case)
    if pattern is None:
        return None
    detector, plan = case.instrument.detector, detection_plan(case)
    shape = detector.rows, detector.columns
    electrons = np.full(shape, sky + dark(detector) * detector.exposure)
    frame = as_believed(case, frame_of(electrons, detector, Streams(0, 0)))
    ground = detection.measure_ground(frame, plan)
    noise = detection.false_alarms(plan, detector.columns, detector.rows)
    detected = detection.detect(frame, plan)
    flux = -np.sort(-detected.flux) * frame.electrons_per_dn
    spots = max(len(detected) - noise, 0.0)
    pixels = detection.calibrated(frame, plan)
    even = np.ones(pixels.value.size, bool)
    even[pattern.outlying] = False
    level = float(pixels.value.ravel()[even].mean(dtype=float))
    random, border = Streams(0, 0)("places of thresholds"), detection.peak_border(plan.settings)
    x, y = (
        random.integers(min(border, size // 2), max(size - border, size // 2 + 1), PLACES)
        for size in (detector.columns, detector.rows)
    )
    of_places = (detection.levels_at(pixels, plan, x, y) - level) / ground.noise
    return Empty(spots, flux, ground.noise, float(np.median(ground.far)), of_places)
