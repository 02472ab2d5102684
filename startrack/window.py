"""Case and attitude -> the spots of a frame of which only windows are rendered."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.case import Case
from startrack.catalog import open_sky
from startrack.detection import (
    Detection,
    Sky,
    detect_within,
    grown,
    kernel_half,
    lowest_looks,
    margin,
    measure_sky,
    peak_border,
    star_filter,
    star_profile,
    threshold_of,
)
from startrack.detector import (
    Detector,
    Numbers,
    Tilt,
    arriving,
    excesses,
    expose_within,
    frame_of,
    ground,
    ground_tables,
    lone_pixels,
    numbers_of,
    odd_pixels,
    only_lone_pixels,
    put,
    seen,
    tilt_for,
)
from startrack.streams import Streams
from startrack.values import Floats, Ints, Psf, Spots
from startrack.view import light_of, look, path_of, psf_of, throughput, turn_of

BLANKS = 8  # frames without stars, whose background and noise stand for those of all
BLANK_SEED = 2**63 - 1
FAINTEST = 4.5  # sigma below the threshold: a star passes it three times in a million
DARKEST = 0.1  # sigma of the filtered frame; a star that adds less moves no false spot
LEAST_HALF = 3  # pixel


def spots_in_windows(case: Case, icrs_to_camera: Rotation, streams: Streams) -> Spots:
    """What the tracker finds in a frame, from the pixels alone that it could look at.

    Around each star that it may find, and around each pixel unlike the others, the very numbers
    of the frame are rendered and searched. Elsewhere noise alone makes spots: where it passes
    the level of the search is drawn, with the numbers there, from their exact law. What the
    search compares with, background and noise of the frame, is that of one of eight blank frames
    of the design.

    icrs_to_camera  true attitude at the middle of the exposure
    Returns         Spots, brightest first
    Errors          ValueError that names what in the design needs the whole frame.
    """
    instrument, settings = case.instrument, case.tracker.detection
    detector, camera = instrument.detector, instrument.camera
    only_lone_pixels(detector)
    psf = psf_of(instrument)
    stars = look(open_sky(case.catalog), icrs_to_camera, camera)
    light = light_of(case, stars, icrs_to_camera, streams)
    if light.glow:
        raise ValueError(
            "fidelity must be frame where the light of the sky varies over the field, got window"
        )
    star, sky = arriving(light, camera, detector, throughput(instrument))
    path, turn = path_of(instrument, streams), turn_of(instrument, streams)
    places = list(seen(light, path, icrs_to_camera, camera, detector, turn))
    blank = blank_of(detector, sky, settings, psf)
    chosen = blank.skies[int(streams("blank sky").integers(BLANKS))]
    flux = star / detector.electrons_per_dn
    threshold = threshold_of(settings, detector.columns, detector.rows, psf)
    halves = reach_of(flux, chosen, threshold, settings, psf)
    regions = np.concatenate(
        [
            around_paths(np.array([(x, y) for _, x, y in places]), halves, detector),
            around_pixels(
                lone_pixels(detector, sky, streams), kernel_half(settings, psf), detector
            ),
        ]
    )
    looks = lowest_looks(chosen, settings, detector.columns * detector.rows, psf)
    pixel, numbers = excesses(
        blank.numbers, blank.tilt, looks, chosen.mesh, peak_border(settings), regions, streams
    )
    lone = around_pixels(pixel, 0, detector)
    size = detector.columns, detector.rows
    far = margin(settings, psf)
    windows = grown(np.concatenate([regions, lone]), far, *size)
    frame = expose_within(windows, places, star, psf, detector, sky, streams)
    # Numbers of noise must not be written over those about a star, which are searched first then.
    apart = separate(grown(lone, kernel_half(settings, psf), *size), grown(regions, far, *size))
    if apart:
        put(frame, pixel, numbers)
        return detect_within(frame, np.concatenate([regions, lone]), chosen, settings, psf)
    spots = detect_within(frame, regions, chosen, settings, psf)
    put(frame, pixel, numbers)
    return merged(spots, detect_within(frame, lone, chosen, settings, psf), settings.max_spots)


@dataclass(frozen=True, eq=False)
class Blank:
    """What a design's frames without stars are like.

    skies    background and noise of some, as the detection measures them
    numbers  the laws of their numbers
    tilt     those in which the detection's filter passes its level
    """

    skies: tuple[Sky, ...]
    numbers: Numbers
    tilt: Tilt


@lru_cache(maxsize=8)
def blank_of(detector: Detector, sky: float, settings: Detection, psf: Psf) -> Blank:
    """Render and measure blank frames, once per design."""
    level, tables = ground(detector, sky), ground_tables(detector, sky)
    frames = (frame_of(level, detector, Streams(BLANK_SEED, n), tables) for n in range(BLANKS))
    skies = tuple(measure_sky(frame, settings, psf) for frame in frames)
    numbers = numbers_of(detector, sky, odd_pixels(detector, sky).tobytes())
    area = detector.columns * detector.rows
    look = float(np.median([lowest_looks(one, settings, area, psf) for one in skies]))
    tilt = tilt_for(numbers, star_filter(settings, psf), look, skies[0].mesh, peak_border(settings))
    return Blank(skies, numbers, tilt)


def separate(some: Ints, others: Ints) -> bool:
    """Whether no region (m, 4) overlaps one of the others (n, 4)."""
    low = np.maximum(some[:, None, :2], others[:, :2])
    high = np.minimum(some[:, None, 2:], others[:, 2:])
    return not (low < high).all(axis=-1).any()


def merged(spots: Spots, more: Spots, most: int) -> Spots:
    """Spots of both, brightest first, at most so many."""
    order = np.argsort(-np.concatenate([spots.flux, more.flux]), kind="stable")[:most]
    together = (
        np.concatenate([getattr(spots, each.name), getattr(more, each.name)])[order]
        for each in fields(Spots)
    )
    return Spots(*together)


def reach_of(flux: Floats, ground: Sky, threshold: float, settings: Detection, psf: Psf) -> Ints:
    """How far from each star its light matters to the search, pixel; -1 where it never does.

    flux       (n,) digital number
    threshold  sigma
    """
    noise = float(np.median(ground.rms))
    share = star_profile(psf, settings)
    peak = flux * share[0]
    half = len(share) - np.searchsorted(share[::-1], DARKEST * noise / np.maximum(flux, 1e-300))
    faint = peak < (threshold - FAINTEST) * noise
    return np.where(faint, -1, np.maximum(half, LEAST_HALF))


def around_paths(place: Floats, half: Ints, detector: Detector) -> Ints:
    """Regions (w, 4) that hold the paths of stars, and so many pixel more on each side.

    place  (m, 2, n) pixel x and y of the points of the paths
    half   (n,) pixel; stars with -1 are left out
    """
    with np.errstate(invalid="ignore"):
        low, high = np.floor(place.min(axis=0)) - half, np.ceil(place.max(axis=0)) + half + 1
        near = (half >= 0) & (high > 0).all(axis=0)  # not NaN either
        near &= (low[0] < detector.columns) & (low[1] < detector.rows)
    regions = np.concatenate([low[:, near], high[:, near]]).T.astype(np.int64)
    return grown(regions, 0, detector.columns, detector.rows)


def around_pixels(pixel: Ints, half: int, detector: Detector) -> Ints:
    """Regions (w, 4) that hold pixels and so many more on each side."""
    y, x = np.divmod(pixel, detector.columns)
    regions = np.column_stack([x - half, y - half, x + half + 1, y + half + 1])
    return grown(regions, 0, detector.columns, detector.rows)
