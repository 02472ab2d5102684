"""Case -> systematic variance of each star, which the tracker adds to that of the noise."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from startrack.attitude import UNKNOWN_FLOOR, SharedErrors
from startrack.catalog import Selection, open_sky
from startrack.core import Floats, Ints, Stars, kept
from startrack.design import Case, Scope, aged, found_at, unchecked
from startrack.motion import jitter_rms
from startrack.observation import (
    colour_correction,
    detection_plan,
    index_resolution,
    mean_colour,
    near_pairs,
    separated,
    sky_electrons,
    with_images_of,
)
from startrack.optics import Residual
from startrack.response.dark_pattern import dark_pattern, with_uniform_dark
from startrack.response.spot_response import ResponseGrid, hot_windows
from startrack.response.star_errors import errors, lasting
from startrack.response.star_response import RING, cell_side, measure, phases, scale, star_images
from startrack.response.zones import focal_stretch, lens_variance

CONTRAST = np.arange(-2.0, 6.0)  # magnitude, of the neighbour less that of the star
STEP = 0.5  # pixel, between two distances; beyond EVEN, longer by GROWTH each
EVEN, GROWTH = 4.0, 1.125
PIXELS = 2**21  # that are measured at once
MERGED = 1.5  # pixel beyond the window's half side, within which two stars are one spot
TILT = math.radians(30)  # of the line from the star to its neighbour against the columns
# The same against a streak, which is not round, with weights; more of them along it, where a
# neighbour moves a star most: angle = t^2 pi / 2 in the middles of halves of t. Other angles are
# mirror images.
TILTS = math.pi / 32, 9 * math.pi / 32
WEIGHTS = 0.25, 0.75
LOST = 1e4  # pixel, shift of a star that is not detected beside its neighbour
SNR = 100.0  # of the brightest pixel of the star in the chart
WIDER = math.log(2)  # pairs are kept for all reaches that are smaller by less than this
FAINTER = 1.0  # magnitude beyond the tracker's catalogue, whose stars have no shift


@kept(8)
def blending_shift(case: Case, catalog: Selection) -> Floats:
    """Shift of each separable star of a catalogue by the light of its neighbours.

    A shift along the line to the neighbour, by its distance and contrast, measured on a chart of
    pairs; shifts by several neighbours are added. Of two stars in one window the brighter has the
    spot, and the other is LOST. Stars that the tracker's index merges are one here: their spot is
    at the centre of their light.

    catalog  the true one, or that of the tracker
    Returns  (n, 3) pixel, ICRS axes, in the order of `separated`; zero for stars that are
             FAINTER than the tracker's catalogue
    Accuracy  model: pairs at one angle to the columns represent all; smear and scale are those of
              the boresight. numerical: of streaks, two angles stand for all, which moves the error
              of an attitude by 0.1 % where they are below 6 pixels and by 1 % at 13 pixels.
    """
    camera = case.instrument.camera
    resolution = index_resolution(camera)
    stars = separated(catalog, resolution).sky.stars
    # Rounded up, so that cameras of similar focal lengths share the pairs.
    angle = math.exp(math.ceil(math.log(_reach(case) / camera.focal_length_px) / WIDER) * WIDER)
    near = _pairs(catalog, resolution, angle, case.believed_catalog.limit_g + FAINTER).within(
        _reach(case) / camera.focal_length_px
    )
    distance = near.angle * camera.focal_length_px
    magnitude, other = near.magnitude + colour_correction(case, near.colour)
    contrast = other - magnitude
    pull = _shift(with_images_of(case), distance, contrast)
    pull[(distance < _merged(case)) & (contrast < 0)] = LOST
    along = pull / np.maximum(near.angle, 1e-12)
    moved = np.empty((len(stars), 3))
    for axis, apart in enumerate(near.apart):
        moved[:, axis] = np.bincount(near.star, along * apart, len(stars))
    return moved


def _shift(case: Case, distance: Floats, contrast: Floats) -> Floats:
    """Shift (k,) towards neighbours that are near enough, pixel."""
    table, node = _table(case), _distances(case)
    j = np.clip(np.searchsorted(node, distance, side="right") - 1, 0, len(node) - 2)
    t = np.minimum((distance - node[j]) / (node[j + 1] - node[j]), 1.0)
    v = np.clip((contrast - CONTRAST[0]) / (CONTRAST[1] - CONTRAST[0]), 0, len(CONTRAST) - 1.001)
    i = v.astype(int)
    s = v - i
    pull = (1 - s) * ((1 - t) * table[i, j] + t * table[i, j + 1])
    pull += s * ((1 - t) * table[i + 1, j] + t * table[i + 1, j + 1])
    # A fainter neighbour shifts by its fraction of the light.
    pull *= 10 ** (-0.4 * np.maximum(contrast - CONTRAST[-1], 0))
    return pull


@kept(8)
def _table(case: Case) -> Floats:
    """Shift by contrast and distance, pixel; LOST where the star is lost at any position."""
    x, y = detection_plan(case).settings.smear
    if not (x or y):
        return _at_angle(case, TILT)
    squares = [_at_angle(case, math.atan2(y, x) + tilt) ** 2 for tilt in TILTS]
    return np.sqrt(np.tensordot(WEIGHTS, squares, 1))


def _at_angle(case: Case, tilt: float) -> Floats:
    """`_table` for neighbours at one angle to the columns."""
    instrument, detection = case.instrument, case.tracker.detection
    distance = _distances(case)
    side = cell_side(instrument, detection) + 2 * math.ceil(distance[-1])
    place = phases()[::4]  # nine positions on a diagonal pattern
    star, size = star_images(instrument, place, side), scale(case)
    light = SNR * size.pixel / float(star.max())
    line = np.array([math.cos(tilt), math.sin(tilt)])
    alone, _ = measure(case, light * star, both_signs=False)
    pull = np.full((len(distance), len(CONTRAST), len(place)), LOST)
    # Beside a brighter neighbour in its window a star is lost anyway.
    counts = (np.append(distance[1:], math.inf) > _merged(case))[:, None] | (CONTRAST >= 0)
    many = max(1, PIXELS // star.size)
    for part in np.split(np.argwhere(counts), range(many, int(counts.sum()), many)):
        j, k = part.T
        other = {n: star_images(instrument, place + distance[n] * line, side) for n in set(j)}
        ratio = 10 ** (-0.4 * CONTRAST[k][:, None, None, None])
        both = light * (star + ratio * np.stack([other[n] for n in j]))
        seen, _ = measure(case, both.reshape(-1, side, side), both_signs=False)
        moved = (seen.reshape(len(part), len(place), 2) - alone) @ line
        pull[j, k] = np.where(np.isfinite(moved), moved, LOST)
    return pull.mean(axis=2).T


def _distances(case: Case) -> Floats:
    """Pixel, the distances of `_table`."""
    node = list(np.arange(0, EVEN + STEP, STEP))
    while node[-1] < _reach(case):
        node.append(node[-1] + max(STEP, (GROWTH - 1) * node[-1]))
    return np.array(node)


def _merged(case: Case) -> float:
    """Pixel, within which two stars are one spot."""
    return case.tracker.detection.window // 2 + MERGED


def _reach(case: Case) -> float:
    """Pixel, beyond which a neighbour does not matter."""
    smear = math.hypot(*detection_plan(case).settings.smear)
    return case.tracker.detection.window // 2 + RING + 2.0 + smear


class _Pairs(NamedTuple):
    """Pairs of near stars, each in both orders; the nearest first.

    star       (k,) indices of separable stars
    magnitude, colour  (2, k) G and BP - RP, of these stars and of the others
    angle      (k,) radian
    apart      (3, k) from the star to the other, ICRS axes
    """

    star: Ints
    magnitude: Floats
    colour: Floats
    angle: Floats
    apart: Floats

    def within(self, angle: float) -> "_Pairs":
        """The pairs that are nearer than an angle, radian."""
        many = int(np.searchsorted(self.angle, angle))
        return _Pairs(
            self.star[:many],
            self.magnitude[:, :many],
            self.colour[:, :many],
            self.angle[:many],
            self.apart[:, :many],
        )


@kept(32)
def _pairs(catalog: Selection, resolution: float, radius: float, faintest: float) -> _Pairs:
    """All pairs of separable stars within a radius (radian) whose star is no fainter than asked.

    Of merged stars, those whose brightest is no fainter.
    """
    several = separated(catalog, resolution)
    stars, place = several.sky.stars, several.places(len(open_sky(catalog)))
    # Stars that are merged lie within the resolution of their centre.
    within = radius + 2 * 2.0 ** math.ceil(math.log2(resolution))
    both = place[near_pairs(catalog, within, faintest)]
    both = both[:, (both >= 0).all(axis=0)]
    apart = stars.direction[both[1]] - stars.direction[both[0]]
    angle = np.linalg.norm(apart, axis=1)
    near = np.argsort(angle, kind="stable")
    near = near[: np.searchsorted(angle[near], 2 * math.sin(radius / 2))]
    both, angle, along = both[:, near], angle[near], np.ascontiguousarray(apart[near].T)
    return _Pairs(both[0], stars.magnitude_g[both], stars.colour[both], angle, along)


TURNS = tuple(f"instrument.mounting.{axis}" for axis in "xyz")


def systematic_variance(case: Case) -> Floats:
    """Variance per axis of a centroid that no noise explains, as a tracker knows it
    that is calibrated and as designed.

        variance = S-curve^2 + PRNU^2 + DSNU^2 + shift^2 / 2 + lens^2 + residual^2

    the first three from the tracker's centroids of noise-free stars of that magnitude (`errors`);
    the shift is that by the neighbours in its catalogue (`blending_shift`), along one line and so
    half of its square on either axis; then what a lens table leaves to the tracker, over the frame,
    for a star of that colour (`lens_variance`), and where the case is a unit, the rms of its
    `Residual` that its calibration leaves. `centroid_floor` replaces all of it where it is given.

    Returns  (n,) pixel^2, for the stars of the believed catalogue
    Accuracy  those of `errors` and `blending_shift`. model: for a detector that scans, the tracker
              assumes UNKNOWN_FLOOR; what a residual changes by with temperature is not known to the
              tracker.
    """
    design = _of_any_device(case.as_designed)
    as_designed = _systematic_variance(design)
    given = case.tracker.attitude.centroid_floor is not None
    if case.design is None or given or design.instrument.residual is None:
        return as_designed
    law = _residual_law(design)
    return as_designed + float((law**2).sum(axis=-1).mean()) + _map_noise(design)


def _map_noise(design: Case) -> float:
    """Pixel^2, variance of a map of the camera by the noise of its calibration."""
    calibration = design.tracker.calibration
    if calibration is None or not calibration.nodes:
        return 0.0
    ground = calibration.place == "ground"
    places = calibration.positions if ground else calibration.frames * calibration.stars
    noise = calibration.noise**2
    if ground:
        noise += (calibration.direction * design.believed_camera.focal_length_px) ** 2
    return noise * calibration.nodes**2 / places


def _residual_law(design: Case) -> Floats:
    """`Residual.law` (33, 33, 2, k) of what the calibration of a design's units leaves."""
    instrument, calibration = design.instrument, design.tracker.calibration
    if instrument.residual is None:
        return np.zeros((1, 1, 2, 1))
    return _law(
        instrument.residual,
        design.believed_camera.ideal,
        instrument.optics,
        instrument.detector.pitch,
        calibration.order if calibration else 0,
        calibration.tangential if calibration else False,
        calibration.nodes if calibration else 0,
    )


