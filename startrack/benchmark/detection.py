"""Detection and centroids of stars drawn by scipy's normal law, beside the ideal detector."""

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.optimize import brentq
from scipy.spatial import cKDTree
from scipy.special import ndtr
from scipy.stats import norm

from startrack.benchmark.stage import BenchmarkStage
from startrack.core import Flags, Floats, Frame, Spots, Streams
from startrack.detection import Detection, DetectionPlan, detect, gaussian_psf, plan_detection
from startrack.metrics import Star, centroid_bound

SIDE, BACKGROUND, READ_NOISE, OFFSET = 1024, 50.0, 5.0, 100.0
NEAR = 1.5  # pixel


def paint(image: Floats, x: Floats, y: Floats, flux: Floats | float, sigma: float) -> None:
    """Add stars to an image of electrons."""
    half = int(np.ceil(6 * sigma)) + 1
    for cx, cy, light in np.broadcast(x, y, flux):
        u = np.arange(max(round(cx) - half, 0), min(round(cx) + half + 1, image.shape[1]))
        v = np.arange(max(round(cy) - half, 0), min(round(cy) + half + 1, image.shape[0]))
        along = ndtr((u + 0.5 - cx) / sigma) - ndtr((u - 0.5 - cx) / sigma)
        down = ndtr((v + 0.5 - cy) / sigma) - ndtr((v - 0.5 - cy) / sigma)
        image[v[0] : v[-1] + 1, u[0] : u[-1] + 1] += light * np.outer(down, along)


def expose(light: Floats, streams: Streams, read_noise: float = READ_NOISE) -> Frame:
    """Photons, read noise and whole numbers."""
    image = streams("shot noise").poisson(light) + OFFSET
    image = image + read_noise * streams("read noise").standard_normal(light.shape)
    numbers = np.clip(np.round(image), 0, 65535).astype(np.uint16)
    return Frame(numbers, np.nan, 1.0, OFFSET, read_noise)


def field(streams: Streams, spacing: int) -> tuple[Floats, Floats]:
    """Stars on a grid, at random sub-pixel positions."""
    grid = np.arange(spacing, SIDE - spacing / 2, spacing)
    x, y = (a.ravel() for a in np.meshgrid(grid, grid))
    x = x + streams("x").uniform(-0.5, 0.5, x.size)
    return x, y + streams("y").uniform(-0.5, 0.5, y.size)


def stars_at(sigma: float, phases: int) -> Floats:
    """Fractions (n, 441) of a star's light, at positions all over a pixel."""
    phase, fractions = (np.arange(phases) + 0.5) / phases - 0.5, []
    for a in phase:
        for b in phase:
            image = np.zeros((21, 21))
            paint(image, np.array([10 + a]), np.array([10 + b]), 1.0, sigma)
            fractions.append(image.ravel())
    return np.array(fractions)


def snr_of(flux: float, sigma: float, star_noise: bool = True) -> float:
    """SNR of the best filter for a star of known position; its own shot noise is optional."""
    light = flux * stars_at(sigma, 8)
    noise = BACKGROUND + READ_NOISE**2 + 1 / 12 + star_noise * light
    return float(np.sqrt((light**2 / noise).sum(axis=1)).mean())


def flux_of(snr: float, sigma: float) -> float:
    """Electron."""
    return float(brentq(lambda flux: snr_of(flux, sigma) - snr, 1.0, 1e6))


def paired(spots: Floats, x: Floats, y: Floats) -> tuple[Flags, Floats]:
    """Whether each star has a spot near it, and the errors of these spots, (m, 2)."""
    if not len(spots):
        return np.zeros(len(x), bool), np.empty((0, 2))
    star = np.column_stack([x, y])
    distance, index = cKDTree(spots).query(star)
    near = distance < NEAR
    return near, (spots[index] - star)[near]


def spot_positions(spots: Spots) -> Floats:
    """(n, 2) pixel."""
    return np.column_stack([spots.x, spots.y])


FALSE = 0.05  # allowed false spots a frame


