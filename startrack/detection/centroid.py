"""Pixels and Candidates -> Spots, by the centroid method of the settings."""

from __future__ import annotations

import math

import numpy as np

from startrack.core import Floats, Frame, Ints, Spots, kernel
from startrack.detection.find import Candidates
from startrack.detection.parameters import Detection
from startrack.detection.pixels import Pixels
from startrack.detection.plan import DetectionPlan
from startrack.detection.sample import FLUX, FLUX_SIGMA, XX, XY, YY, Sample, X, Y

SAME = 1.0  # pixel; peaks whose centroids are closer than that are one star


def centroid(
    frame: Frame,
    pixels: Pixels,
    candidates: Candidates,
    plan: DetectionPlan,
) -> Spots:
    """Measure every candidate, and drop those that run away or lead to the same star.

    Returns  Spots, brightest first
    Raises   those of the files of the four centroids.
    """
    table = measured(sample(frame, pixels, candidates, plan.settings), plan)
    order = np.argsort(-table[:, FLUX], kind="stable")  # NaN goes last
    return Spots(*_kept(table, order, candidates.area, plan.settings.max_spots))


def places(
    frame: Frame, pixels: Pixels, candidates: Candidates, plan: DetectionPlan
) -> tuple[Floats, Floats]:
    """Centroids of every candidate, which must be different stars, in their order.

    Returns  (n, 2) pixel, (n, 2, 2) pixel^2 as stated; NaN where it runs away
    """
    table = measured(sample(frame, pixels, candidates, plan.settings), plan)
    table[np.isnan(table[:, FLUX])] = np.nan
    return table[:, [X, Y]], table[:, [XX, XY, XY, YY]].reshape(-1, 2, 2)


def sample(frame: Frame, pixels: Pixels, candidates: Candidates, settings: Detection) -> Sample:
    """Gather it from the frame, its pixels and the settings."""
    saturation = math.inf if settings.saturation is None else settings.saturation
    return Sample(
        pixels.value,
        pixels.marks,
        candidates.x,
        candidates.y,
        settings.window // 2,
        pixels.step / math.sqrt(12),
        frame.electrons_per_dn,
        frame.offset - pixels.pivot,
        frame.read_noise / frame.electrons_per_dn,
        saturation - pixels.pivot,
    )


def measured(stars: Sample, plan: DetectionPlan) -> Floats:
    """One row per candidate, as `gravity` describes it."""
    settings = plan.settings
    return plan.method.measure(stars, plan.star, settings.kernel_sigma, settings.compensation)


def placed(stars: Sample, plan: DetectionPlan) -> Floats:
    """As `measured`; the covariance, and sigma of the flux, may be missing."""
    settings, method = plan.settings, plan.method
    measure = method.place or method.measure
    return measure(stars, plan.star, settings.kernel_sigma, settings.compensation)


@kernel
def _kept(table, order, area, most):  # type: ignore[no-untyped-def]
    """The columns of Spots, of the rows that `_apart` keeps."""
    chosen = order[_apart(table, order, most)]
    x, y, flux, snr = np.empty((4, len(chosen)))
    covariance = np.empty((len(chosen), 2, 2))
    for k in range(len(chosen)):
        row = table[chosen[k]]
        x[k], y[k], flux[k], snr[k] = row[X], row[Y], row[FLUX], row[FLUX] / row[FLUX_SIGMA]
        covariance[k, 0, 0], covariance[k, 1, 1] = row[XX], row[YY]
        covariance[k, 0, 1] = covariance[k, 1, 0] = row[XY]
    return x, y, flux, covariance, snr, area[chosen]


@kernel
def _apart(table: Floats, order: Ints, most: int) -> Ints:
    """Which places in `order` to keep: those with a flux, one for each star, the first `most`."""
    kept = np.empty(min(len(order), most), np.int64)
    count = 0
    for k in range(len(order)):
        x, y, flux = table[order[k], X], table[order[k], Y], table[order[k], FLUX]
        if count == len(kept) or np.isnan(flux):
            break
        new = True
        for other in kept[:count]:
            dx, dy = table[order[other], X] - x, table[order[other], Y] - y
            if dx * dx + dy * dy < SAME * SAME:
                new = False
                break
        if new:
            kept[count] = k
            count += 1
    return kept[:count]