_law = kept(8)(Residual.law)  # of the last 8 designs, at all rates


@lru_cache(maxsize=8)
def _of_any_device(case: Case) -> Case:
    """The case of one device; what a tracker knows of single stars is the same for all."""
    alike: Case = unchecked(case, {"instrument.detector.device_seed": 0})
    return alike


@lru_cache(maxsize=8)
def pixel_variance(case: Case) -> Floats:
    """The part of `systematic_variance` that changes while stars cross pixels; zero with a floor.

    Returns  (n,) pixel^2, for the stars of the believed catalogue
    """
    design = _of_any_device(case.as_designed)
    stars = open_sky(design.believed_catalog).stars
    if design.tracker.attitude.centroid_floor is not None or design.instrument.detector.scan:
        return np.zeros(len(stars))
    magnitude = stars.magnitude_g + colour_correction(design, stars.colour)
    return np.asarray(lasting(errors(design), magnitude) ** 2)


def hot_variance(case: Case) -> Floats:
    """What hot pixels add to the variance of stars, at the age of a case, which its tracker knows.

    No star is weighted by it or left out: it is of few stars, of which the tracker does not know
    which, and `solve` states it where the residuals show nothing.

    Returns  (n,) pixel^2 per axis, for the stars of the believed catalogue; zero with a floor
    """
    design, age = _of_any_device(case.as_designed), case.instrument.detector.age
    return _of_hot_pixels(design if age is None or age.time is None else _at_age(design, age.time))


