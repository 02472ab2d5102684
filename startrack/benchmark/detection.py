"""Faint stars to be found, and bright ones to be measured, on the same kind of frame."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from startrack.benchmark.detection_limit import FALSE, limit
from startrack.benchmark.stage import Stage
from startrack.benchmark.starfield import (
    BACKGROUND,
    READ_NOISE,
    SIDE,
    expose,
    field,
    flux_of,
    paint,
    paired,
    places,
)
from startrack.detection import Detection, detect, gaussian_psf
from startrack.error import Star, centroid_bound
from startrack.streams import Streams
from startrack.values import Frame

Floats = NDArray[np.float64]
Finder = Callable[[Frame], Floats]

SIGMA = 1.2  # pixel
FAINT, BRIGHT = 7.0, 50.0  # signal-to-noise ratio
SPACING = 57  # pixel between stars


def finders(sigma: float) -> dict[str, Finder]:
    """Frame -> places (n, 2), by two of our centroids."""
    psf = gaussian_psf(sigma)

    def find(settings: Detection, frame: Frame) -> Floats:
        return places(detect(frame, settings, psf))

    settings = partial(Detection, kernel_sigma=sigma, max_spots=1000, false_per_frame=FALSE)
    return {
        "detect": partial(find, settings(centroid="gravity")),
        "detect_ml": partial(find, settings(centroid="likelihood")),
    }


def sown(snr: float) -> tuple[Frame, Floats, Floats, float]:
    """A frame with stars of one brightness, their x and y, and their electrons."""
    streams, flux = Streams(7, int(snr)), flux_of(snr, SIGMA)
    x, y = field(streams, SPACING)
    light = np.full((SIDE, SIDE), BACKGROUND)
    paint(light, x, y, flux, SIGMA)
    return expose(light, streams), x, y, flux


def detection() -> Stage:
    """The share of faint stars that are not found, at an allowed number of false spots."""
    frame, x, y, flux = sown(FAINT)
    return Stage(
        "detection",
        f"a megapixel with {len(x)} stars of SNR {FAINT:g}, background {BACKGROUND:g} e-",
        f"share of stars not found (ours at {FALSE} false spots a frame)",
        {name: partial(find, frame) for name, find in finders(SIGMA).items()},
        lambda spots: 1 - float(paired(spots, x, y)[0].mean()),
        1 - limit(flux, SIGMA),
        "the best test that knows each place",
    )


def centroid() -> Stage:
    """The scatter of the centroids of bright stars."""
    frame, x, y, flux = sown(BRIGHT)
    return Stage(
        "centroid",
        f"the same frame with {len(x)} stars of SNR {BRIGHT:g}",
        "rms of the centroid per axis, pixel",
        {name: partial(find, frame) for name, find in finders(SIGMA).items()},
        lambda spots: float(np.sqrt(np.mean(paired(spots, x, y)[1] ** 2))),
        centroid_bound(Star(flux, SIGMA, BACKGROUND, READ_NOISE))[0],
        "Cramer-Rao",
    )
