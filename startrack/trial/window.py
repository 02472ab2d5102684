"""Case and attitude -> the spots of a frame; only windows of the frame are rendered."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core, detection
from startrack.catalog import open_sky
from startrack.core import Floats, Ints, Refused, Spots, kernel
from startrack.design import Case, Instrument
from startrack.detection import grown_mask, margin, peak_border
from startrack.detector import (
    arriving,
    expose,
    expose_within,
    independent_pixels,
    mean_wavelength,
    require_independent_pixels,
    seen,
    threshold_crossings,
    write_numbers,
)
from startrack.motion import MotionRealisation
from startrack.observation import (
    as_believed,
    colours_of,
    detection_plan,
    electrons_of,
    exposure_of,
    images_of,
    light_of,
    line_of_sight,
    motion_before,
    motion_function,
    nearby,
    sky_electrons,
    stars_in_field,
    throughput,
)
from startrack.trial.effects import require_window
from startrack.trial.window_plan import Smear, WindowPlan, cost, plan_windows

FAINTEST = 4.5  # sigma below the threshold, where a star passes 3 times in a million
DARKEST = 0.1  # sigma of the filtered frame; a star that adds less changes no false spot
LEAST_HALF = 3  # pixel, least half side of a star's window; chosen by hand


def spots_in_windows(
    case: Case,
    icrs_to_camera: Rotation,
    streams: core.Streams,
    turn: MotionRealisation | None = None,
    smear: Smear = None,
    plan: WindowPlan | None = None,
) -> Spots:
    """The spots of a frame; only windows of the frame are rendered and searched.

    Around each star that may be detected, and around each outlier pixel, a window is rendered with
    the same numbers as in the whole frame. Elsewhere only noise makes spots. The pixels where noise
    exceeds the search level are drawn from their exact distribution, with the numbers around them.
    The search takes background and noise from one of 16 whole frames of the design. If the windows
    would take more time than the whole frame, the whole frame is rendered and searched.

    icrs_to_camera  true attitude at the middle of the exposure
    turn            motion of the camera relative to this attitude; None: drawn by the design
    smear           pixel along x and y, that the tracker assumes; None: the design's
    plan            plan of the case; None: `plan_windows`
    Returns         Spots, brightest first
    Raises          ValueError with the part of the design that needs the whole frame.
    Accuracy        statistical: all trials of all seeds take background and noise from the same 16
                    sample frames. More trials do not average out the difference of these frames
                    from the mean of all frames.
    """
    plan, instrument = plan or plan_windows(case, smear), case.instrument
    detector, sky, settings = plan.detector, plan.sky, case.tracker.detection
    noise = plan.noise
    if noise is None:
        return spots_of_frame(case, icrs_to_camera, streams, turn, smear)
    direction, star, colour = arrive(case, plan, icrs_to_camera, streams)
    weight, x, y = path_points(instrument, direction, icrs_to_camera, streams, turn)
    ground, rates = noise.grounds[int(streams("sample of the sky").integers(len(noise.grounds)))]
    half = reach_of(star / detector.electrons_per_dn, ground.noise, plan)
    size, far = (detector.columns, detector.rows), margin(plan.detection)
    regions = around_paths(x, y, half, *size)
    apart = independent_pixels(detector, noise.outliers, streams)
    if len(apart):
        regions = np.concatenate([regions, around_pixels(apart, plan.spread, *size)])
    rendered = grown_mask(regions, far, *size)
    if cost(area(rendered), rates.total) > detector.columns * detector.rows:
        return spots_of_frame(case, icrs_to_camera, streams, turn, smear)
    pixel, numbers = threshold_crossings(
        noise.numbers, noise.tilt, rates, ground.sky.mesh, peak_border(settings), regions, streams
    )
    noisy = around_pixels(pixel, 0, *size)
    every = np.concatenate([regions, noisy])
    windows = grown_mask(every, far, *size)
    frame = expose_within(
        windows, (weight, x, y), star, plan.psf, detector, sky, streams, plan.workspace, colour
    )
    frame = as_believed(case, frame)
    # Drawn noise must not overwrite the numbers around a star, so stars are searched first.
    if separate(grown_mask(noisy, plan.spread, *size), windows[: len(regions)]):
        write_numbers(frame, pixel, numbers)
        return detection.detect_within(frame, every, ground, plan.detection)
    spots = detection.detect_within(frame, regions, ground, plan.detection)
    write_numbers(frame, pixel, numbers)
    return merged(
        spots, detection.detect_within(frame, noisy, ground, plan.detection), settings.max_spots
    )


def frame_in_windows(
    case: Case, icrs_to_camera: Rotation, streams: core.Streams, windows: Ints
) -> core.Frame:
    """A frame that equals the whole frame in windows (w, 4), and is its background elsewhere.

    The whole frame is rendered if its pixels flicker or lights of the scene vary.
    """
    instrument = case.instrument
    if instrument.detector.flickers or case.scene.lights:
        return whole_frame(case, icrs_to_camera, streams)
    detector = replace(instrument.detector, lag=0.0)
    require_independent_pixels(detector)
    require_window(case, "instrument.ghosts")
    sky, psf = open_sky(case.catalog), images_of(instrument)
    near = nearby(sky, icrs_to_camera, instrument.camera)
    colour = colours_of(case)[near] if isinstance(psf, core.FieldPsf) else None
    places = path_points(instrument, sky.stars.direction[near], icrs_to_camera, streams)
    star, level = electrons_of(case)[near], sky_electrons(case)
    return expose_within(
        windows, places, star, psf, detector, level, streams, core.Workspace(), colour
    )


def spots_of_frame(
    case: Case,
    icrs_to_camera: Rotation,
    streams: core.Streams,
    turn: MotionRealisation | None = None,
    smear: Smear = None,
) -> Spots:
    """The spots of the whole frame."""
    frame = whole_frame(case, icrs_to_camera, streams, turn)
    return detection.detect(as_believed(case, frame), detection_plan(case, smear=smear))


def whole_frame(
    case: Case,
    icrs_to_camera: Rotation,
    streams: core.Streams,
    turn: MotionRealisation | None = None,
) -> core.Frame:
    """The whole frame of a trial."""
    instrument = case.instrument
    in_field = stars_in_field(open_sky(case.catalog), icrs_to_camera, instrument.camera)
    light = light_of(case, in_field, icrs_to_camera, streams)
    path = line_of_sight(instrument, streams, turn)
    return expose(exposure_of(instrument, light, path, icrs_to_camera, streams, turn), streams)


@kernel
def area(windows: Ints) -> int:
    """Total pixels of windows (w, 4); shared pixels count once for each window."""
    pixels = 0
    for left, top, right, bottom in windows:
        pixels += (right - left) * (bottom - top)
    return pixels


def arrive(
    case: Case, plan: WindowPlan, icrs_to_camera: Rotation, streams: core.Streams
) -> tuple[Floats, Floats, Floats | None]:
    """Directions (n, 3) of the points that reach the detector, and their electrons (n,).

    With a lens table, also their mean wavelengths (n,).
    """
    camera, detector = case.instrument.camera, case.instrument.detector
    sky = open_sky(case.catalog)
    if plan.star is not None:
        near = nearby(sky, icrs_to_camera, camera)
        colour = None if plan.colour is None else plan.colour[near]
        return sky.stars.direction[near], plan.star[near], colour
    in_field = stars_in_field(sky, icrs_to_camera, camera)
    light = light_of(case, in_field, icrs_to_camera, streams)
    if light.diffuse:
        raise Refused(
            "fidelity must be frame if the light of the sky varies over the field, got window"
        )
    through, colour = throughput(case.instrument), None
    if isinstance(plan.psf, core.FieldPsf):
        colour = mean_wavelength(light, detector, through)
    return light.direction, arriving(light, camera, detector, through)[0], colour


def path_points(
    instrument: Instrument,
    direction: Floats,
    icrs_to_camera: Rotation,
    streams: core.Streams,
    turn: MotionRealisation | None = None,
) -> tuple[Floats, Floats, Floats]:
    """Weights (m,), and x and y (m, n), of the points of the stars' paths.

    The residual charge of the previous frame is a fainter star at the star's place in that frame.
    """
    path, lag = line_of_sight(instrument, streams, turn), instrument.detector.lag
    views = [(1 - lag, path, motion_function(instrument, streams, turn))]
    if lag:
        views.append((lag, *motion_before(instrument, path, streams, turn)))
    camera, detector = instrument.camera, instrument.detector
    parts = [
        (fraction * weight, x, y)
        for fraction, path, course in views
        for weight, x, y in seen(direction, path, icrs_to_camera, camera, detector, course)
    ]
    if len(parts) == 1:
        return parts[0]
    weight, x, y = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return weight, x, y


@kernel
def separate(some: Ints, others: Ints) -> bool:
    """Whether none of the regions (m, 4) overlaps any of the others (n, 4)."""
    for region in some:
        for other in others:
            across = max(region[0], other[0]) < min(region[2], other[2])
            if across and max(region[1], other[1]) < min(region[3], other[3]):
                return False
    return True


def merged(spots: Spots, more: Spots, most: int) -> Spots:
    """The spots of two sets, brightest first, at most `most`."""
    order = np.argsort(-np.concatenate([spots.flux, more.flux]), kind="stable")[:most]
    together = (
        np.concatenate([getattr(spots, field.name), getattr(more, field.name)])[order]
        for field in fields(Spots)
    )
    return Spots(*together)


def reach_of(flux: Floats, noise: float, plan: WindowPlan) -> Ints:
    """Pixel: distance from each star within which its light affects the search; -1: nowhere.

    flux   (n,) digital number
    noise  digital number, of the filtered frame
    """
    least = (plan.threshold - FAINTEST) * noise
    return np.asarray(
        _reach(flux, plan.fraction, least, DARKEST * noise, bool(plan.detector.crosstalk))
    )


@kernel
def _reach(flux, fraction, least, dark, more):  # type: ignore[no-untyped-def]
    half = np.empty(len(flux), np.int64)
    for n in range(len(flux)):
        pixels = len(fraction)
        while pixels > 0 and flux[n] * fraction[pixels - 1] < dark:
            pixels -= 1
        half[n] = -1 if flux[n] * fraction[0] < least else max(pixels + more, LEAST_HALF)
    return half


@kernel
def around_paths(x: Floats, y: Floats, half: Ints, columns: int, rows: int) -> Ints:
    """Regions (w, 4) that contain the paths of stars, with a margin on each side.

    x, y  (m, n) pixel, points of the paths
    half  (n,) pixel, margin; stars with -1 are left out
    """
    regions = np.empty((len(half), 4), np.int64)
    count = 0
    for n in range(len(half)):
        left, top = x[:, n].min() - half[n], y[:, n].min() - half[n]
        right, bottom = x[:, n].max() + half[n] + 1, y[:, n].max() + half[n] + 1
        # NaN makes the condition false.
        if half[n] >= 0 and left < columns and top < rows and right > 0 and bottom > 0:
            regions[count, 0], regions[count, 1] = max(math.floor(left), 0), max(math.floor(top), 0)
            regions[count, 2] = min(math.ceil(right), columns)
            regions[count, 3] = min(math.ceil(bottom), rows)
            # The region of a star near a brighter one often lies within the region of that star.
            count += not _within_another(regions[count], regions[:count])
    return regions[:count]


@kernel
def _within_another(region, others):  # type: ignore[no-untyped-def]
    for other in others:
        begins = region[0] >= other[0] and region[1] >= other[1]
        if begins and region[2] <= other[2] and region[3] <= other[3]:
            return True
    return False


@kernel
def around_pixels(pixel: Ints, half: int, columns: int, rows: int) -> Ints:
    """Regions (w, 4) around pixels, with `half` more pixels on each side."""
    regions = np.empty((len(pixel), 4), np.int64)
    for k in range(len(pixel)):
        y, x = pixel[k] // columns, pixel[k] % columns
        regions[k, 0], regions[k, 1] = max(x - half, 0), max(y - half, 0)
        regions[k, 2], regions[k, 3] = min(x + half + 1, columns), min(y + half + 1, rows)
    return regions