_at_age = lru_cache(maxsize=8)(aged)


@lru_cache(maxsize=8)
def _of_hot_pixels(design: Case) -> Floats:
    """`hot_variance`, which of shifts s in windows with hot pixels, at a chance p, is

        p <s^2 / 2 where s^2 < 2 g^2 (noise + lasting)>

    with the gate g of the solver.

    Accuracy  model: whether a star is left out depends on no other. The normalised error squared,
              3 expected, of 600 windows of the nanosatellite is 3.0 instead of 3.4; of 400 of
              high_accuracy, where nearly each star has a hot pixel, 2.4 instead of 3.4; of 140 to
              200 of `noise_only` at three doses 2.9 to 4.2 instead of 4.9 to 6.8.
    """
    stars = open_sky(design.believed_catalog).stars
    settings = design.tracker.attitude
    left_out = settings.centroid_floor is not None or design.instrument.detector.scan
    if left_out or dark_pattern(design) is None:
        return np.zeros(len(stars))
    star, even = errors(design), with_uniform_dark(design)
    magnitude = star.magnitude[::2]
    flux = scale(even).star * 10 ** (-0.4 * magnitude)
    hot, _ = hot_windows(ResponseGrid(even, sky_electrons(design)), design, flux)
    if not hot.chance:
        return np.zeros(len(stars))
    square = np.nan_to_num((hot.shift**2).sum(axis=-1) / 2, nan=np.inf)
    noise = np.trace(star.stated[::2], axis1=1, axis2=2) / 2
    own = noise + lasting(star, magnitude) ** 2
    used = square < settings.gate**2 * own[:, None]
    variance = hot.chance * np.where(used, square, 0.0).mean(axis=1)
    where = stars.magnitude_g + colour_correction(design, stars.colour)
    return np.interp(where, magnitude, variance)