def limit(flux: float, sigma: float, false: float = FALSE) -> float:
    """Fraction of stars of known position that the best test of Neyman and Pearson finds.

    The test treats read noise as further light with Poisson noise. Its log likelihood ratio is then
    a sum of the pixels with the weights log(1 + flux p / (background + read noise^2)). Its tails
    follow from its cumulants by the saddle point, to a percent (Lugannani and Rice, 1980). The
    tests of all pixels may give `false` spots a frame.
    """
    extra = READ_NOISE**2 + 1 / 12
    fractions = []
    for p in stars_at(sigma, 4):
        weight = np.log1p(flux * p / (BACKGROUND + extra))
        weight /= np.sqrt((BACKGROUND + extra) * (weight @ weight))
        empty = partial(_exceeds, weight, np.full(p.size, BACKGROUND), extra)
        level = brentq(lambda t: np.log(empty(t) * SIDE**2 / false), 3.0, 9.0)  # noqa: B023
        light = BACKGROUND + flux * p
        fractions.append(_exceeds(weight, light, extra, level - flux * (weight @ p)))
    return float(np.mean(fractions))


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
FEW_SNR, FEW_SPACING = 10.0, 180  # of a frame with as many stars as a tracker keeps


def places_of(plan: DetectionPlan, frame: Frame) -> Floats:
    """Places (n, 2) pixel, of the spots of a frame."""
    return spot_positions(detect(frame, plan))


def finders(sigma: float) -> dict[str, Finder]:
    """Frame -> positions (n, 2), by two centroid methods of startrack."""
    psf = gaussian_psf(sigma)
    settings = partial(Detection, kernel_sigma=sigma, max_spots=1000, false_per_frame=FALSE)
    return {
        "detect": partial(places_of, plan_detection(settings(centroid="gravity"), psf)),
        "detect_ml": partial(places_of, plan_detection(settings(centroid="likelihood"), psf)),
    }


def star_frame(snr: float, spacing: int = SPACING) -> tuple[Frame, Floats, Floats, float]:
    """A frame with stars of one brightness, their x and y, and their electrons."""
    streams, flux = Streams(7, int(snr)), flux_of(snr, SIGMA)
    x, y = field(streams, spacing)
    light = np.full((SIDE, SIDE), BACKGROUND)
    paint(light, x, y, flux, SIGMA)
    return expose(light, streams), x, y, flux


def detection() -> BenchmarkStage:
    """The fraction of faint stars that are not found, at an allowed number of false spots."""
    frame, x, y, flux = star_frame(FAINT)
    return BenchmarkStage(
        name="detection",
        work=f"a megapixel with {len(x)} stars of SNR {FAINT:g}, background {BACKGROUND:g} e-",
        error=f"fraction of stars not found (ours at {FALSE} false spots a frame)",
        ways={name: partial(find, frame) for name, find in finders(SIGMA).items()},
        judge=lambda spots: 1 - float(paired(spots, x, y)[0].mean()),
        limit=1 - limit(flux, SIGMA),
        limit_of="the best test that knows each place",
    )


def quick_detection() -> BenchmarkStage:
    """The time of a megapixel with few stars, for the filter's search and the quick search."""
    frame, x, y, _ = star_frame(FEW_SNR, FEW_SPACING)
    settings = partial(Detection, kernel_sigma=SIGMA, false_per_frame=FALSE, centroid="gravity")
    psf = gaussian_psf(SIGMA)
    plans = {
        "detect": plan_detection(settings(), psf),
        "detect_quick": plan_detection(settings(search="quick"), psf),
    }
    return BenchmarkStage(
        "quick-detection",
        f"a megapixel with {len(x)} stars of SNR {FEW_SNR:g}, background {BACKGROUND:g} e-",
        f"fraction of stars not found (ours at {FALSE} false spots a frame)",
        {name: partial(places_of, plan, frame) for name, plan in plans.items()},
        lambda spots: 1 - float(paired(spots, x, y)[0].mean()),
    )


def centroid() -> BenchmarkStage:
    """The scatter of the centroids of bright stars."""
    frame, x, y, flux = star_frame(BRIGHT)
    return BenchmarkStage(
        name="centroid",
        work=f"the same frame with {len(x)} stars of SNR {BRIGHT:g}",
        error="rms of the centroid per axis, pixel",
        ways={name: partial(find, frame) for name, find in finders(SIGMA).items()},
        judge=lambda spots: float(np.sqrt(np.mean(paired(spots, x, y)[1] ** 2))),
        limit=centroid_bound(Star(flux, SIGMA, BACKGROUND, READ_NOISE))[0],
        limit_of="Cramer-Rao",
    )
