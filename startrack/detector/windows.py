"""Stars and regions -> a Frame that holds the right numbers around these regions alone."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.detector.digitise import digitise_hit, digitise_within
from startrack.detector.expose import Places, draw, told
from startrack.detector.ground import ground, ground_tables
from startrack.detector.hits import tracks
from startrack.detector.law import kind_of, law_of
from startrack.detector.parameters import Detector
from startrack.detector.readout import in_steps
from startrack.scratch import scratch
from startrack.streams import Streams
from startrack.values import Frame, Psf

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ODD = 0.6  # standard deviations of a pixel, by which an odd pixel's expectation lies off


def only_lone_pixels(detector: Detector) -> None:
    """Refuse a detector whose pixels know of each other, or of the frame before.

    Errors  ValueError that names the effect.
    """
    effects = {
        "blooming": detector.blooming,
        "multiplication": detector.multiplication > 1,
        "pattern": detector.pattern,
        "settling": detector.settling,
        "read_noise_spread": detector.read_noise_spread,
        "lag": detector.lag,
        "crosstalk": detector.crosstalk,
    }
    named = [name for name, there in effects.items() if there]
    if named or in_steps(detector):
        raise ValueError(
            "windows need pixels that know nothing of each other, so that the detector must be "
            f"without {' and '.join(named)}; choose the fidelity frame"
        )


def expose_within(
    windows: Ints,
    places: Places,
    star: Floats,
    psf: Psf,
    detector: Detector,
    sky: float,
    streams: Streams,
) -> Frame:
    """The numbers that `expose` gives, in windows; elsewhere whatever was left there.

    windows  (w, 4) left, top, right, bottom, the last two not in it; they may overlap
    places   weight, x and y of each point of the stars' paths
    star     (n,) electron in the exposure
    sky      electron in a pixel of mean response
    Returns  Frame, which the next call overwrites
    """
    shape, law = (detector.rows, detector.columns), law_of(detector)
    electrons = scratch("expected electrons", shape, np.float64)
    image = scratch("digital numbers", shape, kind_of(law))
    _lay(electrons, ground(detector, sky), windows)
    draw(electrons, psf, places, star, detector)
    digitise_within(image, electrons, windows, law, streams, ground_tables(detector, sky))
    if detector.hits:
        pixel, extra = tracks(detector.hits, shape, detector.pitch, detector.exposure, streams)
        digitise_hit(image, electrons, pixel, extra, law, streams)
    return told(image, detector)


def lone_pixels(detector: Detector, sky: float, streams: Streams) -> Ints:
    """The pixels that are unlike their neighbours: hit, hot or dead.

    Returns  (k,) row * columns + column
    """
    odd = _odd_pixels(detector, sky)
    if not detector.hits:
        return odd
    shape = (detector.rows, detector.columns)
    pixel, _ = tracks(detector.hits, shape, detector.pitch, detector.exposure, streams)
    return np.concatenate([odd, pixel])


@lru_cache(maxsize=4)
def _odd_pixels(detector: Detector, sky: float) -> Ints:
    level = ground(detector, sky)
    middle = float(np.median(level[:: max(1, level.shape[0] // 256)]))
    spread = math.hypot(math.sqrt(middle), law_of(detector).noise)
    return np.flatnonzero(np.abs(level - middle) > ODD * spread)


@njit(cache=True, error_model="numpy")
def _lay(electrons, level, windows):  # type: ignore[no-untyped-def]
    for k in range(len(windows)):
        left, top, right, bottom = windows[k]
        for y in range(top, bottom):
            for x in range(left, right):
                electrons[y, x] = level[y, x]
