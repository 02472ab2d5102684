"""Case and attitude -> the spots of a frame; only windows of the frame are rendered."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core, detection
from startrack.catalog import open_sky
from startrack.core import Floats, Ints, Refused, Spots, kept, kernel
from startrack.design import Case, Instrument
from startrack.detection import DetectionPlan, FrameBackground, grown_mask, margin, peak_border
from startrack.detector import (
    Detector,
    NumberDistributions,
    ProposalRates,
    TiltedLaw,
    arriving,
    expose,
    expose_within,
    frame_of,
    independent_pixels,
    mean_wavelength,
    number_distributions,
    outlier_pixels,
    proposal_rates,
    require_independent_pixels,
    seen,
    threshold_crossings,
    tilted_law,
    write_numbers,
)
from startrack.motion import MotionRealisation
from startrack.observation import (
    as_believed,
    colours_of,
    detection_plan,
    electrons_of,
    expected_electrons,
    exposure_of,
    images_of,
    light_of,
    line_of_sight,
    motion_before,
    motion_function,
    nearby,
    psf_of,
    random_attitude,
    sky_electrons,
    stars_in_field,
    throughput,
)
from startrack.trial.effects import require_window

Smear = tuple[float, float] | None
SAMPLES = 16  # number of frames whose background and noise represent all frames
SAMPLE_SEED = 2**63 - 1
FAINTEST = 4.5  # sigma below the threshold, where a star passes 3 times in a million
DARKEST = 0.1  # sigma of the filtered frame; a star that adds less changes no false spot
LEAST_HALF = 3  # pixel, least half side of a star's window; chosen by hand
# Limits of the deviation of a pixel's mean, in sigma of its noise; pixels beyond are outliers. Each
# outlier costs a window. All other pixels raise the number of crossings, and so of proposals.
OUTLIER_LIMITS = (4.0, 2.0, 1.2, 0.6)
# Times in units of the time of a pixel in a whole frame, measured on frames of 512 and 1024 pixels
# a side.
WINDOW_PIXEL = 3.0  # time of a pixel that is rendered in a window
PROPOSAL = 300.0  # time of a proposed crossing; its windows, if it is accepted, are included


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
    ground, rates = noise.grounds[int(streams("sample of the sky").integers(SAMPLES))]
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


def cost(pixels: float, proposals: float) -> float:
    """Time of windows and of drawing crossings, in pixels of a whole frame."""
    return WINDOW_PIXEL * pixels + PROPOSAL * proposals


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


class Noise(NamedTuple):
    """The distribution of noise that exceeds the search level.

    outliers  (k,) row * columns + column of the pixels to which the distributions do not apply
    numbers   distributions of the numbers of a frame without stars
    tilt      the same distributions, given that the filtered number exceeds the level
    grounds   levels of some frames, and the rates of proposals in them
    """

    outliers: Ints
    numbers: NumberDistributions
    tilt: TiltedLaw
    grounds: tuple[tuple[FrameBackground, ProposalRates], ...]


@dataclass(frozen=True, eq=False)
class WindowPlan:
    """Values that all trials of a case share.

    detector   detector without its lag, which changes stars only, not a uniform background
    star       (n,) electron of each star of the sky; None for a scene with other lights
    colour     (n,) metre, mean wavelengths of the stars, if the image varies with colour
    sky        electron in a pixel of mean response
    psf        images of stars
    noise      law of false spots; None if whole frames take less time than windows
    threshold  sigma
    fraction   (k,) 1, fraction of a star's light in a pixel of the filtered frame, at a distance of
               0, 1, 2, ... pixel
    spread     pixel, distance over which a pixel of the filtered frame depends on others
    detection  detection plan of the tracker
    workspace  workspace of the frames
    """

    detector: Detector
    star: Floats | None
    colour: Floats | None
    sky: float
    psf: core.Psf | core.FieldPsf
    noise: Noise | None
    threshold: float
    fraction: Floats
    spread: int
    detection: DetectionPlan
    workspace: core.Workspace


@kept(8)
def plan_windows(case: Case, smear: Smear = None) -> WindowPlan:
    """Render and measure some frames of a case; cached for the last 8 cases."""
    instrument = case.instrument
    detector, psf = replace(instrument.detector, lag=0.0), psf_of(instrument)
    require_independent_pixels(detector)
    # Lights that vary over the field are refused later, at the attitudes where they vary.
    require_window(case, "instrument.ghosts", "tracker.detection.search", "tracker.rate")
    sky = sky_electrons(case)
    plan = detection_plan(case, smear=smear)
    grounds = [ground_of(case, core.Streams(SAMPLE_SEED, n), plan) for n in range(SAMPLES)]
    kernel = plan.kernel
    stars_alone = not case.scene.lights
    return WindowPlan(
        detector=detector,
        star=electrons_of(case) if stars_alone else None,
        colour=colours_of(case) if instrument.optics.tabulated and stars_alone else None,
        sky=sky,
        psf=images_of(instrument),
        noise=None if detector.flickers else noise_of(detector, sky, grounds, plan),
        threshold=plan.threshold(detector.columns * detector.rows),
        fraction=detection.star_profile(psf, kernel),
        spread=kernel.half + (plan.correction is not None),
        detection=plan,
        workspace=core.Workspace(),
    )


def noise_of(
    detector: Detector, sky: float, grounds: Sequence[FrameBackground], plan: DetectionPlan
) -> Noise | None:
    """Noise distributions, with the number of outlier pixels for which windows take least time.

    plan     plan of the detection; a hot pixel of its dark map is not an outlier
    Returns  None if whole frames take less time, or if the noise spans too many digital numbers for
             a table
    """
    level, mesh = float(np.median([ground.lowest for ground in grounds])), grounds[0].sky.mesh
    weight, border = plan.kernel.whole.astype(float), peak_border(plan.settings)
    hot, shift = None, {}
    if plan.correction is not None:
        hot, weight = plan.correction.hot, np.pad(weight, 1)
        shift["shift"] = detection.filtered(
            detection.correction_image(plan.correction), plan.kernel
        )
    far = margin(plan) + max(weight.shape) // 2
    best, least = None, float(detector.columns * detector.rows)
    for limit in OUTLIER_LIMITS:
        outliers = outlier_pixels(detector, sky, limit)
        if hot is not None:
            outliers = np.setdiff1d(outliers, hot, assume_unique=True)
        apart = cost(len(outliers) * (2 * far + 1) ** 2, 0)
        if apart >= least:
            break  # a lower limit makes more outliers
        numbers = number_distributions(detector, sky, outliers, hot)
        if numbers is None:
            continue
        tilt = tilted_law(numbers, weight, level, mesh, border, **shift)
        rates = [proposal_rates(numbers, tilt, ground.lowest) for ground in grounds]
        drawn = cost(0, float(np.mean([ground.total for ground in rates])))
        if apart + drawn < least:
            best, least = (
                Noise(outliers, numbers, tilt, tuple(zip(grounds, rates, strict=True))),
                apart + drawn,
            )
        if drawn <= apart:
            break  # a lower limit saves less time than it costs
    return best


def ground_of(case: Case, streams: core.Streams, plan: DetectionPlan) -> FrameBackground:
    """Background and noise of one frame of the design; its stars raise both a little."""
    case = replace(case, scene=replace(case.scene, lights=()))
    instrument, attitude = case.instrument, random_attitude(streams)
    in_field = stars_in_field(open_sky(case.catalog), attitude, instrument.camera)
    path = line_of_sight(instrument, streams)
    electrons = expected_electrons(case, in_field, path, attitude, streams)
    frame = as_believed(case, frame_of(electrons, instrument.detector, streams))
    return detection.measure_ground(frame, plan)


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
