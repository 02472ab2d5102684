"""Case and attitude -> the spots of a frame of which only windows are rendered."""

from __future__ import annotations

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
    margin,
    measure_sky,
    star_profile,
    threshold_of,
)
from startrack.detector import (
    Detector,
    arriving,
    expose_within,
    frame_of,
    ground,
    ground_tables,
    lone_pixels,
    only_lone_pixels,
    seen,
)
from startrack.scene import illuminate
from startrack.streams import Streams
from startrack.values import Floats, Ints, Psf, Spots
from startrack.view import look, path_of, psf_of, throughput, turn_of

BLANKS = 8  # frames without stars, whose background and noise stand for those of all
BLANK_SEED = 2**63 - 1
FAINTEST = 4.5  # sigma below the threshold: a star passes it three times in a million
DARKEST = 0.1  # sigma of the filtered frame; a star that adds less moves no false spot
LEAST_HALF = 3  # pixel


def spots_in_windows(case: Case, icrs_to_camera: Rotation, streams: Streams) -> Spots:
    """What the tracker finds in a frame, from the pixels alone that it could look at.

    Around each star that it may find, and around each pixel unlike the others, the very numbers
    of the frame are rendered and searched. What the search compares them with, background and
    noise of the frame, is that of one of eight blank frames of the design.

    icrs_to_camera  true attitude at the middle of the exposure
    Returns         Spots, brightest first
    Errors          ValueError that names what in the design needs the whole frame.
    """
    instrument, settings = case.instrument, case.tracker.detection
    detector, camera = instrument.detector, instrument.camera
    only_lone_pixels(detector)
    psf = psf_of(instrument)
    light = illuminate(case.scene, look(open_sky(case.catalog), icrs_to_camera, camera))
    star, sky = arriving(light, camera, detector, throughput(instrument))
    path, turn = path_of(instrument, streams), turn_of(instrument, streams)
    places = list(seen(light, path, icrs_to_camera, camera, detector, turn))
    skies = blank_skies(detector, sky, settings, psf)
    chosen = skies[int(streams("blank sky").integers(BLANKS))]
    threshold = threshold_of(settings, detector.columns, detector.rows, psf)
    halves = reach_of(star / detector.electrons_per_dn, chosen, threshold, settings, psf)
    regions = np.concatenate(
        [
            around_paths(np.array([(x, y) for _, x, y in places]), halves, detector),
            around_pixels(lone_pixels(detector, sky, streams), settings, psf, detector),
        ]
    )
    windows = grown(regions, margin(settings, psf), detector.columns, detector.rows)
    frame = expose_within(windows, places, star, psf, detector, sky, streams)
    return detect_within(frame, regions, chosen, settings, psf)


@lru_cache(maxsize=8)
def blank_skies(detector: Detector, sky: float, settings: Detection, psf: Psf) -> tuple[Sky, ...]:
    """Background and noise of frames without stars, as the detection measures them."""
    level, tables = ground(detector, sky), ground_tables(detector, sky)
    frames = (frame_of(level, detector, Streams(BLANK_SEED, n), tables) for n in range(BLANKS))
    return tuple(measure_sky(frame, settings, psf) for frame in frames)


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


def around_pixels(pixel: Ints, settings: Detection, psf: Psf, detector: Detector) -> Ints:
    """Regions (w, 4) around single pixels, as far as the detection's filter spreads them."""
    y, x = np.divmod(pixel, detector.columns)
    half = kernel_half(settings, psf)
    regions = np.column_stack([x - half, y - half, x + half + 1, y + half + 1])
    return grown(regions, 0, detector.columns, detector.rows)