@lru_cache(maxsize=8)
def _systematic_variance(case: Case) -> Floats:
    stars, floor = open_sky(case.believed_catalog).stars, case.tracker.attitude.centroid_floor
    if floor is None and case.instrument.detector.scan:
        floor = UNKNOWN_FLOOR
    if floor is not None:
        return np.full(len(stars), floor**2)
    variance = lasting(errors(case), stars.magnitude_g + colour_correction(case, stars.colour)) ** 2
    catalog = case.believed_catalog
    name = separated(catalog, index_resolution(case.instrument.camera)).name
    variance[name] += (blending_shift(case, catalog) ** 2).sum(axis=1) / 2
    if case.instrument.optics.tabulated:
        variance += lens_variance(case, mean_colour(case, stars.colour))
    return variance


def shared_errors(case: Case) -> SharedErrors | None:
    """Errors that stars of a unit share, by the laws that its tracker knows, never by their draws.

    Those of the `Residual` that its calibration leaves, by rms and correlation length; and turns of
    the camera to the spacecraft that vary after the calibration: with environment and frame, at
    launch where it was calibrated on the ground, and from unit to unit where it never was. And, as
    of the case as designed, jitter within the exposure.

    Returns  None where the case shares none
    Accuracy  model: what drifts over life, and what temperature changes of a residual, is not known
              to the tracker; jitter by user code is not.
    """
    if case.design is None:
        camera, turn = case.believed_camera, _jitter(case)
        none = np.zeros((1, 1, 2, 1))
        return SharedErrors(camera.columns, camera.rows, none, 0.0, turn) if turn.any() else None
    return _shared_errors(case.as_designed)


