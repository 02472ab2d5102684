"""Case -> response of the tracker's centroid to single stars of any flux."""

import math
from dataclasses import replace
from enum import Enum
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy
from scipy.special import ndtr

from startrack.core import Floats, Frame, Ints, Psf, Refused, Streams, kept, require_memory
from startrack.design import Case, Instrument
from startrack.detection import (
    LOOKED,
    QUICK,
    Detection,
    Peaks,
    chance_kept,
    filtered,
    highest_between,
    pixels,
    places,
)
from startrack.detector import (
    Detector,
    added_noise,
    alternating_numbers,
    diffuse,
    electron_rate,
    expected_signal,
    law_of,
    read_channel,
    stamp,
    to_frame,
)
from startrack.motion import blur, slew
from startrack.observation import as_believed, detection_plan, light_by_colour, psf_of, throughput
from startrack.response.dark_pattern import dark_electrons


def noise_free_frame(electrons: Floats, detector: Detector, ripple: float, noise: float) -> Frame:
    """A noise-free frame in which the tracker estimates the background as it does with noise.

    With equal pixels in the ring, the tracker would clip pixels and fit slopes differently than in
    a real frame. Therefore the noise rms is added to and subtracted from alternate pixels, in a
    chessboard pattern. The ring then has the correct spread, and the moments of a star do not
    change.

    electrons  (rows, columns) expected
    ripple     electron, amplitude of the chessboard
    noise      electron rms of a pixel without light, value that the tracker assumes
    Returns    Frame of numbers that are not rounded
    """
    law = law_of(detector)._replace(gain=1 / detector.electrons_per_dn)
    level = expected_signal(electrons, law)
    level = read_channel(level, detector)
    image = alternating_numbers(level, ripple, law)
    return replace(to_frame(image, detector), read_noise=noise)


def pixel_noise(detector: Detector, streams: Streams) -> Floats:
    """The noise (rows, columns) that read-out adds, in electrons before EM multiplication."""
    return added_noise(detector, streams) / detector.em_gain


PHASES = 6  # sub-pixel positions per axis
STEP = 0.5  # magnitude between two rows of the chart
BRIGHTEST = -1.5
RING = 3  # pixel, width of the ring around the window that gives the background
WIDER = 64  # pixel, by which a star's cell, with ring and margins, may exceed a small frame
CELL_BYTES = 42  # memory for each pixel of a cell; 36 to 41 were measured
FAINTEST_SNR = 3.0  # below this no star is detected


class Chart(NamedTuple):
    """Stars of m magnitudes, each at p sub-pixel positions, as the tracker measures them.

    magnitude   (m,) G of a sunlike star
    offset      (m, p, 2) pixel, measured minus true; NaN where the tracker drops the star
    one_sign    (m, p, 2) the same with one sign of the chessboard, see `measure`
    covariance  (m, p, 2, 2) pixel^2, stated by the tracker
    """

    magnitude: Floats
    offset: Floats
    one_sign: Floats
    covariance: Floats


class NoiseScale(NamedTuple):
    """Signal levels of a detector: electrons in an exposure.

    star        light of a sunlike star of G = 0
    background  light of the sky and dark current, in a pixel
    noise       rms of a pixel without light, quantisation included
    largest     largest signal of a pixel, by full-well capacity and range of the converter
    excess      1, variance of the detected light over its mean
    """

    star: float
    background: float
    noise: float
    largest: float
    excess: float

    @property
    def shot(self) -> float:
        """Electron rms, shot noise of the background's light and dark current."""
        return math.sqrt(self.excess * self.background)

    @property
    def pixel(self) -> float:
        """Electron rms, noise of a pixel without a star."""
        return math.hypot(self.noise, self.shot)


@lru_cache(maxsize=16)
def scale(case: Case) -> NoiseScale:
    """The signal levels of a case; `electron_rate` states their errors. Cached for 16 cases."""
    detector = case.instrument.detector
    sunlike = light_by_colour(case, np.full(1, np.nan))
    star, sky = electron_rate(sunlike, detector, throughput(case.instrument))
    solid_angle = case.instrument.camera.focal_length_px**-2
    return NoiseScale(
        float(star[0]) * detector.exposure,
        float(sky) * solid_angle * detector.exposure + dark_electrons(detector)[0],
        math.hypot(detector.noise, detector.electrons_per_dn / math.sqrt(12)),
        min(
            detector.full_well, (2**detector.bits - 1 - detector.offset) * detector.electrons_per_dn
        ),
        detector.excess_noise,
    )


