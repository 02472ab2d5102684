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
from startrack.detector.law import law_of
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
        "scan": detector.scan,
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
    """The numbers that `expose` gives, in windows; elsewhere the mean of an even sky.

    windows  (w, 4) left, top, right, bottom, the last two not in it; they may overlap
    places   weight, x and y of each point of the stars' paths
    star     (n,) electron in the exposure
    sky      electron in a pixel of mean response
    Returns  Frame of float32, which holds all numbers of 24 bits; the next call overwrites it
    """
    shape, law = (detector.rows, detector.columns), law_of(detector)
    electrons = scratch("expected electrons", shape, np.float64)
    image = scratch("digital numbers", shape, np.float32)  # as the detection wants it
    # Between the windows an even sky: what another trial left there must not be seen.
    level = sky + detector.dark_rate * detector.exposure
    image.fill(detector.offset + level / detector.electrons_per_dn)
    _lay(electrons, ground(detector, sky), windows)
    draw(electrons, psf, places, star, detector)
    digitise_within(image, electrons, windows, law, streams, ground_tables(detector, sky))
    if detector.hits:
        pixel, extra = tracks(detector.hits, shape, detector.pitch, detector.exposure, streams)
        digitise_hit(image, electrons, pixel, extra, law, streams)
    return told(image, detector)


def put(frame: Frame, pixel: Ints, numbers: Ints) -> None:
    """Write numbers (k, 2 m + 1, 2 n + 1) about pixels into a frame of `expose_within`.

    pixel  (k,) row * columns + column
    """
    _put(frame.image, pixel, numbers)


def lone_pixels(detector: Detector, sky: float, streams: Streams) -> Ints:
    """The pixels that are unlike their neighbours: hit, hot or dead.

    Returns  (k,) row * columns + column
    """
    odd = odd_pixels(detector, sky)
    if not detector.hits:
        return odd
    shape = (detector.rows, detector.columns)
    pixel, _ = tracks(detector.hits, shape, detector.pitch, detector.exposure, streams)
    return np.concatenate([odd, pixel])


@lru_cache(maxsize=4)
def odd_pixels(detector: Detector, sky: float) -> Ints:
    """The hot and the dead ones, (k,) row * columns + column."""
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


@njit(cache=True, error_model="numpy")
def _put(image, pixel, numbers):  # type: ignore[no-untyped-def]
    rows, columns = image.shape
    down, across = numbers.shape[1] // 2, numbers.shape[2] // 2
    for k in range(len(pixel)):
        y, x = pixel[k] // columns, pixel[k] % columns
        for v in range(max(y - down, 0), min(y + down + 1, rows)):
            for u in range(max(x - across, 0), min(x + across + 1, columns)):
                image[v, u] = numbers[k, v - y + down, u - x + across]