@lru_cache(maxsize=8)
def _shared_errors(design: Case) -> SharedErrors | None:
    camera, turn = design.believed_camera.ideal, _turns(design) + _jitter(design)
    table = np.zeros((1, 1, 2, 1))
    if design.tracker.attitude.centroid_floor is None:
        table = _residual_law(design)
    variance = float((table**2).sum(axis=-1).mean())
    if not (variance or turn.any()):
        return None
    return SharedErrors(camera.columns, camera.rows, table, variance, turn)


def _jitter(design: Case) -> Floats:
    """Radian^2 (3,), of the mean of an exposure about the attitude that is asked for."""
    instrument = design.instrument
    if design.tracker.reference == "mean" or instrument.detector.scan:
        return np.zeros(3)
    return np.asarray(jitter_rms(instrument.motion, instrument.detector.exposure) ** 2)


def platform_jitter(case: Case) -> Floats:
    """Radian^2 (3,) about the camera's axes, of the platform's motion within an exposure.

    What the mean of the exposure is off the attitude at its middle, which is asked for: one motion
    of all heads of the spacecraft; zero where the jitter is of the head, or the mean is asked for.
    Jitter by user code is not counted.
    """
    if case.instrument.motion.jitter_of != "platform":
        return np.zeros(3)
    return _jitter(case)


def _turns(design: Case) -> Floats:
    """Radian^2 (3,) about each axis."""
    calibration, turn = design.tracker.calibration, np.zeros(3)
    left = {Scope.ENVIRONMENT, Scope.FRAME}  # which a recursive one does not follow, either
    if calibration is None or calibration.place == "ground":
        left.add(Scope.LAUNCH)
    if calibration is None:
        left.add(Scope.UNIT)
    for variation, law in zip(design.varying, design.laws, strict=True):
        if variation.per in left and variation.name in TURNS:
            size = found_at(design, variation.name) if variation.vary == "relative" else 1.0
            turn[TURNS.index(variation.name)] += size**2 * law.mean_square()
    return turn


def focal_stretches(case: Case) -> Floats | None:
    """`focal_stretch` (n,) of the stars of the believed catalogue; None where all are zero."""
    return _focal_stretches(case.as_designed)


@lru_cache(maxsize=8)
def _focal_stretches(case: Case) -> Floats | None:
    if not case.tracker.focal_length_by_colour:
        return None
    return focal_stretch(case, mean_colour(case, open_sky(case.believed_catalog).stars.colour))


def systematic_variance_of(case: Case, stars: Stars) -> Floats:
    """`systematic_variance` (m,) of stars of the true sky; any value for those not believed in."""
    return systematic_variance(case)[_believed(case, stars)]


def pixel_variance_of(case: Case, stars: Stars) -> Floats:
    """`pixel_variance` (m,) of stars of the true sky; any value for those not believed in."""
    return pixel_variance(case)[_believed(case, stars)]


def _believed(case: Case, stars: Stars) -> Ints:
    return open_sky(case.believed_catalog).stars.find(stars.identifier)[0]