class Reading(Enum):
    """Interpretation of a noise-free frame by the tracker."""

    BELIEVED = "numbers and noise as those of its design"
    TRUE = "true numbers and noise, so that the covariance is the true one"
    SHOT_NOISE = "true numbers and noise, but no noise in pixels without light"


class StarImages(NamedTuple):
    """Images of a star at p sub-pixel positions.

    point  (p, side, side) fraction of its light in each pixel
    place  (p, 2) pixel, from the middle of the cell
    """

    point: Floats
    place: Floats


def chart(
    case: Case,
    magnitude: Floats,
    images: StarImages | None = None,
    gain: Floats | None = None,
    extra: Floats | None = None,
    reading: Reading = Reading.BELIEVED,
    both_signs: bool = True,
    groups: int = 1,
) -> Chart:
    """Measure stars without noise, as the tracker would.

    The error of a noise-free star is the error of the centroid method alone; the covariance that
    the tracker states is the covariance of the noise.

    magnitude   (m,) G
    images      None: `images_at_phases`
    gain        (m, p, side, side) 1, response of the pixels around each star; None: uniform
    extra       (m, p, side, side) electron to add to these pixels; None: none
    both_signs  as for `measure`
    groups      number of groups of positions, each measured separately: with one sign, the
                chessboard shifts equal positions of all groups equally
    """
    images = images or images_at_phases(case)
    electrons = star_electrons(case, magnitude, images)
    if gain is not None:
        electrons = electrons * gain
    if extra is not None:
        electrons = electrons + extra
    cells = _grouped(electrons, groups)
    centroids, covariances = _measurements(case, cells, reading, both_signs)
    return Chart(
        magnitude,
        _ungrouped(_mean(centroids), len(magnitude)) - images.place,
        _ungrouped(centroids[0], len(magnitude)) - images.place,
        _ungrouped(_mean(covariances), len(magnitude)),
    )


def _grouped(values: Floats, groups: int) -> Floats:
    """Values (m, g p, ...) of g groups of positions, rearranged to (g, m p, ...)."""
    m, _, *rest = values.shape
    parts = values.reshape(m, groups, -1, *rest).swapaxes(0, 1)
    return parts.reshape(groups, -1, *rest)


def _ungrouped(values: Floats, m: int) -> Floats:
    """Inverse of `_grouped`: values (g, m p, ...) to (m, g p, ...)."""
    groups, _, *rest = values.shape
    return values.reshape(groups, m, -1, *rest).swapaxes(0, 1).reshape(m, -1, *rest)


def star_electrons(case: Case, magnitude: Floats, images: StarImages) -> Floats:
    """Electrons (m, p, side, side) of stars (m,) in the pixels about each position."""
    side = images.point.shape[-1]
    require_memory(
        CELL_BYTES * len(magnitude) * images.point.size,
        f"images of stars of {side} x {side} pixels, as wide as optics and motion make them,",
    )
    return scale(case).star * 10 ** (-0.4 * magnitude[:, None, None, None]) * images.point


def measure(
    case: Case, electrons: Floats, reading: Reading = Reading.BELIEVED, both_signs: bool = True
) -> tuple[Floats, Floats]:
    """The tracker's centroids of stars, each in a separate cell.

    electrons   (n, side, side) electrons of the star in the pixels of its cell, side odd
    both_signs  whether to average over both signs of the chessboard of `noise_free_frame`;
                unnecessary if only differences between measurements are used
    Returns     (n, 2) pixel from the middle of the cell, (n, 2, 2) pixel^2, stated covariance; NaN
                for a star that the tracker drops
    """
    centroids, covariances = _measurements(case, electrons[None], reading, both_signs)
    return _mean(centroids)[0], _mean(covariances)[0]


def _measurements(
    case: Case, electrons: Floats, reading: Reading, both_signs: bool
) -> tuple[list[Floats], list[Floats]]:
    """Measurements of cells (g, n, side, side) that `measure` averages: places, covariances."""
    size, detection = scale(case), case.tracker.detection
    noise = 0.0 if reading is Reading.SHOT_NOISE else size.noise
    ripple = math.hypot(noise, size.shot)
    plan = detection_plan(case, _of_all_stars(detection))
    # A chessboard shifts the fit of a narrow star; the opposite sign shifts it by the opposite
    # amount.
    signs = (1, -1) if plan.method.skips_dead and both_signs else (1,)
    centroids, covariances = [], []
    for sign in signs:
        frame, middle = _in_cells(case, electrons, sign * ripple, reading)
        column, row = middle.T
        candidates = Peaks(column, row, np.ones(len(row), np.int64))
        centroid, covariance = places(frame, pixels(frame), candidates, plan)
        centroids.append((centroid - middle).reshape(*electrons.shape[:2], 2))
        covariances.append(covariance.reshape(*electrons.shape[:2], 2, 2))
    return centroids, covariances


