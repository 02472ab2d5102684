"""Detection and centroids of faint and bright stars, beside the ideal detector."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm

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
    spot_positions,
    stars_at,
)
from startrack.core import Floats, Frame, Streams
from startrack.detection import Detection, DetectionPlan, detect, gaussian_psf, plan_detection
from startrack.metrics import Star, centroid_bound

FALSE = 0.05  # spots a frame that are allowed


def limit(flux: float, sigma: float, false: float = FALSE) -> float:
    """Fraction of stars of known position that the best test of Neyman and Pearson finds.

    The ratio of likelihoods of Poisson's counts with read noise, taken for more light, is a sum
    of the pixels with the weights log(1 + flux p / (background + read noise^2)). Its tails come
    from its cumulants by the saddle point, which is good to a percent (Lugannani and Rice, 1980).
    A test in every pixel may be wrong in `false` of a frame.
    """
    extra = READ_NOISE**2 + 1 / 12
    found = []
    for p in stars_at(sigma, 4):
        weight = np.log1p(flux * p / (BACKGROUND + extra))
        weight /= np.sqrt((BACKGROUND + extra) * (weight @ weight))
        empty = partial(_exceeds, weight, np.full(p.size, BACKGROUND), extra)
        level = brentq(lambda t: np.log(empty(t) * SIDE**2 / false), 3.0, 9.0)  # noqa: B023
        light = BACKGROUND + flux * p
        found.append(_exceeds(weight, light, extra, level - flux * (weight @ p)))
    return float(np.mean(found))


def _exceeds(weight: Floats, light: Floats, extra: float, level: float) -> float:
    """Probability that weighted counts of mean `light` exceed their mean by more than `level`."""

    def cumulants(s: float) -> tuple[float, float, float]:
        grown = np.exp(s * weight)
        more = extra * (weight @ weight)
        value = light @ (grown - 1 - s * weight) + s * s * more / 2
        slope = (light * weight) @ (grown - 1) + s * more
        return float(value), float(slope), float((light * weight**2) @ grown + more)

    s = float(brentq(lambda s: cumulants(s)[1] - level, -40.0, 40.0))
    value, _, bend = cumulants(s)
    if abs(s) < 1e-4:
        return 0.5
    root, step = np.sign(s) * np.sqrt(2 * (s * level - value)), s * np.sqrt(bend)
    return float(norm.sf(root) + norm.pdf(root) * (1 / step - 1 / root))


Finder = Callable[[Frame], Floats]

SIGMA = 1.2  # pixel
FAINT, BRIGHT = 7.0, 50.0  # signal-to-noise ratio
SPACING = 57  # pixel between stars


def finders(sigma: float) -> dict[str, Finder]:
    """Frame -> positions (n, 2), by two centroid methods of startrack."""
    psf = gaussian_psf(sigma)

    def find(plan: DetectionPlan, frame: Frame) -> Floats:
        return spot_positions(detect(frame, plan))

    settings = partial(Detection, kernel_sigma=sigma, max_spots=1000, false_per_frame=FALSE)
    return {
        "detect": partial(find, plan_detection(settings(centroid="gravity"), psf)),
        "detect_ml": partial(find, plan_detection(settings(centroid="likelihood"), psf)),
    }


def sown(snr: float) -> tuple[Frame, Floats, Floats, float]:
    """A frame with stars of one brightness, their x and y, and their electrons."""
    streams, flux = Streams(7, int(snr)), flux_of(snr, SIGMA)
    x, y = field(streams, SPACING)
    light = np.full((SIDE, SIDE), BACKGROUND)
    paint(light, x, y, flux, SIGMA)
    return expose(light, streams), x, y, flux


def detection() -> Stage:
    """The fraction of faint stars that are not found, at an allowed number of false spots."""
    frame, x, y, flux = sown(FAINT)
    return Stage(
        "detection",
        f"a megapixel with {len(x)} stars of SNR {FAINT:g}, background {BACKGROUND:g} e-",
        f"fraction of stars not found (ours at {FALSE} false spots a frame)",
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
