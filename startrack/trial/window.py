"""Case and attitude -> the spots of a frame of which only windows are rendered."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation

from startrack.catalog import Sky, open_sky
from startrack.core import Floats, Ints, Psf, Spots, Streams
from startrack.design import Case, Instrument
from startrack.detection import (
    Ground,
    detect_within,
    grown_mask,
    kernel_half,
    margin,
    measure_ground,
    peak_border,
    star_filter,
    star_profile,
    threshold_of,
)
from startrack.detector import (
    Detector,
    Numbers,
    Rates,
    Tilt,
    arriving,
    expose_within,
    frame_of,
    independent_pixels,
    numbers_of,
    outlier_pixels,
    put,
    rates_for,
    require_independent_pixels,
    seen,
    threshold_crossings,
    tilt_for,
)
from startrack.scene import illuminate
from startrack.trial.view import (
    electrons_of,
    expected_electrons,
    light_of,
    line_of_sight,
    motion_before,
    motion_function,
    nearby,
    psf_of,
    random_attitude,
    stars_in_field,
    throughput,
)

SAMPLES = 16  # frames, whose background and noise stand for those of all
SAMPLE_SEED = 2**63 - 1
FAINTEST = 4.5  # sigma below the threshold: a star passes it three times in a million
DARKEST = 0.1  # sigma of the filtered frame; a star that adds less moves no false spot
LEAST_HALF = 3  # pixel
# Standard deviations of a pixel, by which an odd pixel's expectation lies off. Each costs a window;
# those that are no odd ones make noise pass the level more often, and so cost more tries.
ODD = (4.0, 0.6)


def spots_in_windows(case: Case, icrs_to_camera: Rotation, streams: Streams) -> Spots:
    """What the tracker finds in a frame, from the pixels alone that it could look at.

    Around each star that it may find, and around each pixel unlike the others, the very numbers
    of the frame are rendered and searched. Elsewhere noise alone makes spots: where it passes
    the level of the search is drawn, with the numbers there, from their exact law. What the
    search compares with, background and noise of the frame, is that of one of sixteen whole
    frames of the design.

    icrs_to_camera  true attitude at the middle of the exposure
    Returns         Spots, brightest first
    Raises          ValueError that names what in the design needs the whole frame.
    """
    plan, instrument = plan_of(case), case.instrument
    detector, sky, psf, settings = plan.detector, plan.sky, plan.psf, case.tracker.detection
    direction, star = arrive(case, plan, icrs_to_camera, streams)
    weight, x, y = places_of(instrument, direction, icrs_to_camera, streams)
    noise = plan.noise
    ground, rates = noise.grounds[int(streams("sample of the sky").integers(SAMPLES))]
    half = reach_of(star / detector.electrons_per_dn, ground.noise, plan)
    size = detector.columns, detector.rows
    regions = around_paths(x, y, half, *size)
    odd = independent_pixels(detector, noise.odd, streams)
    if len(odd):
        regions = np.concatenate([regions, around_pixels(odd, plan.spread, *size)])
    pixel, numbers = threshold_crossings(
        noise.numbers, noise.tilt, rates, ground.sky.mesh, plan.border, regions, streams
    )
    lone = around_pixels(pixel, 0, *size)
    every = np.concatenate([regions, lone])
    windows = grown_mask(every, plan.far, *size)
    frame = expose_within(windows, (weight, x, y), star, psf, detector, sky, streams)
    # Numbers of noise must not be written over those about a star, which are searched first then.
    if separate(grown_mask(lone, plan.spread, *size), windows[: len(regions)]):
        put(frame, pixel, numbers)
        return detect_within(frame, every, ground, settings, psf)
    spots = detect_within(frame, regions, ground, settings, psf)
    put(frame, pixel, numbers)
    return merged(spots, detect_within(frame, lone, ground, settings, psf), settings.max_spots)


def arrive(
    case: Case, plan: Plan, icrs_to_camera: Rotation, streams: Streams
) -> tuple[Floats, Floats]:
    """Directions (n, 3) of the points that reach the detector, and their electrons (n,)."""
    camera, detector = case.instrument.camera, case.instrument.detector
    if plan.star is not None:
        near = nearby(plan.catalog, icrs_to_camera, camera)
        return plan.catalog.stars.direction[near], plan.star[near]
    light = light_of(
        case, stars_in_field(plan.catalog, icrs_to_camera, camera), icrs_to_camera, streams
    )
    if light.diffuse:
        raise ValueError(
            "fidelity must be frame where the light of the sky varies over the field, got window"
        )
    return light.direction, arriving(light, camera, detector, throughput(case.instrument))[0]


def places_of(
    instrument: Instrument, direction: Floats, icrs_to_camera: Rotation, streams: Streams
) -> tuple[Floats, Floats, Floats]:
    """Weights (m,), x and y (m, n) of the points of the stars' paths.

    What the frame before left is a fainter star, where the star was then.
    """
    path, lag = line_of_sight(instrument, streams), instrument.detector.lag
    views = [(1 - lag, path, motion_function(instrument, streams))]
    if lag:
        views.append((lag, *motion_before(instrument, path, streams)))
    camera, detector = instrument.camera, instrument.detector
    parts = [
        (fraction * weight, x, y)
        for fraction, path, course in views
        for weight, x, y in seen(direction, path, icrs_to_camera, camera, detector, course)
    ]
    if len(parts) == 1:
        return parts[0]
    weight, x, y = (np.concatenate(each) for each in zip(*parts, strict=True))
    return weight, x, y


class Noise(NamedTuple):
    """Where noise alone passes the level of the search.

    odd      (k,) row * columns + column of the pixels that no law of these holds for
    numbers  the laws of the numbers of a frame without stars
    tilt     those in which the detection's filter passes its level
    grounds  what some frames compare with, and how often noise is to be tried there
    """

    odd: Ints
    numbers: Numbers
    tilt: Tilt
    grounds: tuple[tuple[Ground, Rates], ...]


@dataclass(frozen=True, eq=False)
class Plan:
    """All that the trials of a case share.

    detector   without its lag, which stars alone show: it leaves an even sky as it is
    catalog    the sky;  star  (n,) electron of each in it, None where a scene holds more light
    sky        electron in a pixel of mean response
    noise      what makes false spots
    threshold  sigma
    fraction   (k,) 1, of a star's light in a pixel of the filtered frame, at 0, 1, 2, ... pixel
    spread     pixel, that the filter reaches;  far  that the detection looks from a peak
    border     pixel, that a peak keeps from the frame's border
    """

    detector: Detector
    catalog: Sky
    star: Floats | None
    sky: float
    psf: Psf
    noise: Noise
    threshold: float
    fraction: Floats
    spread: int
    far: int
    border: int


@lru_cache(maxsize=8)
def plan_of(case: Case) -> Plan:
    """Render and measure some frames, once per design."""
    instrument, settings = case.instrument, case.tracker.detection
    detector, psf = replace(instrument.detector, lag=0.0), psf_of(instrument)
    require_independent_pixels(detector)
    light = illuminate(case.scene, open_sky(case.catalog).stars[:0])
    _, sky = arriving(light, instrument.camera, detector, throughput(instrument))
    grounds = [ground_of(case, Streams(SAMPLE_SEED, n)) for n in range(SAMPLES)]
    border = peak_border(settings)
    return Plan(
        detector,
        open_sky(case.catalog),
        None if case.scene.lights else electrons_of(case),
        sky,
        psf,
        noise_of(detector, sky, grounds, star_filter(settings, psf), border),
        threshold_of(settings, detector.columns, detector.rows, psf),
        star_profile(psf, settings),
        kernel_half(settings, psf),
        margin(settings, psf),
        border,
    )


def noise_of(
    detector: Detector, sky: float, grounds: Sequence[Ground], weight: Floats, border: int
) -> Noise:
    """The widest laws that serve: of noise that is seldom looked at, and of few odd pixels.

    weight, border  as `tilt_for` takes them
    Raises          ValueError where noise passes the level so often that whole frames are cheaper.
    """
    level, mesh = float(np.median([one.lowest for one in grounds])), grounds[0].sky.mesh
    for limit in ODD:
        odd = outlier_pixels(detector, sky, limit)
        try:
            numbers = numbers_of(detector, sky, odd.tobytes())
            tilt = tilt_for(numbers, weight, level, mesh, border)
            rates = [rates_for(numbers, tilt, one.lowest) for one in grounds]
        except ValueError as reason:
            refusal = reason
            continue
        return Noise(odd, numbers, tilt, tuple(zip(grounds, rates, strict=True)))
    raise refusal


def ground_of(case: Case, streams: Streams) -> Ground:
    """What the search of one frame of the design compares with; its stars raise that a little."""
    case = replace(case, scene=replace(case.scene, lights=()))
    instrument, attitude = case.instrument, random_attitude(streams)
    stars = stars_in_field(open_sky(case.catalog), attitude, instrument.camera)
    electrons = expected_electrons(
        case, stars, line_of_sight(instrument, streams), attitude, streams
    )
    frame = frame_of(electrons, instrument.detector, streams)
    return measure_ground(frame, case.tracker.detection, psf_of(instrument))


@njit(cache=True, error_model="numpy")
def separate(some: Ints, others: Ints) -> bool:
    """Whether no region (m, 4) overlaps one of the others (n, 4)."""
    for one in some:
        for other in others:
            across = max(one[0], other[0]) < min(one[2], other[2])
            if across and max(one[1], other[1]) < min(one[3], other[3]):
                return False
    return True


def merged(spots: Spots, more: Spots, most: int) -> Spots:
    """Spots of both, brightest first, at most so many."""
    order = np.argsort(-np.concatenate([spots.flux, more.flux]), kind="stable")[:most]
    together = (
        np.concatenate([getattr(spots, each.name), getattr(more, each.name)])[order]
        for each in fields(Spots)
    )
    return Spots(*together)


def reach_of(flux: Floats, noise: float, plan: Plan) -> Ints:
    """How far from each star its light matters to the search, pixel; -1 where it never does.

    flux   (n,) digital number
    noise  digital number, of the filtered frame
    """
    least = (plan.threshold - FAINTEST) * noise
    return np.asarray(
        _reach(flux, plan.fraction, least, DARKEST * noise, bool(plan.detector.crosstalk))
    )


@njit(cache=True, error_model="numpy")
def _reach(flux, fraction, least, dark, more):  # type: ignore[no-untyped-def]
    half = np.empty(len(flux), np.int64)
    for n in range(len(flux)):
        reach = len(fraction)
        while reach > 0 and flux[n] * fraction[reach - 1] < dark:
            reach -= 1
        half[n] = -1 if flux[n] * fraction[0] < least else max(reach + more, LEAST_HALF)
    return half


@njit(cache=True, error_model="numpy")
def around_paths(x: Floats, y: Floats, half: Ints, columns: int, rows: int) -> Ints:
    """Regions (w, 4) that hold the paths of stars, and so many pixel more on each side.

    x, y  (m, n) pixel, of the points of the paths
    half  (n,) pixel; stars with -1 are left out
    """
    regions = np.empty((len(half), 4), np.int64)
    count = 0
    for n in range(len(half)):
        left, top = x[:, n].min() - half[n], y[:, n].min() - half[n]
        right, bottom = x[:, n].max() + half[n] + 1, y[:, n].max() + half[n] + 1
        # Not NaN either.
        if half[n] >= 0 and left < columns and top < rows and right > 0 and bottom > 0:
            regions[count, 0], regions[count, 1] = max(math.floor(left), 0), max(math.floor(top), 0)
            regions[count, 2] = min(math.ceil(right), columns)
            regions[count, 3] = min(math.ceil(bottom), rows)
            # A star beside a brighter one often has no region of its own.
            count += not _held(regions[count], regions[:count])
    return regions[:count]


@njit(cache=True, error_model="numpy")
def _held(region, others):  # type: ignore[no-untyped-def]
    for other in others:
        begins = region[0] >= other[0] and region[1] >= other[1]
        if begins and region[2] <= other[2] and region[3] <= other[3]:
            return True
    return False


@njit(cache=True, error_model="numpy")
def around_pixels(pixel: Ints, half: int, columns: int, rows: int) -> Ints:
    """Regions (w, 4) that hold pixels and so many more on each side."""
    regions = np.empty((len(pixel), 4), np.int64)
    for k in range(len(pixel)):
        y, x = pixel[k] // columns, pixel[k] % columns
        regions[k, 0], regions[k, 1] = max(x - half, 0), max(y - half, 0)
        regions[k, 2], regions[k, 3] = min(x + half + 1, columns), min(y + half + 1, rows)
    return regions