@lru_cache(maxsize=8)
def _of_all_stars(detection: Detection) -> Detection:
    return replace(detection, max_spots=2**20)


def _mean(values: list[Floats]) -> Floats:
    return values[0] if len(values) == 1 else (values[0] + values[1]) / 2


def _in_cells(
    case: Case, electrons: Floats, ripple: float, reading: Reading = Reading.BELIEVED
) -> tuple[Frame, Ints]:
    """A frame of stars (g, n, side, side), and the middles (g n, 2) of their cells, pixel.

    Groups lie one below the other; each begins in an even row.
    """
    groups, count, side, _ = electrons.shape
    across = math.gcd(count, PHASES**2)
    high = count // across * side
    noise = 0.0 if reading is Reading.SHOT_NOISE else scale(case).noise
    light = np.full((groups, high + high % 2, across * side), scale(case).background)
    cells = electrons.reshape(groups, -1, across, side, side).transpose(0, 1, 3, 2, 4)
    light[:, :high] += cells.reshape(groups, high, across * side)
    light = light.reshape(-1, across * side)
    frame = noise_free_frame(light, case.instrument.detector, ripple, noise)
    if case.design is not None and reading is Reading.BELIEVED:
        stated = scale(case.as_designed).noise
        frame = replace(as_believed(case, frame), read_noise=stated)
    row, column = np.divmod(np.arange(count), across) * np.array(side) + side // 2
    first = np.arange(groups)[:, None] * (high + high % 2)
    place = np.stack([np.broadcast_to(column, (groups, count)), first + row], axis=-1)
    return frame, place.reshape(-1, 2)


def kept_fraction(case: Case, plain: Chart, images: StarImages) -> Floats:
    """Probability (m, p) that the tracker measures a detected star and does not reject it as hot.

    plain   chart of the same stars, without `gain` and `extra`
    images  as `chart` takes them
    """
    electrons = star_electrons(case, plain.magnitude, images)
    frame, middle = _in_cells(case, _grouped(electrons, 1), 0.0)
    empty, _ = _in_cells(case, np.zeros((1, 1, 2, 2)), 0.0)
    level = float(empty.image[0, 0])
    chance = chance_kept(frame, middle.astype(float), level, detection_plan(case))
    return np.where(np.isfinite(plain.offset[..., 0]), chance.reshape(electrons.shape[:2]), 0.0)


class StarSearch(NamedTuple):
    """Search of a frame with hot pixels by a tracker.

    noise      digital number, noise of the filtered frame in a typical tile
    threshold  (k,) in units of this noise, samples of equal probability: the threshold varies with
               the tile and the surroundings of a star
    """

    noise: float
    threshold: Floats


def detection_probability(
    case: Case, magnitude: Floats, point: Floats | None = None, search: StarSearch | None = None
) -> Floats:
    """Fraction of the stars of each magnitude (m,) whose filtered peak exceeds the threshold.

        fraction = mean over positions of Phi(peak / noise - threshold)

    For the quick search, the smaller of two fractions counts at each position: by its own filter
    and by the matched filter. The result is zero if the background alone saturates the pixels.

    point     (p, side, side) fraction of a star's light in each pixel; None: `point_images`
    search    search of a frame with hot pixels; None: there are none
    Accuracy  model: the noise of the peak is the noise of the background; neighbours, and the tests
              against hot pixels, are left out.
    """
    size = scale(case)
    if size.background >= size.largest:
        return np.zeros(len(magnitude))
    point = point_images(case) if point is None else point
    plan = detection_plan(case)
    kernel, peak = plan.kernel, np.zeros(len(point))
    quick = case.tracker.detection.search == QUICK
    narrow_peak = np.zeros(len(point))
    middle = point.shape[-1] // 2
    for k, image in enumerate(point.astype(np.float32)):
        light = filtered(image, kernel)
        near = light[middle - 1 : middle + 2, middle - 1 : middle + 2]
        peak[k] = near.max()
        if quick:
            light = filtered(image, plan.quick_filter)
            narrow_peak[k] = light[middle - 1 : middle + 2, middle - 1 : middle + 2].max()
        if search is not None:  # faint stars are also searched between pixels
            y, x = np.unravel_index(near.argmax(), near.shape)
            place = int(x) + middle - 1, int(y) + middle - 1
            peak[k] = highest_between(image, *place, 0.0, plan.filters)
    detector = case.instrument.detector
    noise = size.pixel * kernel.noise
    threshold = np.array([plan.threshold(detector.columns * detector.rows)])
    if search is not None:
        noise, threshold = search.noise * detector.electrons_per_dn, search.threshold
    star = size.star * 10 ** (-0.4 * magnitude[:, None])
    above = (star * peak / noise)[..., None] - threshold
    if quick:
        narrow_noise = noise * plan.quick_filter.noise / kernel.noise
        pointed_out = (star * narrow_peak / narrow_noise)[..., None] - LOOKED * threshold
        above = np.minimum(above, pointed_out)
    return np.asarray(ndtr(above).mean(axis=(1, 2)))


