"""Candidates of a frame -> Spots: each is measured once, by the centroid method of the plan."""

import math

import numpy as np

from startrack.core import Floats, Frame, Ints, Spots, kernel
from startrack.detection.connect import Peaks
from startrack.detection.gravity import FLUX, FLUX_SIGMA, XX, XY, YY, Sample, X, Y
from startrack.detection.parameters import Detection
from startrack.detection.pixels import Pixels
from startrack.detection.plan import DetectionPlan

SAME = 1.0  # pixel; peaks whose centroids are closer than that are one star


def centroid(frame: Frame, pixels: Pixels, candidates: Peaks, plan: DetectionPlan) -> Spots:
    """Measure every candidate, and drop candidates that diverge or give the same star again.

    Returns  Spots, brightest first
    Raises   the errors of the centroid methods.
    """
    table = measured(sample(frame, pixels, candidates, plan.settings), plan)
    order = np.argsort(-table[:, FLUX], kind="stable")  # NaN goes last
    return Spots(*_kept(table, order, candidates.area, plan.settings.max_spots))


def places(
    frame: Frame, pixels: Pixels, candidates: Peaks, plan: DetectionPlan
) -> tuple[Floats, Floats]:
    """Centroids of all candidates, in order; the candidates must be different stars.

    Returns  (n, 2) pixel, (n, 2, 2) pixel^2 as stated; NaN where it diverges
    """
    table = measured(sample(frame, pixels, candidates, plan.settings), plan)
    table[np.isnan(table[:, FLUX])] = np.nan
    return table[:, [X, Y]], table[:, [XX, XY, XY, YY]].reshape(-1, 2, 2)


def sample(frame: Frame, pixels: Pixels, candidates: Peaks, settings: Detection) -> Sample:
    """The Sample of a frame, its pixels and the settings."""
    saturation = math.inf if settings.saturation is None else settings.saturation
    # Kernels are compiled again for arrays of another layout.
    x, y = (np.ascontiguousarray(place) for place in (candidates.x, candidates.y))
    return Sample(
        image=pixels.value,
        dead=pixels.marks,
        x=x,
        y=y,
        half=settings.window // 2,
        floor=pixels.step / math.sqrt(12),
        light=frame.noise_gain,
        offset=frame.offset - pixels.pivot,
        read_noise=frame.read_noise / frame.electrons_per_dn,
        saturation=saturation - pixels.pivot,
    )


def measured(stars: Sample, plan: DetectionPlan, stated: bool = True) -> Floats:
    """One row per candidate, as `gravity` describes it.

    stated  whether covariance and sigma of the flux are needed; else they may be absent
    """
    settings, method = plan.settings, plan.method
    measure = method.measure if stated or not method.place else method.place
    return measure(stars, plan.star, settings.kernel_sigma, settings.compensation)


@kernel
def _kept(table, order, area, most):  # type: ignore[no-untyped-def]
    """The columns of Spots for the rows that `_apart` keeps."""
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
    """Positions in `order` to keep: measured spots, one for each star, at most `most`."""
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