def magnitudes(case: Case, faintest: float) -> Floats:
    """The magnitudes of a chart: from the brightest stars to barely detectable ones."""
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


def images_at_phases(case: Case) -> StarImages:
    """The images of a star at `phases`."""
    return StarImages(point_images(case), phases())


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
    half = max(ring, math.ceil(psf_of(instrument).half_width)) + RING
    return within_frame(2 * half + 1, instrument.detector)


def within_frame(side: int, detector: Detector) -> int:
    """The side of a star's cell, pixel; refused if the frame is smaller than a star image."""
    if side > max(detector.columns, detector.rows) + WIDER:
        raise Refused(
            f"images of stars must not be wider than the frame of {detector.columns} x "
            f"{detector.rows} pixels, got cells of {side} pixels by instrument.optics and the "
            "motion in an exposure"
        )
    return side


def smear_extent(instrument: Instrument) -> tuple[float, float]:
    """Pixel along x and y, from the middle of the smear of the boresight to its end."""
    x, y = np.abs(_smeared(instrument)[2]).max(axis=0).tolist()
    return x, y


def star_images(instrument: Instrument, place: Floats, side: int, psf: Psf | None = None) -> Floats:
    """Fraction of the light of stars in each pixel, with the smear of the boresight.

    place    (n, 2) pixel from the middle of a cell
    psf      PSF of the star; None: the PSF of the instrument
    Returns  (n, side, side) 1
    """
    _, weight, offset, _ = _smeared(instrument)
    psf = with_expected_jitter(instrument, psf)
    strip = np.zeros((side, len(place) * side))
    middle = np.arange(len(place)) * side + side // 2
    for fraction, (x, y) in zip(weight, offset, strict=True):
        stamp(
            strip,
            psf,
            middle + place[:, 0] + x,
            side // 2 + place[:, 1] + y,
            np.full(len(place), fraction),
        )
    fraction = instrument.detector.crosstalk
    if fraction:
        strip = diffuse(strip, fraction)
    return np.ascontiguousarray(strip.reshape(side, -1, side).transpose(1, 0, 2))


def with_expected_jitter(instrument: Instrument, psf: Psf | None = None) -> Psf:
    """A PSF (None: the PSF of the instrument) with the blur of expected jitter."""
    if psf is None:
        return _smeared(instrument)[0]
    return _blurred(psf, _jitter_blur(instrument) / instrument.detector.pitch)


@lru_cache(maxsize=8)
def _smeared(instrument: Instrument) -> tuple[Psf, Floats, Floats, float]:
    """PSF with the blur of expected jitter; weights (k,), points (k, 2) and extent of the smear.

    Points and extent in pixel.
    """
    camera, detector, motion = instrument.camera, instrument.detector, instrument.motion
    pixel = 1 / camera.focal_length_px
    path = slew(motion.steady, detector.exposure, pixel, camera.half_diagonal)
    # If the sky rotates by r, a star on the boresight moves by (r_y, -r_x).
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


@lru_cache(maxsize=8)
def _jitter_blur(instrument: Instrument) -> float:
    """Metre on the detector, sigma of the blur by expected jitter."""
    still = replace(instrument.motion, rate_x=0.0, rate_y=0.0, rate_z=0.0)
    x, y, _ = blur(still, instrument.detector.exposure)
    return math.hypot(x, y) / math.sqrt(2) * instrument.optics.image_distance


def _blurred(psf: Psf, sigma: float) -> Psf:
    """A PSF with one more Gaussian blur, pixel; light beyond the table is lost."""
    if not sigma:
        return psf
    table = scipy.ndimage.gaussian_filter(psf.table, sigma * psf.oversampling, mode="constant")
    return replace(psf, table=table)


@lru_cache(maxsize=1)
def phases() -> Floats:
    """Sub-pixel positions (p, 2), pixel, x and y from the middle of the pixel."""
    line = (np.arange(PHASES) + 0.5) / PHASES - 0.5
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
